"""Simulated position means: the chain's readings plus noise of the stated size, by an explicit key."""

import jax
import numpy as np
import pytest
from scipy import stats

import independent
from tumblecal import InputError
from tumblecal.capture.capture_plan import CapturePlan, PositionsTable, Session, read_plan
from tumblecal.chain import nominal_chain, settings
from tumblecal.chain.rig_file import read_rig
from tumblecal.data import paper
from tumblecal.effects import catalogue
from tumblecal.effects.rig_with_effects import read_rig_with_effects
from tumblecal.simulation.next_measurement import simulated_after
from tumblecal.simulation.position_means import position_means, simulated


pytestmark = pytest.mark.usefixtures("quickly_compiled")


def test_without_noise_it_is_the_chain(configs):
    data = simulated(read_rig(configs / "paper24.toml"), 0, noise_sd=0.0)
    truth = np.array(list(paper.SIMULATION_TRUTH.values()))
    expected = independent.nominal(truth, data.alpha, data.beta, np.repeat([0, 1, 2], 8))
    np.testing.assert_allclose(data.readings, expected, rtol=0, atol=1e-15)


def test_noise_is_white_normal_and_of_the_stated_size():
    where = settings(np.zeros(20000), np.zeros(20000))
    chain = nominal_chain(where)
    noise = np.asarray(position_means(chain, where, 2e-4, jax.random.key(1)) - chain(where)) / 2e-4
    assert stats.kstest(noise.ravel(), stats.norm.cdf).pvalue > 1e-3
    count = noise.size
    assert np.std(noise) == pytest.approx(1.0, abs=4 / np.sqrt(2 * count))
    lags = [np.mean(noise[1:] * noise[:-1]), np.mean(noise[:, 0] * noise[:, 1])]
    assert np.max(np.abs(lags)) < 4 / np.sqrt(20000)


def test_a_second_measurement_continues_the_first_one_s_drift_at_its_own_temperature(configs, tmp_path):
    """The x bias drifts by 0.2 mg/h: two hours after the last position it is 6 h older than at the first one."""
    (tmp_path / "next.toml").write_text(
        "[conditions]\nafter_s = 7500\nstep_s = 300\ntemperature_degc = 24\n"
        "[[positions.listed]]\nalpha_deg = 0\nbeta_deg = 0\n[[positions.listed]]\nalpha_deg = 30\nbeta_deg = 0\n"
    )
    plan, rig = read_plan(tmp_path / "next.toml"), read_rig_with_effects(configs / "hidden_effect.toml", catalogue())
    first, new = simulated(rig, 0, noise_sd=0.0), simulated_after(rig, plan, tmp_path / "next.toml", 0, noise_sd=0.0)
    assert new.time_s is not None and new.time_s.tolist() == [21600.0, 21900.0]
    assert new.temperature_degc is not None and new.temperature_degc.tolist() == [24.0, 24.0]
    later = (new.time_s - first.time_s[:2]) / 3600 * 0.2e-3
    np.testing.assert_allclose(new.readings - first.readings[:2], np.outer(later, [1, 0, 0]), rtol=0, atol=1e-15)
    requested = [
        step.model_copy(update={"temperature_degc": degc}) for step, degc in zip(plan.steps, (5, 40), strict=True)
    ]
    warm = plan.model_copy(update={"positions": PositionsTable(listed=requested)})
    warmed = simulated_after(
        rig, CapturePlan.model_validate(warm.model_dump()), tmp_path / "next.toml", 0, noise_sd=0.0
    )
    assert warmed.temperature_degc is not None and warmed.temperature_degc.tolist() == [5.0, 40.0]
    unknown = plan.model_copy(update={"session": Session(mount="B")})
    with pytest.raises(InputError, match=r"next\.toml: mount B is not in .*hidden_effect\.toml"):
        simulated_after(rig, unknown, tmp_path / "next.toml", 0)


def test_same_seed_same_bits_other_seed_other_noise(configs):
    rig = read_rig(configs / "grid48.toml")
    first, again, other = simulated(rig, 7), simulated(rig, 7), simulated(rig, 8)
    assert first.readings.tobytes() == again.readings.tobytes()
    assert np.mean(first.readings == other.readings) < 0.01
    assert first.comments["seed"] == "7" and first.comments["noise_sd_g"] == "0.0001"

"""Checks while and after a position is recorded: each fault alone is found, and nothing in clean noise."""

import numpy as np
import pytest

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.capture.run.dwell import NOT_TURNED, WRONG_POSITION, Blocks, Stationarity, judge
from tumblecal.recordings.dwells.dwell_checks import check_dwell


RATE, N = 125.0, 30_000
SD = 450e-6
MEAN_SD = np.full(3, SD / np.sqrt(N))
MEAN = np.array([0.1, -0.7, 0.7])
PLAN = CapturePlan.model_validate(
    {"positions": {"beta_deg": [0, 45, 90], "alpha_deg": [0, 45, 90, 135, 180, 225, 270, 315]}}, strict=False
)


def noise(seed: int, n: int = N) -> np.ndarray:
    return MEAN + np.random.default_rng(seed).normal(size=(n, 3)) * SD


def test_clean_noise_raises_no_warning() -> None:
    """False alarms of all checks together: at most 2 in 60 dwells."""
    alarms = [check_dwell(noise(seed, 6000), RATE, np.full(3, SD / np.sqrt(6000))).warnings for seed in range(60)]
    assert sum(bool(a) for a in alarms) <= 2


def test_warm_up() -> None:
    data = noise(1)
    data[:, 2] += 200e-6 * np.exp(-np.arange(N) / RATE / 20.0)
    found = check_dwell(data, RATE, MEAN_SD)
    assert found.warnings[0].startswith("warm-up")
    assert found.warm_up_time_s == pytest.approx(20, rel=0.5) and found.warm_up_g[2] == pytest.approx(200e-6, rel=0.4)


@pytest.mark.parametrize("seed", [1, 2])
def test_an_axis_that_never_changes_is_no_warm_up(seed: int) -> None:
    data = noise(seed, 600)
    data[:, 0] = 0.3
    assert not any("warm-up" in words for words in check_dwell(data, RATE, MEAN_SD).warnings)


def test_outliers_and_saturation() -> None:
    data = noise(3)
    data[1000:9000:1000, 1] += 0.02
    found = check_dwell(data, RATE, MEAN_SD, saturated=7)
    assert found.outliers == [0, 8, 0]
    assert any("saturation: 7" in w for w in found.warnings)


def test_mains_aliased_by_sampling() -> None:
    data = noise(4)
    data[:, 1] += 60e-6 * np.sin(2 * np.pi * 100.0 * np.arange(N) / RATE)
    (line,) = check_dwell(data, RATE, MEAN_SD).lines
    assert line.axis == "y" and line.frequency_hz == pytest.approx(25.0, abs=0.1)
    assert line.amplitude_ug == pytest.approx(60, rel=0.2) and line.cause == "mains, 100 Hz, aliased"


def test_coarse_quantisation() -> None:
    data = noise(5)
    data[:, 0] = np.round(data[:, 0] / 4e-3) * 4e-3
    found = check_dwell(data, RATE, MEAN_SD)
    data[:, 0] = 0.1
    assert not any("quantisation" in w for w in check_dwell(noise(6), RATE, MEAN_SD).warnings)
    assert any("quantisation" in w for w in found.warnings)


def judged(data: np.ndarray) -> Stationarity:
    blocks = Blocks(125.0)
    blocks.add(data)
    return blocks.stationarity()


def test_a_tilt_step_is_seen() -> None:
    """One arc minute (291 ug) on one axis stands out of one-second block means at STIM300 noise."""
    data = noise(7, 125 * 60)
    data[125 * 40 :, 0] += 291e-6
    found = judged(data)
    assert min(found.knocks + found.creep) >= 38


def test_still_data_are_stationary() -> None:
    """At most one alarm in 40 dwells of two minutes."""
    found = [judged(noise(s, 125 * 120)) for s in range(40)]
    assert sum(bool(each.knocks or each.creep) for each in found) <= 1


def test_a_knock_shows_in_the_noise() -> None:
    data = noise(8, 125 * 60)
    data[125 * 30 : 125 * 31] += np.random.default_rng(0).normal(size=(125, 3)) * 0.01
    assert 30 in judged(data).knocks


def force(alpha: float, beta: float) -> np.ndarray:
    a, b = np.radians([alpha, beta])
    return np.array([-np.sin(b), np.cos(b) * np.sin(a), np.cos(b) * np.cos(a)])


@pytest.mark.parametrize(
    ("mean", "previous", "fault", "words"),
    [
        (force(45, 0), None, "", ""),
        (force(45.2, 0.1) + 0.002, None, "", ""),
        (force(90, 0), None, WRONG_POSITION, "this looks like alpha 90, beta 0, not alpha 45, beta 0"),
        (force(0, 0), 0, NOT_TURNED, "still at alpha 0, beta 0: turn to alpha 45"),
        (2 * force(45, 0), None, WRONG_POSITION, "check range and unit"),
        (force(62, 20), None, WRONG_POSITION, "alpha 62.0, beta 20.0"),
    ],
)
def test_mistakes_are_named(mean: np.ndarray, previous: int | None, fault: str, words: str) -> None:
    verdict = judge(PLAN, 1, mean, previous)
    assert verdict.fault == fault and words in verdict.text


def test_reversed_and_exchanged_axes() -> None:
    plan = CapturePlan.model_validate({"positions": {"listed": [{"alpha_deg": 20.0, "beta_deg": 35.0}]}})
    true = force(20, 35)
    assert judge(plan, 0, true * [1, -1, 1]).text.startswith("the sign of axis y seems reversed")
    assert judge(plan, 0, true[[1, 0, 2]]).text.startswith("axes x and y seem exchanged")
    assert judge(plan, 0, -true).text.startswith("all signs seem reversed")

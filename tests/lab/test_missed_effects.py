"""`use` of a calibration: data that contradict the model are `no`, and U covers the errors of corrected readings.

Instruments, readings and true forces are those of `in_use_instrument`, which imports nothing of the program.
"""

from dataclasses import replace

import numpy as np
import pytest

import in_use_instrument as truth
from few_effects import few_entries
from tumblecal.data import PositionSet
from tumblecal.estimation.methods import calibrate
from tumblecal.lab.missed_effects import missed_effects
from tumblecal.lab.record import calibration_of


SIGMA = 1e-4


def measured(seed, name="4x12", effects=(), sigma=8.0):
    """A random instrument and its readings; each effect shows with so many sigma."""
    rng = np.random.default_rng([seed, 58])
    plan, turns = truth.schedule(name, rng)
    own = truth.instrument(plan, turns, rng, [])
    for id in effects:
        alone = replace(own, effects=truth.instrument(plan, turns, rng, [id]).effects)
        own.effects[id] = alone.effects[id] * (sigma / truth.shown_share(alone, plan, SIGMA)[0])
    clean = truth.readings(own, plan)
    data = PositionSet(
        tuple(f"p{k + 1}" for k in range(len(clean))),
        np.degrees(plan.alpha).round(6),
        np.degrees(plan.beta).round(6),
        clean + SIGMA * rng.normal(size=clean.shape),
        time_s=plan.time_s,
        temperature_degc=plan.temperature_degc,
    )
    return own, plan, data, rng


def calibrated(data, noise_sd=SIGMA):
    return calibrate(data, noise_sd=noise_sd, entries=few_entries())


@pytest.mark.parametrize(
    ("noise_sd", "files"),
    [(SIGMA, 10), pytest.param(SIGMA, 40, marks=pytest.mark.long), pytest.param(None, 25, marks=pytest.mark.long)],
)
def test_adequate_data_may_be_used_and_an_effect_of_eight_sigma_not(noise_sd, files):
    """The bound on the p-value is valid; of 25 files 0.1 false alarms are expected."""
    p_values, refused = [], 0
    for seed in range(files):
        _, _, data, _ = measured(seed)
        fitted = calibrated(data, noise_sd)
        p_values.append(missed_effects(fitted.exact, few_entries()).p_value)
        refused += fitted.use.answer not in ("yes", "within")
    assert refused <= 1 and min(p_values) > 0.0025 and np.mean(np.array(p_values) < 0.05) <= 0.16
    for seed in range(files // 4):
        use = calibrated(measured(seed, effects=["second_order"])[2], noise_sd).use
        assert use.refused and use.reason.startswith("the data contradict the model (p ") and not use.expanded_words


@pytest.mark.long
def test_u_covers_effects_that_the_data_did_not_show():
    """Effects of two sigma in the readings are several times as large in the parameters. The uncertainty of the noise alone
    covers fewer errors."""
    within, of_noise = [], []
    for seed in range(20):
        own, plan, data, rng = measured(seed, effects=["second_order", "bias_temperature"], sigma=2.0)
        fitted = calibrated(data)
        if fitted.use.refused:
            continue
        calibration = calibration_of(fitted.exact, few_entries())
        since, degc = float(np.mean(plan.time_s) - plan.time_s[0]), float(np.max(plan.temperature_degc))
        lower, turn = np.linalg.qr(truth.linear(own, since, degc)[0].T)[::-1]
        to_frame = (turn * np.sign(np.diag(lower))).T
        force = rng.normal(size=(60, 3))
        force /= np.linalg.norm(force, axis=1, keepdims=True)
        found = calibration.corrected(truth.output(own, force, since, degc), degc, float(np.mean(plan.time_s)))
        error = np.abs(found - force @ to_frame.T)
        within.append(np.mean(error <= fitted.use.expanded_g))
        sd = np.sqrt(np.diag(calibration.covariance)[9:])
        of_noise.append(np.mean(error <= 2 * sd))
    assert len(within) >= 15 and np.mean(within) >= 0.95 and np.mean(of_noise) < 0.9


def test_u_includes_the_attitudes_that_were_not_measured(table1):
    """The paper's plan has x between 0 and -1 g: at +1 g bias and scale factor errors add up."""
    fitted = calibrate(table1, noise_sd=SIGMA)
    places = [fitted.exact.names.index(name) for name in ("dK_x", "bias_x")]
    covariance = fitted.exact.covariance[np.ix_(places, places)]
    up, down = (2 * np.sqrt([share, 1.0] @ covariance @ [share, 1.0]) for share in (1.0, -1.0))
    assert up > 3 * down and fitted.use.expanded_g > up

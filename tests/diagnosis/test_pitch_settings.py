"""Whether pitch errors are the head's, against least squares of all readings together."""

import numpy as np
import pytest
from scipy import stats

from tumblecal.diagnosis.units.amounts import pitch_settings
from tumblecal.diagnosis.units.mixed_model import NormalEquations


SHARED, SETTINGS = 2, 3


def measured(rng: np.random.Generator, units: int, errors: np.ndarray, seen: np.ndarray) -> list[tuple]:
    """Design and readings of each unit, white, noise 1; `errors`, `seen`: (units, settings)."""
    shared, each = rng.normal(size=SHARED), []
    for error, met in zip(errors, seen, strict=True):
        design = rng.normal(size=(20, SHARED + SETTINGS)) * np.concatenate([np.ones(SHARED), met])
        readings = design @ np.concatenate([shared, error]) + rng.normal(size=20)
        each.append((design, readings - design[:, :SHARED] @ shared))
    return each


def compared(each: list[tuple], most_alone: int):
    pairs = [(design[:, SHARED:], readings) for design, readings in each]
    gram, towards = (np.stack(part) for part in zip(*[(x.T @ x, x.T @ y) for x, y in pairs], strict=True))
    return pitch_settings(NormalEquations(gram, towards), np.ones(len(gram), bool), most_alone)


def chi2(parts: list[np.ndarray], readings: list[np.ndarray]) -> float:
    """Of one estimate for all parts, beyond one estimate for each."""

    def left(design, y):
        return float(np.sum((y - design @ np.linalg.lstsq(design, y, rcond=None)[0]) ** 2))

    return left(np.concatenate(parts), np.concatenate(readings)) - sum(map(left, parts, readings))


@pytest.mark.parametrize("seed", range(4))
def test_p_value_is_that_of_least_squares(seed):
    rng = np.random.default_rng(seed)
    seen = np.vstack([np.ones((1, SETTINGS)), rng.random((7, SETTINGS)) < 0.7])
    each = measured(rng, 8, np.tile(rng.normal(size=SETTINGS), (8, 1)), seen)
    settings = compared(each, 0)
    dof = int(np.sum(seen)) - SETTINGS
    statistic = chi2([design[:, SHARED:] for design, _ in each], [y for _, y in each])
    assert settings.p_value == pytest.approx(stats.chi2.sf(statistic, dof), rel=1e-6)
    assert settings.alone == () and settings.changed is None and np.all(settings.seen)


def test_wrong_labels_of_some_of_hundreds_are_left_out_and_a_change_is_told():
    rng = np.random.default_rng(1)
    errors, seen = np.tile(rng.normal(size=SETTINGS), (300, 1)), np.ones((300, SETTINGS))
    wrong = (7, 44, 120, 250)
    for unit in wrong:
        errors[unit, unit % SETTINGS] += 30.0
    settings = compared(measured(rng, 300, errors, seen), 100)
    assert settings.alone == wrong and settings.common and settings.changed is None

    errors[list(wrong)] = errors[0]
    errors[180:] += 1.0
    settings = compared(measured(rng, 300, errors, seen), 100)
    assert settings.alone == () and not settings.common and settings.changed in range(178, 183)
    far = compared([(design, y + 1e9 * design[:, -1]) for design, y in measured(rng, 300, errors, seen)], 100)
    assert far.changed in range(178, 183)

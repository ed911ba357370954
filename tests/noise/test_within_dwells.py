"""Changes within dwells that all have in common are told with their size, and are no noise."""

import numpy as np
import pytest

from tumblecal.data.position_comments import WITHIN_DWELLS
from tumblecal.noise.parts import Dwells, Flicker, GaussMarkov, Noise, RandomWalk, White
from tumblecal.noise.sampling import dwell_records
from tumblecal.noise.within_dwells import (
    TEMPERATURE,
    TIME,
    changes_within_dwells,
    within_dwells_comments,
    without_common_change,
)


RATE_HZ, WHITE = 10.0, 4e-5
ONES = np.ones(3)
COLOURS = {
    "flicker": (Flicker(2e-5 * ONES, 0.1, 1e5),),
    "random walk": (RandomWalk(1e-5 * ONES),),
    "Gauss-Markov": (GaussMarkov(8e-5 * ONES, 5.0),),
}
PLANS = {"24 x 30 s": (24, 30.0, 60.0), "4 x 5 s": (4, 5.0, 20.0)}


def recording(seed, colour, plan):
    """Dwells of noise about attitudes, and a temperature that rises through all of them."""
    count, length, step = PLANS[plan]
    size, starts = round(length * RATE_HZ), np.arange(count) * step
    up = np.random.default_rng(seed).normal(size=(count, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    noise = Noise((White(WHITE * ONES), *COLOURS.get(colour, ())))
    time = starts[:, None] + np.arange(size) / RATE_HZ
    return list(dwell_records(noise, Dwells(starts, size, 1 / RATE_HZ), seed, up)), list(25 + 20 * time / time.max())


@pytest.mark.parametrize("plan", PLANS)
@pytest.mark.parametrize("colour", COLOURS)
def test_slow_noise_is_no_change_in_common(colour, plan):
    """At most one false report in a hundred is allowed."""
    false = sum(bool(without_common_change(own[0], RATE_HZ, own[1])[1]) for own in (
        recording(seed, colour, plan) for seed in range(40)))  # fmt: skip
    assert false <= 2


def test_a_change_with_the_temperature_is_told_and_is_no_noise():
    """45 degC within each dwell of 50 s made 99 mg of noise, and 13 mg rms were adequate."""
    rng, count, size = np.random.default_rng(3), 24, 500
    up = rng.normal(size=(count, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    # Up in one dwell and down in the next, the more the later.
    course = np.linspace(-0.5, 0.5, size) * (np.linspace(20, 45, count) * (-1.0) ** np.arange(count))[:, None]
    temperature = 47.0 + course + 0.05 * rng.normal(size=course.shape)
    bias, scale = np.array([2.2e-3, 0.0, 0.0]), np.array([0.0, 2e-4, 0.0])
    noise = 4e-4 * rng.normal(size=(count, size, 3))
    dwells = up[:, None] + course[:, :, None] * (bias + scale * up[:, None]) + noise
    quiet, (change,) = without_common_change(list(dwells), RATE_HZ, list(temperature))
    assert change.variable == TEMPERATURE and change.axes.tolist() == [True, True, False] and not change.confounded
    np.testing.assert_allclose(change.bias, bias, atol=2e-6)
    np.testing.assert_allclose(change.scale, scale, atol=4e-6)
    assert change.change[0] == pytest.approx(99e-3, rel=0.02) and change.course == pytest.approx(45.0, rel=0.02)
    np.testing.assert_allclose(np.mean(quiet, axis=1), dwells.mean(axis=1), atol=1e-12)
    np.testing.assert_allclose(np.std(quiet, axis=1, ddof=1), 4e-4, rtol=0.15)
    assert "x +2.2 mg/degC" in change.words() and "mean temperature of its dwell" in change.words()
    comments = within_dwells_comments([change])
    assert comments[WITHIN_DWELLS] == change.words() and within_dwells_comments([]) == {}
    ((variable, size),) = changes_within_dwells(comments)
    assert variable == TEMPERATURE and size == pytest.approx(float(np.max(change.change)), rel=1e-3)


@pytest.mark.parametrize("with_temperature", [False, True])
def test_a_change_with_time_in_few_and_short_dwells(with_temperature):
    """Without a temperature it is the time; with one of the same course it may be either, and that is said."""
    dwells, _ = recording(5, "white", "4 x 5 s")
    rising = np.arange(50) / RATE_HZ
    moved = [own + 2e-4 * rising[:, None] for own in dwells]
    temperatures = [20 + 3 * rising for _ in dwells] if with_temperature else None
    quiet, (change,) = without_common_change(moved, RATE_HZ, temperatures)
    per_s = change.bias * (3.0 if with_temperature else 1.0)
    assert change.variable == (TEMPERATURE if with_temperature else TIME) and change.confounded == with_temperature
    np.testing.assert_allclose(per_s[change.axes], 2e-4, rtol=0.2)
    assert np.max(np.std(quiet, axis=1)) < 2.5 * WHITE * np.sqrt(RATE_HZ)
    assert ("both have the same course" in change.words()) == with_temperature
    # A temperature that nobody recorded, or that does not change, tells nothing.
    for unknown in (np.full(50, np.nan), np.full(50, 21.0)):
        assert all(own.variable == TIME for own in without_common_change(moved, RATE_HZ, [unknown] * 4)[1])

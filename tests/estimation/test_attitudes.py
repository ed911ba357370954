"""Attitudes that a hand-held set lacks, in words."""

import re

import numpy as np
import pytest

from tumblecal.estimation.attitudes import next_attitudes


AXES = {f"{sign}{axis}": (1 if sign == "+" else -1) * np.eye(3)[k] for k, axis in enumerate("xyz") for sign in "+-"}


def down_of(words):
    """What a person does who follows the words: which way of the triad points down."""
    sides = [AXES[name] for name in re.findall(r"[+-][xyz]", words)]
    tilt = re.search(r"tilted (\d+) deg towards", words)
    if tilt:
        angle = np.radians(float(tilt[1]))
        return np.cos(angle) * sides[0] + np.sin(angle) * sides[1]
    assert len(sides) == {"face": 1, "edge": 2, "corner": 3}[next(k for k in ("edge", "corner", "face") if k in words)]
    return np.sum(sides, axis=0) / np.sqrt(len(sides))


def worst_sd(ups):
    """The sd of the weakest direction of nine parameters by the sizes of readings, differentiated numerically; sd 1 each."""

    def sizes(parameters):
        scale, bias, (g21, g31, g32) = parameters[:3], parameters[3:6], parameters[6:]
        x, y, z = np.asarray(ups, float).T
        inputs = np.column_stack([x, y + g21 * x, z + g31 * x + g32 * y])
        readings = (1 + scale) * inputs + bias
        return np.linalg.norm(readings, axis=1)

    jacobian = np.column_stack([(sizes(step) - sizes(-step)) / 2e-6 for step in 1e-6 * np.eye(9)])
    return np.sqrt(1 / max(np.linalg.eigvalsh(jacobian.T @ jacobian)[0], 1e-12))


@pytest.mark.parametrize("seed", range(6))
def test_what_is_proposed_lowers_the_weakest_direction_as_said(seed):
    """Sets of a hand that kept one side up: each attitude does what was said, better than the rest, and together a lot."""
    rng = np.random.default_rng(seed)
    ups = rng.normal(size=(14, 3)) * [1, 1, 0.5]
    ups[:, 2] = np.abs(ups[:, 2])
    ups /= np.linalg.norm(ups, axis=1, keepdims=True)
    before, began = worst_sd(ups), worst_sd(ups)
    proposed = next_attitudes(ups * 1.02)
    assert proposed
    for attitude, gain in proposed:
        ups = np.vstack([ups, -down_of(attitude.words)])
        after = worst_sd(ups)
        assert after == pytest.approx(before * (1 - gain), rel=0.02)
        before = after
    assert before < 0.5 * began
    arbitrary = [worst_sd(np.vstack([ups[:14], rng.normal(size=(len(proposed), 3))])) for _ in range(20)]
    assert before < np.median(arbitrary)

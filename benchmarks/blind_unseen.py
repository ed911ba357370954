"""More causes that are in no catalogue, written after everything else: nothing was tuned on them."""

from dataclasses import replace

import numpy as np

from blind_instrument import Setup, readings
from blind_sized import Sized, on_output, rocked


def iron_nearby(setup: Setup, rng: np.random.Generator) -> Sized:
    """A magnetic part stands beside the head: all outputs are pulled, each its own way, as the triad sweeps by."""
    away = 1.4 - np.cos(setup.alpha - rng.uniform(0, 2 * np.pi)) * np.cos(setup.beta - rng.uniform(0, np.pi / 2))
    added = (away ** -rng.uniform(1.5, 3.0))[:, None] * rng.normal(size=3)
    return lambda size: readings(setup, setup.nominal, {}) + size * added


def cage_of_the_bearing(setup: Setup, rng: np.random.Generator) -> Sized:
    """The index follows the balls of the bearing, whose cage falls back with every step of the spindle."""
    steps = np.argsort(np.argsort(setup.time_s, kind="stable"), kind="stable")
    cage = rng.uniform(0.36, 0.44) * (setup.alpha + rng.uniform(0.5, 2.0) * steps)
    off = np.sin(rng.integers(2, 5) * cage + rng.uniform(0, 2 * np.pi))
    return lambda size: readings(replace(setup, alpha=setup.alpha + size * off), setup.nominal, {})


def somebody_leans(setup: Setup, rng: np.random.Generator) -> Sized:
    """Somebody leans on the table twice, each time for a while and another way: base levelling and pitch step and return."""
    time = (setup.time_s - setup.time_s[0]) / np.ptp(setup.time_s)
    plain, (levelled, pitched) = readings(setup, setup.nominal, {}), rocked(setup)
    added = np.zeros_like(plain)
    for first in rng.uniform((0.0, 0.5), (0.3, 0.8)):
        leaning = ((time >= first) & (time < first + rng.uniform(0.08, 0.2)))[:, None]
        share = rng.normal(size=2)
        added += leaning * (share[0] * levelled + share[1] * pitched)
    return lambda size: plain + size * added


def worn_detents(setup: Setup, rng: np.random.Generator) -> Sized:
    """Every detent of the index has an error of its own, the same at all pitch settings."""
    settings, number = np.unique(np.round(setup.alpha, 6), return_inverse=True)
    off = rng.normal(size=len(settings))[number]
    return lambda size: readings(replace(setup, alpha=setup.alpha + size * off), setup.nominal, {})


def heater_on_one_side(setup: Setup, rng: np.random.Generator) -> Sized:
    """A heater stands beside the head: one bias follows how far the triad is turned to it, at this position and before."""
    time = setup.time_s
    lag = rng.uniform(1.0, 4.0) * np.median(np.diff(np.sort(time)))
    towards = np.maximum(np.cos(setup.alpha - rng.uniform(0, 2 * np.pi)), 0.0)
    share = np.exp(-np.maximum(time[:, None] - time, 0.0) / lag) * (time[:, None] >= time)
    return on_output(setup, rng.integers(3), share @ towards / np.sum(share, axis=1))


# Nothing was tuned on these.
UNSEEN = {
    "iron nearby": iron_nearby,
    "cage of the bearing": cage_of_the_bearing,
    "somebody leans on the table": somebody_leans,
    "worn detents": worn_detents,
    "heater on one side": heater_on_one_side,
}

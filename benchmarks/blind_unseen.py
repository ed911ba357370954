"""More causes that are in no catalogue, written after everything else: on the last five nothing was tuned."""

from dataclasses import replace

import numpy as np

from blind_instrument import Setup, readings
from blind_sized import Sized, direction, inputs, on_output, rocked


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


def knee_in_temperature(setup: Setup, rng: np.random.Generator) -> Sized:
    """One bias follows the temperature above a threshold alone, where something in the package begins to press."""
    warm = setup.temperature_degc
    return on_output(setup, rng.integers(3), np.maximum(warm - np.quantile(warm, rng.uniform(0.3, 0.7)), 0.0))


def converter_ripple(setup: Setup, rng: np.random.Generator) -> Sized:
    """The integral nonlinearity of one converter: a ripple over the output, of two to four periods in a g."""
    axis = rng.integers(3)
    ripple = np.sin(2 * np.pi * rng.uniform(2.0, 4.0) * inputs(setup)[:, axis] + rng.uniform(0, 2 * np.pi))
    return on_output(setup, axis, ripple)


def flank_under_load(setup: Setup, rng: np.random.Generator) -> Sized:
    """The index rests on the flank from which it was approached, and is pressed into it by gravity's torque on the load."""
    torque = np.sin(setup.alpha - rng.uniform(0, 2 * np.pi)) * np.cos(setup.beta)
    off = setup.approach * torque
    return lambda size: readings(replace(setup, alpha=setup.alpha + size * off), setup.nominal, {})


def neighbour_switched_on(setup: Setup, rng: np.random.Generator) -> Sized:
    """Another instrument is switched on for a while: it lifts the bias of one output and the scale factor of another."""
    time = (setup.time_s - setup.time_s[0]) / np.ptp(setup.time_s)
    first = rng.uniform(0.1, 0.6)
    on = (time >= first) & (time < first + rng.uniform(0.2, 0.35))
    biased, scaled = rng.choice(3, 2, replace=False)
    added = np.zeros((len(time), 3))
    added[on, biased] = rng.normal()
    added[on, scaled] = 2.0 * rng.normal() * inputs(setup)[on, scaled]
    return lambda size: readings(setup, setup.nominal, {}) + size * added


def coupling_wears(setup: Setup, rng: np.random.Generator) -> Sized:
    """The index follows a coupling of three jaws, the more the longer it has run."""
    time = (setup.time_s - setup.time_s[0]) / np.ptp(setup.time_s)
    off = time ** rng.uniform(1.0, 2.0) * np.sin(3 * setup.alpha + rng.uniform(0, 2 * np.pi))
    return lambda size: readings(replace(setup, alpha=setup.alpha + size * off), setup.nominal, {})


def magnet_in_one_direction(setup: Setup, rng: np.random.Generator) -> Sized:
    """One output is pulled where the triad points close to a magnet, as one over the cube of the distance."""
    up = inputs(setup) / np.linalg.norm(inputs(setup), axis=1, keepdims=True)
    magnet = up[rng.integers(len(up))] + 0.15 * rng.normal(size=3)
    distance = np.sqrt(0.04 + np.sum((up - magnet) ** 2, axis=1))
    return on_output(setup, rng.integers(3), distance**-3.0)


def two_levels(setup: Setup, rng: np.random.Generator) -> Sized:
    """One bias has two levels, and changes between them three to six times, at any moment (a random telegraph)."""
    changes = np.sort(rng.uniform(setup.time_s[0], setup.time_s[-1], rng.integers(3, 7)))
    return on_output(setup, rng.integers(3), np.searchsorted(changes, setup.time_s) % 2.0)


def head_droops(setup: Setup, rng: np.random.Generator) -> Sized:
    """The load pulls the head down in pitch, and lifts it not: a rectified cosine of the spindle angle."""
    off = np.maximum(np.cos(setup.alpha - rng.uniform(0, 2 * np.pi)), 0.0) * np.cos(setup.beta)
    return lambda size: readings(replace(setup, beta=setup.beta + size * off), setup.nominal, {})


def clamp_settles(setup: Setup, rng: np.random.Generator) -> Sized:
    """After each change of pitch the triad turns about a random axis and comes to rest within some positions."""
    axis, plain, tilt = direction(rng), readings(setup, setup.nominal, {}), 1e-3
    began = np.array([setup.time_s[np.flatnonzero(setup.pitch == own)[0]] for own in setup.pitch])
    turned = readings(setup, setup.nominal | {"dtheta": setup.nominal["dtheta"] + tilt * axis}, {}) - plain
    steps = np.median(np.diff(np.sort(setup.time_s)))
    rest = np.exp(-(setup.time_s - began) / (rng.uniform(1.0, 3.0) * steps))
    return lambda size: plain + size / tilt * rest[:, None] * turned


def scale_saturates_across(setup: Setup, rng: np.random.Generator) -> Sized:
    """The scale factor of one output follows the input of another, and saturates."""
    axis, other = rng.choice(3, 2, replace=False)
    u = inputs(setup)
    return on_output(setup, axis, u[:, axis] * np.tanh(rng.uniform(3.0, 6.0) * (u[:, other] - rng.uniform(-0.4, 0.4))))


# These came after the processes; one curve for three fields, and more that a field may follow, were made with them in mind.
LATEST = {
    "iron nearby": iron_nearby,
    "cage of the bearing": cage_of_the_bearing,
    "somebody leans on the table": somebody_leans,
    "worn detents": worn_detents,
    "heater on one side": heater_on_one_side,
    "knee in temperature": knee_in_temperature,
    "converter ripple": converter_ripple,
    "flank under load": flank_under_load,
    "neighbour switched on": neighbour_switched_on,
    "coupling wears": coupling_wears,
}
# Nothing was tuned on these.
UNSEEN = {
    "magnet in one direction": magnet_in_one_direction,
    "two levels": two_levels,
    "head droops": head_droops,
    "clamp settles": clamp_settles,
    "scale saturates across": scale_saturates_across,
}

"""Causes that are in no catalogue and are no generic term either: bumps, knees, a stick, a creep at some angles only.

Each is a random function of the true angles, the inputs and the time; plain numpy, like the instrument that it acts on.
"""

from dataclasses import replace

import numpy as np

from blind_instrument import Setup, readings
from blind_sized import Sized, bump_at, direction, inputs, on_output, rocked


# Between how many turns of each gear to one of the spindle.
_TEETH = ((2.2, 3.8), (4.2, 6.8))


def bump_of_the_index(setup: Setup, rng: np.random.Generator) -> Sized:
    """The index is off around one angle only: a Gaussian bump."""
    bump = bump_at(setup.alpha, rng.uniform(0, 2 * np.pi), rng.uniform(0.3, 0.8))
    return lambda size: readings(replace(setup, alpha=setup.alpha + size * bump), setup.nominal, {})


def cable_pull(setup: Setup, rng: np.random.Generator) -> Sized:
    """A cable turns the triad about a random axis where it comes taut, the more the higher the pitch."""
    taut = bump_at(setup.alpha, rng.uniform(0, 2 * np.pi), rng.uniform(0.3, 0.8)) * (0.5 + np.sin(setup.beta))
    axis = direction(rng)

    def turned(size: float) -> np.ndarray:
        plain = readings(setup, setup.nominal, {})
        return plain + size * taut[:, None] * np.cross(plain, axis)

    return turned


def knee(setup: Setup, rng: np.random.Generator) -> Sized:
    """The slope of one output changes smoothly at a random input: a saturating tanh."""
    axis, centre, width = rng.integers(3), rng.uniform(-0.7, 0.7), rng.uniform(0.05, 0.25)
    return on_output(setup, axis, np.tanh((inputs(setup)[:, axis] - centre) / width))


def angle_times_time(setup: Setup, rng: np.random.Generator) -> Sized:
    """One output follows the double spindle angle more and more as time goes on."""
    time = setup.time_s / setup.time_s[-1]
    return on_output(setup, rng.integers(3), time * np.sin(2 * setup.alpha - rng.uniform(0, 2 * np.pi)))


def stick_at_one_pitch(setup: Setup, rng: np.random.Generator) -> Sized:
    """At one pitch setting the spindle sticks and stays off for a few positions, then slips back."""
    rows = np.flatnonzero(setup.pitch == rng.choice(setup.pitch))
    length = rng.integers(2, max(3, len(rows) // 2 + 1))
    first = rng.integers(len(rows) - length + 1)
    stuck = np.zeros(len(setup.alpha))
    stuck[rows[first : first + length]] = np.linspace(0.5, 1.0, length)
    return lambda size: readings(replace(setup, alpha=setup.alpha + size * stuck), setup.nominal, {})


def worm_of_the_index(setup: Setup, rng: np.random.Generator) -> Sized:
    """The index follows a worm gear of five to seven turns: a sawtooth."""
    teeth, phase = rng.integers(5, 8), rng.uniform(0, 1)
    saw = (teeth * setup.alpha / (2 * np.pi) + phase) % 1.0 - 0.5
    return lambda size: readings(replace(setup, alpha=setup.alpha + size * saw), setup.nominal, {})


def clamp_gives_way(setup: Setup, rng: np.random.Generator) -> Sized:
    """The triad turns slowly about a random axis in its clamp, and is put right after a third of the time."""
    time, first = setup.time_s / setup.time_s[-1], rng.uniform(0.1, 0.5)
    given = np.where((time > first) & (time < first + 0.35), (time - first) / 0.35, 0.0)
    axis = direction(rng)
    plain = readings(setup, setup.nominal, {})
    return lambda size: plain + size * given[:, None] * np.cross(plain, axis)


def knee_of_another_axis(setup: Setup, rng: np.random.Generator) -> Sized:
    """One output changes smoothly at a random input of another axis."""
    axis, other = rng.choice(3, 2, replace=False)
    centre, width = rng.uniform(-0.7, 0.7), rng.uniform(0.05, 0.25)
    return on_output(setup, int(axis), np.tanh((inputs(setup)[:, other] - centre) / width))


def gust(setup: Setup, rng: np.random.Generator) -> Sized:
    """Two outputs are off for a while."""
    time, when = setup.time_s / setup.time_s[-1], rng.uniform(0.1, 0.9)
    pulse = np.exp(-0.5 * ((time - when) / rng.uniform(0.04, 0.1)) ** 2)
    added = pulse[:, None] * rng.normal(size=3) * (np.arange(3) != rng.integers(3))
    return lambda size: readings(setup, setup.nominal, {}) + size * added


def unbalanced_load(setup: Setup, rng: np.random.Generator) -> Sized:
    """The index leaves one flank of its gear for the other where gravity's torque on the load exceeds the preload."""
    torque = np.sin(setup.alpha - rng.uniform(0, 2 * np.pi)) * np.sin(setup.beta)
    flank = np.tanh((torque - rng.uniform(0.2, 0.7)) / rng.uniform(0.02, 0.1))
    return lambda size: readings(replace(setup, alpha=setup.alpha + size * flank), setup.nominal, {})


def supply_falls(setup: Setup, rng: np.random.Generator) -> Sized:
    """The supply falls for a while, and with it the scale factors of all outputs, each its own share."""
    time, first, length = setup.time_s / setup.time_s[-1], rng.uniform(0.1, 0.6), rng.uniform(0.15, 0.3)
    low = np.clip((time - first) / 0.05, 0, 1) - np.clip((time - first - length) / 0.05, 0, 1)
    plain, share = readings(setup, setup.nominal, {}), rng.uniform(0.3, 1.0, 3)
    return lambda size: plain - size * low[:, None] * share * plain


def pitch_creeps(setup: Setup, rng: np.random.Generator) -> Sized:
    """After every change of pitch the table creeps to its stop, from another distance each time."""
    creep = np.zeros(len(setup.beta))
    for setting in np.unique(setup.pitch):
        rows = np.flatnonzero(setup.pitch == setting)
        rows = rows[np.argsort(setup.time_s[rows], kind="stable")]
        creep[rows] = rng.normal() * np.exp(-np.arange(len(rows)) / rng.uniform(1.0, 3.0))
    return lambda size: readings(replace(setup, beta=setup.beta + size * creep), setup.nominal, {})


def heater_cycles(setup: Setup, rng: np.random.Generator) -> Sized:
    """One bias rises and falls with a heater that is switched on and off three to five times."""
    time = setup.time_s / setup.time_s[-1]
    on = np.sin(2 * np.pi * (rng.uniform(3, 5) * time + rng.uniform(0, 1))) > rng.uniform(-0.3, 0.3)
    return on_output(setup, rng.integers(3), on.astype(float))


def bearing_binds(setup: Setup, rng: np.random.Generator) -> Sized:
    """The triad tilts by a rectified sine of the spindle angle, the more the lower the pitch."""
    tilt = np.abs(np.sin(setup.alpha - rng.uniform(0, 2 * np.pi))) * (0.3 + np.cos(setup.beta))
    axis = direction(rng)
    plain = readings(setup, setup.nominal, {})
    return lambda size: plain + size * tilt[:, None] * np.cross(plain, axis)


def clamped_anew(setup: Setup, rng: np.random.Generator) -> Sized:
    """The clamp holds the triad another way at each pitch setting, and works loose a little within each."""
    turned = np.zeros((len(setup.alpha), 3))
    for setting in np.unique(setup.pitch):
        rows = np.flatnonzero(setup.pitch == setting)
        loose = 1.0 + rng.uniform(0, 0.5) * np.linspace(0, 1, len(rows))
        turned[rows] = loose[:, None] * rng.normal(size=3)
    plain = readings(setup, setup.nominal, {})
    return lambda size: plain + size * np.cross(plain, turned)


def two_gears(setup: Setup, rng: np.random.Generator) -> Sized:
    """The index follows two gears that do not close within a turn."""
    off = sum(
        rng.uniform(0.5, 1.0) * np.sin(rng.uniform(*teeth) * setup.alpha + rng.uniform(0, 2 * np.pi))
        for teeth in _TEETH
    )
    return lambda size: readings(replace(setup, alpha=setup.alpha + size * off), setup.nominal, {})


def touches_on_one_side(setup: Setup, rng: np.random.Generator) -> Sized:
    """All outputs shift, each by its own share, once the triad leans far enough to one side, where something touches."""
    leaning = np.maximum(inputs(setup) @ direction(rng) - rng.uniform(0.0, 0.5), 0.0)
    added = leaning[:, None] * rng.normal(size=3)
    return lambda size: readings(setup, setup.nominal, {}) + size * added


def convection_dies_away(setup: Setup, rng: np.random.Generator) -> Sized:
    """One output follows the direction in which warm air rises, less and less as the box warms through."""
    time = (setup.time_s - setup.time_s[0]) / np.ptp(setup.time_s)
    rising = np.tanh(2.0 * inputs(setup) @ direction(rng)) * np.exp(-time / rng.uniform(0.1, 0.4))
    return on_output(setup, rng.integers(3), rising)


def loose_screw(setup: Setup, rng: np.random.Generator) -> Sized:
    """The triad falls to one side of its play or to the other, as gravity pulls it."""
    side = np.sign(inputs(setup) @ direction(rng) - rng.uniform(-0.2, 0.2))
    axis, plain = direction(rng), readings(setup, setup.nominal, {})
    return lambda size: plain + size * side[:, None] * np.cross(plain, axis)


def cable_winds_up(setup: Setup, rng: np.random.Generator) -> Sized:
    """The triad is turned by a cable that winds up with every turn of the spindle, and is unwound half-way."""
    wound = np.arange(len(setup.alpha)) * np.pi / 4
    wound = np.where(wound > rng.uniform(0.4, 0.6) * wound[-1], wound - wound[-1] / 2, wound)
    axis, plain = direction(rng), readings(setup, setup.nominal, {})
    return lambda size: plain + size * (wound / wound.max())[:, None] ** 2 * np.cross(plain, axis)


def sun_on_the_bench(setup: Setup, rng: np.random.Generator) -> Sized:
    """The bench leans and comes back about both horizontal axes, as the sun goes over it."""
    time = (setup.time_s - setup.time_s[0]) / np.ptp(setup.time_s)
    lean = np.exp(-0.5 * ((time - rng.uniform(0.3, 0.7)) / rng.uniform(0.12, 0.25)) ** 2)
    plain, (levelled, pitched) = readings(setup, setup.nominal, {}), rocked(setup)
    share = rng.normal(size=2)
    return lambda size: plain + size * lean[:, None] * (share[0] * levelled + share[1] * pitched)


def glue_creeps(setup: Setup, rng: np.random.Generator) -> Sized:
    """The triad turns in its glue as gravity has pulled it at this position and those before, which it forgets slowly."""
    time, pull = setup.time_s, inputs(setup) @ direction(rng)
    forgets = rng.uniform(1.5, 5.0) * np.median(np.diff(np.sort(time)))
    crept = np.exp(-np.maximum(time[:, None] - time, 0.0) / forgets) * (time[:, None] >= time) @ pull
    axis, plain = direction(rng), readings(setup, setup.nominal, {})
    return lambda size: plain + size * crept[:, None] * np.cross(plain, axis)


def door_opened(setup: Setup, rng: np.random.Generator) -> Sized:
    """A door is opened: all outputs go off at once, each its own way, and come back slowly."""
    time = (setup.time_s - setup.time_s[0]) / np.ptp(setup.time_s)
    since = time - rng.uniform(0.1, 0.7)
    gone = np.where(since > 0, np.exp(-np.maximum(since, 0.0) / rng.uniform(0.05, 0.2)), 0.0)
    added = gone[:, None] * rng.normal(size=3)
    return lambda size: readings(setup, setup.nominal, {}) + size * added


def pump_beats(setup: Setup, rng: np.random.Generator) -> Sized:
    """A pump's vibration beats with the sampling: one output swings six to ten times in the whole."""
    time = (setup.time_s - setup.time_s[0]) / np.ptp(setup.time_s)
    return on_output(setup, rng.integers(3), np.sin(2 * np.pi * (rng.uniform(6, 10) * time + rng.uniform())))


def wedge_under_a_foot(setup: Setup, rng: np.random.Generator) -> Sized:
    """The head rocks on its four feet: base levelling and pitch are others in each quadrant of the spindle."""
    quadrant = ((setup.alpha - rng.uniform(0, 2 * np.pi)) // (np.pi / 2)).astype(int) % 4
    plain, (levelled, pitched) = readings(setup, setup.nominal, {}), rocked(setup)
    about = rng.normal(size=(4, 2))[quadrant]
    return lambda size: plain + size * (about[:, :1] * levelled + about[:, 1:] * pitched)


def motor_cogs(setup: Setup, rng: np.random.Generator) -> Sized:
    """The index is pulled towards the nearest of three to five detents: a rectified sine of the spindle angle."""
    cog = np.abs(np.sin(rng.integers(3, 6) * (setup.alpha - rng.uniform(0, 2 * np.pi)) / 2))
    return lambda size: readings(replace(setup, alpha=setup.alpha + size * cog), setup.nominal, {})


def spring_bottoms(setup: Setup, rng: np.random.Generator) -> Sized:
    """One output hangs on a spring that bottoms: it is off with the input's part beyond a threshold, on one side alone."""
    axis = rng.integers(3)
    beyond = np.maximum(rng.choice([-1.0, 1.0]) * inputs(setup)[:, axis] - rng.uniform(0.2, 0.7), 0.0)
    return on_output(setup, axis, beyond ** rng.uniform(1.0, 2.0))


UNLISTED = {
    "bump of the index": bump_of_the_index,
    "cable pull": cable_pull,
    "knee of an output": knee,
    "angle times time": angle_times_time,
    "stick at one pitch": stick_at_one_pitch,
}
# These came after the first shapes of `diagnosis/causes/shapes.py`; `diagnosis/lack_of_fit` was then made with them in mind.
LATER = {
    "worm of the index": worm_of_the_index,
    "clamp gives way": clamp_gives_way,
    "knee of another axis": knee_of_another_axis,
    "gust": gust,
    "unbalanced load": unbalanced_load,
    "supply falls": supply_falls,
    "pitch creeps": pitch_creeps,
    "heater cycles": heater_cycles,
    "bearing binds": bearing_binds,
    "clamped anew at each pitch": clamped_anew,
    "two gears": two_gears,
    "touches on one side": touches_on_one_side,
    "convection dies away": convection_dies_away,
    "loose screw": loose_screw,
    "cable winds up": cable_winds_up,
    "sun on the bench": sun_on_the_bench,
    "pump beats": pump_beats,
    "glue creeps": glue_creeps,
    "door opened": door_opened,
    "wedge under a foot": wedge_under_a_foot,
    "motor cogs": motor_cogs,
    "spring bottoms": spring_bottoms,
}


def square_of_another_axis(setup: Setup, rng: np.random.Generator) -> Sized:
    """u_x u_y^2 and its like: an error that belongs to the attitude."""
    i, j = rng.choice(3, 2, replace=False)
    u = inputs(setup)
    return on_output(setup, int(rng.choice([i, j])), u[:, i] * u[:, j] ** 2)

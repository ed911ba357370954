"""Causes that are neither in the catalogue nor generic terms: random functions of angles, inputs and time; plain numpy.

`UNLISTED` to `LATEST` are by the authors and were known while the diagnosis was developed; nothing was tuned on `UNSEEN`.
`INDEPENDENT` is by others, who had read neither the program nor its tests. Nothing was tuned on its second half.
"""

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from blind.acting import (
    TURN,
    Sized,
    bump,
    direction,
    elapsed,
    followed,
    in_triad,
    inputs,
    on_attitude,
    on_index,
    on_output,
    on_outputs,
    on_pitch,
    on_spindle,
    on_table,
    outputs,
    past,
    pitched,
    seen_from,
    some_axes,
    step_s,
)
from blind_instrument import Setup, readings


Cause = Callable[[Setup, np.random.Generator], Sized]
UNLISTED: dict[str, Cause] = {}
LATER: dict[str, Cause] = {}
LATEST: dict[str, Cause] = {}
UNSEEN: dict[str, Cause] = {}
INDEPENDENT: dict[str, Cause] = {}


def of(group: dict[str, Cause]) -> Callable[[Cause], Cause]:
    """Add a cause to a group; its name is that of the function."""

    def added(cause: Cause) -> Cause:
        group[cause.__name__.replace("_", " ")] = cause
        return cause

    return added


def tanh_of(u: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A smooth change at a random input."""
    centre, width = rng.uniform(-0.7, 0.7), rng.uniform(0.05, 0.25)
    return np.tanh((u - centre) / width)


@of(UNLISTED)
def bump_of_the_index(setup, rng):
    return on_index(setup, bump(setup.alpha, rng))


@of(UNLISTED)
def cable_pull(setup, rng):
    """A cable rotates the triad where it comes taut, the more the higher the pitch."""
    taut = bump(setup.alpha, rng) * (0.5 + np.sin(setup.beta))
    return on_attitude(setup, taut[:, None] * direction(rng))


@of(UNLISTED)
def knee_of_an_output(setup, rng):
    axis = rng.integers(3)
    return on_output(setup, axis, tanh_of(inputs(setup)[:, axis], rng))


@of(UNLISTED)
def angle_times_time(setup, rng):
    """One output follows the double spindle angle more and more."""
    time = setup.time_s / setup.time_s[-1]
    return on_output(setup, rng.integers(3), time * np.sin(2 * setup.alpha - rng.uniform(0, TURN)))


@of(UNLISTED)
def stick_at_one_pitch(setup, rng):
    """The spindle sticks for a few positions at one pitch setting, then slips back."""
    rows, stuck = np.flatnonzero(setup.pitch == rng.choice(setup.pitch)), np.zeros(len(setup.alpha))
    length = rng.integers(2, max(3, len(rows) // 2 + 1))
    first = rng.integers(len(rows) - length + 1)
    stuck[rows[first : first + length]] = np.linspace(0.5, 1.0, length)
    return on_index(setup, stuck)


@of(LATER)
def worm_of_the_index(setup, rng):
    """A worm gear of five to seven turns: a sawtooth."""
    return on_index(setup, (rng.integers(5, 8) * setup.alpha / TURN + rng.uniform(0, 1)) % 1.0 - 0.5)


@of(LATER)
def clamp_gives_way(setup, rng):
    """The triad rotates slowly in its clamp for a third of the time, and is put back."""
    time, first = setup.time_s / setup.time_s[-1], rng.uniform(0.1, 0.5)
    given = np.where((time > first) & (time < first + 0.35), (time - first) / 0.35, 0.0)
    return on_attitude(setup, given[:, None] * direction(rng))


@of(LATER)
def knee_of_another_axis(setup, rng):
    axis, other = rng.choice(3, 2, replace=False)
    return on_output(setup, int(axis), tanh_of(inputs(setup)[:, other], rng))


@of(LATER)
def gust(setup, rng):
    """A pulse in time on two outputs."""
    away = setup.time_s / setup.time_s[-1] - rng.uniform(0.1, 0.9)
    pulse = np.exp(-0.5 * (away / rng.uniform(0.04, 0.1)) ** 2)
    return on_outputs(setup, pulse[:, None] * rng.normal(size=3) * (np.arange(3) != rng.integers(3)))


@of(LATER)
def unbalanced_load(setup, rng):
    """The index changes the flank of its gear where gravity's torque exceeds the preload."""
    torque = np.sin(setup.alpha - rng.uniform(0, TURN)) * np.sin(setup.beta)
    return on_index(setup, np.tanh((torque - rng.uniform(0.2, 0.7)) / rng.uniform(0.02, 0.1)))


@of(LATER)
def supply_falls(setup, rng):
    """The supply falls for a while, and with it all scale factors."""
    time, first, length = setup.time_s / setup.time_s[-1], rng.uniform(0.1, 0.6), rng.uniform(0.15, 0.3)
    low = np.clip((time - first) / 0.05, 0, 1) - np.clip((time - first - length) / 0.05, 0, 1)
    return on_outputs(setup, -low[:, None] * rng.uniform(0.3, 1.0, 3) * readings(setup, setup.nominal, {}))


@of(LATER)
def pitch_creeps(setup, rng):
    """After every change of pitch the table creeps to its stop."""
    creep = np.zeros(len(setup.beta))
    for setting in np.unique(setup.pitch):
        rows = np.flatnonzero(setup.pitch == setting)
        creep[rows] = rng.normal() * np.exp(-np.arange(len(rows)) / rng.uniform(1.0, 3.0))
    return on_pitch(setup, creep)


@of(LATER)
def heater_cycles(setup, rng):
    """One bias follows a heater that is switched three to five times."""
    time = setup.time_s / setup.time_s[-1]
    on = np.sin(TURN * (rng.uniform(3, 5) * time + rng.uniform(0, 1))) > rng.uniform(-0.3, 0.3)
    return on_output(setup, rng.integers(3), on.astype(float))


@of(LATER)
def bearing_binds(setup, rng):
    """A rectified sine of the spindle angle, the more the lower the pitch."""
    tilt = np.abs(np.sin(setup.alpha - rng.uniform(0, TURN))) * (0.3 + np.cos(setup.beta))
    return on_attitude(setup, tilt[:, None] * direction(rng))


@of(LATER)
def clamped_anew_at_each_pitch(setup, rng):
    """A different mount at each pitch setting, which works loose a little within each."""
    vectors = np.zeros((len(setup.alpha), 3))
    for setting in np.unique(setup.pitch):
        rows = np.flatnonzero(setup.pitch == setting)
        loose = 1.0 + rng.uniform(0, 0.5) * np.linspace(0, 1, len(rows))
        vectors[rows] = loose[:, None] * rng.normal(size=3)
    return on_attitude(setup, vectors)


@of(LATER)
def two_gears(setup, rng):
    """Two gears that do not close within a turn."""
    return on_index(
        setup,
        sum(
            rng.uniform(0.5, 1.0) * np.sin(rng.uniform(*teeth) * setup.alpha + rng.uniform(0, TURN))
            for teeth in ((2.2, 3.8), (4.2, 6.8))
        ),
    )


@of(LATER)
def touches_on_one_side(setup, rng):
    """All outputs shift if the triad leans far enough to one side."""
    leaning = np.maximum(inputs(setup) @ direction(rng) - rng.uniform(0.0, 0.5), 0.0)
    return on_outputs(setup, leaning[:, None] * rng.normal(size=3))


@of(LATER)
def convection_dies_away(setup, rng):
    """One output follows the direction of rising air, less and less."""
    rising = np.tanh(2.0 * inputs(setup) @ direction(rng)) * np.exp(-elapsed(setup) / rng.uniform(0.1, 0.4))
    return on_output(setup, rng.integers(3), rising)


@of(LATER)
def loose_screw(setup, rng):
    """The triad falls to one side of its play."""
    side = np.sign(inputs(setup) @ direction(rng) - rng.uniform(-0.2, 0.2))
    return on_attitude(setup, side[:, None] * direction(rng))


@of(LATER)
def cable_winds_up(setup, rng):
    """The torque of a cable grows with every turn; it is unwound half-way."""
    wound = np.arange(len(setup.alpha)) * np.pi / 4
    wound = np.where(wound > rng.uniform(0.4, 0.6) * wound[-1], wound - wound[-1] / 2, wound)
    return on_attitude(setup, (wound / wound.max())[:, None] ** 2 * direction(rng))


@of(LATER)
def sun_on_the_bench(setup, rng):
    """The bench leans and comes back."""
    lean = np.exp(-0.5 * ((elapsed(setup) - rng.uniform(0.3, 0.7)) / rng.uniform(0.12, 0.25)) ** 2)
    return on_table(setup, lean * rng.normal(), lean * rng.normal())


@of(LATER)
def pump_beats(setup, rng):
    """Six to ten swings of one output."""
    axis = rng.integers(3)
    return on_output(setup, axis, np.sin(TURN * (rng.uniform(6, 10) * elapsed(setup) + rng.uniform())))


@of(LATER)
def glue_creeps(setup, rng):
    """The triad rotates in its glue as gravity pulled it at this position and those before."""
    pull = inputs(setup) @ direction(rng)
    crept = past(setup, rng.uniform(1.5, 5.0) * step_s(setup)) @ pull
    return on_attitude(setup, crept[:, None] * direction(rng))


@of(LATER)
def door_opened(setup, rng):
    """All outputs jump and come back slowly."""
    since = elapsed(setup) - rng.uniform(0.1, 0.7)
    gone = np.where(since > 0, np.exp(-np.maximum(since, 0.0) / rng.uniform(0.05, 0.2)), 0.0)
    return on_outputs(setup, gone[:, None] * rng.normal(size=3))


@of(LATER)
def wedge_under_a_foot(setup, rng):
    """Base levelling and pitch differ in each quadrant of the spindle."""
    quadrant = ((setup.alpha - rng.uniform(0, TURN)) // (np.pi / 2)).astype(int) % 4
    return on_table(setup, *rng.normal(size=(4, 2))[quadrant].T)


@of(LATER)
def motor_cogs(setup, rng):
    """A pull to the nearest of three to five detents."""
    return on_index(setup, np.abs(np.sin(rng.integers(3, 6) * (setup.alpha - rng.uniform(0, TURN)) / 2)))


@of(LATER)
def spring_bottoms(setup, rng):
    """One output is in error by the part of its input beyond a threshold, on one side only."""
    axis = rng.integers(3)
    beyond = np.maximum(rng.choice([-1.0, 1.0]) * inputs(setup)[:, axis] - rng.uniform(0.2, 0.7), 0.0)
    return on_output(setup, axis, beyond ** rng.uniform(1.0, 2.0))


@of(LATEST)
def iron_nearby(setup, rng):
    """A magnetic part next to the head pulls all outputs as the triad sweeps by."""
    away = 1.4 - np.cos(setup.alpha - rng.uniform(0, TURN)) * np.cos(setup.beta - rng.uniform(0, np.pi / 2))
    return on_outputs(setup, (away ** -rng.uniform(1.5, 3.0))[:, None] * rng.normal(size=3))


@of(LATEST)
def cage_of_the_bearing(setup, rng):
    """The index follows the balls of the bearing, whose cage falls back with every step."""
    cage = rng.uniform(0.36, 0.44) * (setup.alpha + rng.uniform(0.5, 2.0) * np.arange(len(setup.alpha)))
    return on_index(setup, np.sin(rng.integers(2, 5) * cage + rng.uniform(0, TURN)))


@of(LATEST)
def somebody_leans_on_the_table(setup, rng):
    """Twice, each time for a while and in a different direction."""
    time, both = elapsed(setup), np.zeros((2, len(setup.alpha)))
    for first in rng.uniform((0.0, 0.5), (0.3, 0.8)):
        leaning = (time >= first) & (time < first + rng.uniform(0.08, 0.2))
        both += rng.normal(size=(2, 1)) * leaning
    return on_table(setup, *both)


@of(LATEST)
def worn_detents(setup, rng):
    """Every detent of the index has an error, the same at all pitch settings."""
    settings, number = np.unique(np.round(setup.alpha, 6), return_inverse=True)
    return on_index(setup, rng.normal(size=len(settings))[number])


@of(LATEST)
def heater_on_one_side(setup, rng):
    """One bias follows how far the triad was turned to a heater, at this position and before."""
    weights = past(setup, rng.uniform(1.0, 4.0) * step_s(setup))
    towards = np.maximum(np.cos(setup.alpha - rng.uniform(0, TURN)), 0.0)
    return on_output(setup, rng.integers(3), weights @ towards / np.sum(weights, axis=1))


@of(LATEST)
def knee_in_temperature(setup, rng):
    """One bias follows the temperature above a threshold."""
    axis, warm = rng.integers(3), setup.temperature_degc
    return on_output(setup, axis, np.maximum(warm - np.quantile(warm, rng.uniform(0.3, 0.7)), 0.0))


@of(LATEST)
def converter_ripple(setup, rng):
    """A ripple over the output, two to four periods in a g."""
    axis = rng.integers(3)
    return on_output(setup, axis, np.sin(TURN * rng.uniform(2.0, 4.0) * inputs(setup)[:, axis] + rng.uniform(0, TURN)))


@of(LATEST)
def flank_under_load(setup, rng):
    """The index rests on the flank of its approach, into which gravity's torque presses it."""
    return on_index(setup, setup.approach * np.sin(setup.alpha - rng.uniform(0, TURN)) * np.cos(setup.beta))


@of(LATEST)
def neighbour_switched_on(setup, rng):
    """For a while a different bias of one output and scale factor of another."""
    time, first = elapsed(setup), rng.uniform(0.1, 0.6)
    on = (time >= first) & (time < first + rng.uniform(0.2, 0.35))
    biased, scaled = rng.choice(3, 2, replace=False)
    added = np.zeros((len(time), 3))
    added[on, biased], added[on, scaled] = rng.normal(), 2.0 * rng.normal() * inputs(setup)[on, scaled]
    return on_outputs(setup, added)


@of(LATEST)
def coupling_wears(setup, rng):
    """A coupling of three jaws, the more the longer it has run."""
    worn = elapsed(setup) ** rng.uniform(1.0, 2.0)
    return on_index(setup, worn * np.sin(3 * setup.alpha + rng.uniform(0, TURN)))


@of(UNSEEN)
def magnet_in_one_direction(setup, rng):
    """One output is pulled where the triad points close to a magnet."""
    up = inputs(setup) / np.linalg.norm(inputs(setup), axis=1, keepdims=True)
    magnet = up[rng.integers(len(up))] + 0.15 * rng.normal(size=3)
    return on_output(setup, rng.integers(3), np.sqrt(0.04 + np.sum((up - magnet) ** 2, axis=1)) ** -3.0)


@of(UNSEEN)
def two_levels(setup, rng):
    """One bias changes between two levels three to six times."""
    changes = np.sort(rng.uniform(setup.time_s[0], setup.time_s[-1], rng.integers(3, 7)))
    return on_output(setup, rng.integers(3), np.searchsorted(changes, setup.time_s) % 2.0)


@of(UNSEEN)
def head_droops(setup, rng):
    """The load pulls the head down in pitch: a rectified cosine of the spindle angle."""
    return on_pitch(setup, np.maximum(np.cos(setup.alpha - rng.uniform(0, TURN)), 0.0) * np.cos(setup.beta))


@of(UNSEEN)
def clamp_settles(setup, rng):
    """After each change of pitch the triad comes to rest within some positions."""
    began = np.array([setup.time_s[np.flatnonzero(setup.pitch == own)[0]] for own in setup.pitch])
    rest = np.exp(-(setup.time_s - began) / (rng.uniform(1.0, 3.0) * step_s(setup)))
    return on_attitude(setup, rest[:, None] * direction(rng))


@of(UNSEEN)
def scale_saturates_across(setup, rng):
    """The scale factor of one output follows the input of another, and saturates."""
    axis, other = rng.choice(3, 2, replace=False)
    u = inputs(setup)
    return on_output(setup, axis, u[:, axis] * np.tanh(rng.uniform(3.0, 6.0) * (u[:, other] - rng.uniform(-0.4, 0.4))))


@of(INDEPENDENT)
def chip_in_the_face_gear(setup, rng):
    """From some position on a chip between the gears lifts one side of the spindle; every closing flattens it."""
    closed = np.arange(len(setup.alpha)) - rng.integers(3, 16)
    height = np.where(closed >= 0, (1.0 + np.maximum(closed, 0)) ** -rng.uniform(0.2, 0.8), 0.0)
    where = rng.uniform(0, TURN)
    return on_spindle(setup, height[:, None] * [0.0, np.cos(where), np.sin(where)])


@of(INDEPENDENT)
def nearest_hole_of_the_plate(setup, rng):
    """The pin goes into the nearest hole of an index plate whose holes the angles do not divide."""
    wanted = setup.alpha * rng.choice([18, 19, 20, 21, 27, 29, 30, 42, 43, 46, 54, 58]) / TURN + rng.uniform(0, 1)
    return on_index(setup, np.round(wanted) - wanted)


@of(INDEPENDENT)
def pitch_walks_with_every_step(setup, rng):
    """The spindle's drive nudges the pitch table; the nudges add up until the pitch is set again."""
    back, uneven, heavy = rng.uniform(0.0, 0.4), rng.uniform(0.0, 0.8), rng.uniform(0, TURN)
    nudge = setup.approach * (1 + uneven * np.cos(setup.alpha - heavy)) * (1 + rng.uniform(0, 1) * np.sin(setup.beta))
    walked = np.zeros(len(nudge))
    for k in np.flatnonzero(np.diff(setup.pitch) == 0) + 1:
        walked[k] = (1 - back) * walked[k - 1] + nudge[k]
    return on_pitch(setup, walked)


@of(INDEPENDENT)
def bracket_of_two_metals(setup, rng):
    """A bracket twists as it follows, late, the temperature of the room."""
    late = followed(setup, setup.temperature_degc, rng.uniform(60, 900))
    twist = (late - late[0])[:, None] * direction(rng)
    return lambda size: outputs(setup, Rotation.from_rotvec(size * twist).apply(inputs(setup)))


@of(INDEPENDENT)
def rubber_under_the_triad(setup, rng):
    """A pad that is stiffer in one direction yields slowly to the weight of this attitude and the ones before."""
    prompt, mass_at = rng.uniform(0.0, 0.4), direction(rng)
    stiff = Rotation.from_rotvec(rng.uniform(0, np.pi) * direction(rng)).as_matrix()
    compliance, f = stiff @ np.diag(rng.uniform(0.1, 1.0, 3)) @ stiff.T, inputs(setup)
    load = prompt * f + (1 - prompt) * followed(setup, f, rng.uniform(60, 600))
    lean = np.cross(mass_at, load) @ compliance
    return lambda size: outputs(setup, Rotation.from_rotvec(size * lean).apply(f))


@of(INDEPENDENT)
def charge_on_the_dielectric(setup, rng):
    """Charge creeps onto the nearer electrode, leaks away over many minutes and pulls the mass."""
    steep, leak = rng.uniform(0.5, 3.5), rng.uniform(200, 1500)
    drive = np.sinh(steep * inputs(setup)) / np.sinh(steep)
    return on_outputs(setup, followed(setup, drive, leak, empty=True) * some_axes(rng))


@of(INDEPENDENT)
def particle_in_the_cavity(setup, rng):
    """A loose particle rolls from corner to corner with friction, and disturbs the field differently in each."""
    corners, friction = rng.integers(3, 6), rng.uniform(0.15, 0.7)
    angles = TURN * (np.arange(corners) + rng.uniform(-0.2, 0.2, corners)) / corners
    flat = np.stack([np.cos(angles), np.sin(angles), np.zeros(corners)], axis=1)
    # The specific force points up: the lowest corner is the one that it points away from.
    depth = -inputs(setup) @ Rotation.from_rotvec(rng.uniform(0, np.pi) * direction(rng)).apply(flat).T
    disturbs, corner = rng.normal(size=corners)[:, None] * some_axes(rng), [int(np.argmax(depth[0]))]
    for own in depth[1:]:
        lowest = int(np.argmax(own))
        corner.append(lowest if own[lowest] > own[corner[-1]] + friction else corner[-1])
    return on_outputs(setup, disturbs[corner])


@of(INDEPENDENT)
def rail_sags_under_the_outputs(setup, rng):
    """Three ratiometric sensors share a supply that sags with the current of their outputs."""
    v = inputs(setup)
    sourced = np.maximum(v - rng.uniform(-0.3, 0.3, 3), 0) ** rng.uniform(0.8, 1.6)
    sag = sourced @ rng.uniform(0.2, 1.0, 3)
    return on_outputs(setup, -sag[:, None] * (v + rng.uniform(0, 2.0) * rng.uniform(0.7, 1.3, 3)))


@of(INDEPENDENT)
def auto_zero_droops(setup, rng):
    """The amplifiers zero themselves at regular times; in between the voltage droops."""
    period = rng.uniform(170, 800)
    since = np.mod(setup.time_s - setup.time_s[0] + rng.uniform(0, period), period)
    droop = 1 - np.exp(-since / (period * rng.uniform(0.4, 3.0)))
    return on_outputs(setup, droop[:, None] * some_axes(rng))


@of(INDEPENDENT)
def floor_shakes_and_is_rectified(setup, rng):
    """A machine shakes the floor on and off along a slanting line; each sensor rectifies its share."""
    slant, heading = rng.uniform(np.radians(35), np.pi / 2), rng.uniform(0, TURN)
    line = np.array([np.sin(slant) * np.cos(heading), np.sin(slant) * np.sin(heading), np.cos(slant)])
    shaken = in_triad(setup, pitched(setup, np.tile(line, (len(setup.beta), 1))))
    period, quiet, share = rng.uniform(250, 1500), rng.uniform(0.0, 0.6), rng.uniform(0.3, 0.7)
    on = np.mod((setup.time_s - setup.time_s[0]) / period + rng.uniform(), 1.0) < share
    loaded = shaken**2 * (1 + rng.uniform(-0.8, 0.8) * inputs(setup))
    return on_outputs(setup, np.where(on, 1.0, quiet)[:, None] * loaded * some_axes(rng))


@of(INDEPENDENT)
def spindle_climbs_its_bearing(setup, rng):
    """The loaded spindle climbs the wall of the side from which it was turned; part of an earlier climb remains."""
    steep, kept, up = rng.uniform(0.5, 1.5), rng.uniform(0.0, 0.5), rng.uniform(-0.6, 0.6)
    climb, state = [], 0.0
    for load, side in zip(np.abs(np.cos(setup.beta)) ** steep, setup.approach, strict=True):
        state = load * (kept * np.clip(state, -1, 1) + (1 - kept) * side)
        climb.append((0.0, up * abs(state), state))
    return on_spindle(setup, np.array(climb))


@of(INDEPENDENT)
def bearing_opens_as_it_warms(setup, rng):
    """Above some temperature the spindle hangs down in its clearance and is thrown to its heavy side."""
    late = followed(setup, setup.temperature_degc, rng.uniform(100, 700))
    open_by = np.maximum(late - np.quantile(late, rng.uniform(0.1, 0.55)), 0)
    hangs, thrown, heavy = rng.uniform(0, 0.7), rng.uniform(0.4, 1.0), rng.uniform(0, TURN)
    about_y = hangs * np.cos(setup.beta) + thrown * np.cos(setup.alpha - heavy)
    about_z = thrown * np.sin(setup.alpha - heavy)
    return on_spindle(setup, open_by[:, None] * np.stack([np.zeros(len(late)), about_y, about_z], axis=1))


@of(INDEPENDENT)
def plate_turns_on_its_dowel(setup, rng):
    """The plate under the triad turns to one end of its clearance if the weight exceeds friction."""
    f, least = inputs(setup), 0.0
    while least <= 0.3:
        # A plate that is pushed to one side only would be a mount that slips.
        normal = direction(rng)
        lever = np.cross(normal, direction(rng))
        torque = f @ (lever / np.linalg.norm(lever))
        least = min(torque.max(), -torque.min())
    friction, share = rng.uniform(0.3, 0.85) * least, rng.uniform(0.5, 1.0)
    turns, state = [], rng.uniform(-1, 1)
    for own in torque:
        state += share * (np.sign(own) - state) * (np.abs(own) > friction)
        turns.append(state)
    vectors = np.array(turns)[:, None] * normal
    return lambda size: outputs(setup, Rotation.from_rotvec(size * vectors).apply(f))


@of(INDEPENDENT)
def mass_clings_to_its_stop(setup, rng):
    """A proof mass that came near its stop clings to it until the input pulls it away."""
    v, weights = inputs(setup), some_axes(rng)
    added = np.zeros(v.shape)
    for i in np.flatnonzero(weights):
        side = rng.choice([-1.0, 1.0])
        catches = rng.uniform(0.45, 0.75) * np.max(side * v[:, i])
        frees, gain, clings = catches - rng.uniform(0.4, 1.1), rng.uniform(0.0, 0.8), False
        for k, own in enumerate(side * v[:, i]):
            clings = own > catches or (clings and own > frees)
            added[k, i] = weights[i] * clings * (1 - gain * own)
    return on_outputs(setup, added)


@of(INDEPENDENT)
def bits_weigh_wrong(setup, rng):
    """The upper bits of a successive-approximation converter have errors."""
    v, weights, bits, full = inputs(setup), some_axes(rng), rng.integers(3, 6), rng.uniform(1.3, 2.6)
    added = np.zeros(v.shape)
    for i in np.flatnonzero(weights):
        place = np.clip((v[:, i] - rng.uniform(-0.15, 0.15) + full) / (2 * full), 0, 1 - 1e-9)
        code = np.floor(place * 2**bits).astype(int)
        for bit in range(bits):
            # Matching is worse, absolutely, in a larger capacitor: as the root of its area.
            added[:, i] += weights[i] * rng.normal() * 2 ** (bit / 2) * ((code >> bit) & 1)
    return on_outputs(setup, added)


@of(INDEPENDENT)
def slip_ring_is_sooty(setup, rng):
    """In one sector of the slip ring the supply is lower; every round polishes the sector, or soils it more."""
    sector = bump(setup.alpha, rng, 0.35, 0.9)
    rounds = setup.pitch * rng.choice([1.0, -1.0]) * rng.uniform(0.1, 0.7) * 3 / (setup.pitch.max() + 1)
    zero, takes = rng.uniform(-1.0, 1.0, 3), rng.uniform(0.6, 1.2, 3)
    return on_outputs(setup, -(sector * np.exp(-rounds))[:, None] * takes * (inputs(setup) + zero))


@of(INDEPENDENT)
def stale_compensation(setup, rng):
    """The chip compensates its temperature, but only in coarse steps."""
    felt = followed(setup, setup.temperature_degc, rng.uniform(5, 120))
    step, rest = rng.uniform(0.2, 0.5) * np.ptp(felt), []
    used = felt[0] - rng.uniform(-0.5, 0.5) * step
    for own in felt:
        used = own if np.abs(own - used) >= step else used
        rest.append(own - used)
    zero, gain = some_axes(rng), rng.uniform(-0.8, 0.8, 3)
    return on_outputs(setup, np.array(rest)[:, None] * zero * (1 + gain * inputs(setup)))


@of(INDEPENDENT)
def air_table_levels_itself(setup, rng):
    """The table sinks to one corner until a valve lifts it back; a change of pitch tips it too."""
    heading, period, overshoot = rng.uniform(0, TURN), rng.uniform(300, 1100), rng.uniform(0.0, 0.6)
    moved, low, tilt = rng.uniform(-0.7, 0.7), rng.uniform(-0.5, 0.9), []
    sunk = np.append(0.0, (1 + overshoot) * np.diff(setup.time_s) / period + moved * np.diff(np.sin(setup.beta)))
    for own in sunk:
        low += own
        while low > 1:
            low -= 1 + overshoot
        low = max(low, -1.0)
        tilt.append(low)
    tip, up = np.outer(tilt, [np.cos(heading), np.sin(heading), 0.0]), np.array([0.0, 0.0, 1.0])
    return lambda size: seen_from(setup, pitched(setup, Rotation.from_rotvec(size * tip).apply(up)))


@of(INDEPENDENT)
def chimney_of_the_board(setup, rng):
    """Zeros and scale factors follow, by some minutes, the warmth of the attitude."""
    normal, chimney, down, f = direction(rng), rng.uniform(0.4, 1.2), rng.uniform(0.1, 0.5), inputs(setup)
    lying = np.clip(f @ normal, -1, 1)
    cooled = 1 + chimney * (1 - lying**2) ** 0.25 - down * np.maximum(-lying, 0)
    warm = followed(setup, 1 / cooled, rng.uniform(40, 400))
    return on_outputs(setup, (warm - warm[0])[:, None] * (some_axes(rng) + rng.uniform(-0.5, 0.5, 3) * f))


@of(INDEPENDENT)
def two_operators_take_turns(setup, rng):
    """One of two people reads the vernier with parallax, more so at a high pitch, and stops short of it."""
    leans, short, pitch = rng.choice([-1.0, 1.0]), rng.uniform(-0.6, 0.6), rng.uniform(-0.4, 0.6)
    lengths = rng.integers(2, 8, len(setup.alpha))
    his = (np.repeat(np.arange(len(lengths)), lengths)[: len(setup.alpha)] + rng.integers(2)) % 2
    return on_index(setup, his * (leans + short * setup.approach + leans * pitch * np.sin(setup.beta)))


def square_of_another_axis(setup, rng):
    """u_x u_y^2 and similar products: an error of the attitude."""
    i, j = rng.choice(3, 2, replace=False)
    u = inputs(setup)
    return on_output(setup, int(rng.choice([i, j])), u[:, i] * u[:, j] ** 2)

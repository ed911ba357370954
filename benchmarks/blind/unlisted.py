"""Causes that are neither in the catalogue nor generic terms: random functions of angles, inputs and time; plain numpy.

`UNLISTED` to `LATEST` are by the authors and were known while the diagnosis was developed; nothing was tuned on `UNSEEN`.
`INDEPENDENT` is by others, who had read neither the program nor its tests. Nothing was tuned on its second half.
A cause is the place at which it acts (`blind/acting.py`), and its shape over the positions of a scene.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from blind import acting
from blind.acting import TURN, Cause, Scene


Shape = Callable[[Scene], Any]
Group = dict[str, Cause]


def cause(acts: str, shape: Shape) -> Cause:
    """The cause of a shape; `acts`: a function of `blind/acting.py`."""
    place = getattr(acting, acts.replace(" ", "_"))
    return lambda setup, rng: place(scene := Scene(setup, rng), shape(scene))


def group(listed: dict[str, tuple[str, Shape]]) -> Group:
    """Causes by their names."""
    return {name: cause(*own) for name, own in listed.items()}


def given(value: Any, shape: Callable[[Any], Any]) -> Any:
    """A shape of a value that is drawn once and used twice."""
    return shape(value)


def of(causes: Group, acts: str) -> Callable[[Shape], Shape]:
    """Add a shape that needs more than a line; its name is that of the function."""

    def added(shape: Shape) -> Shape:
        causes[shape.__name__.replace("_", " ")] = cause(acts, shape)
        return shape

    return added


UNLISTED = group({
    "bump of the index": ("index", lambda s: s.bump()),
    # A cable comes taut, the more the higher the pitch.
    "cable pull": ("tilt", lambda s: s.bump() * (0.5 + np.sin(s.beta))),
    "knee of an output": ("output", lambda s: (axis := s.axis(), s.knee(s.u[:, axis]))),
    "angle times time": ("output", lambda s: (s.axis(), s.share * np.sin(2 * s.alpha - s.phase()))),
})  # fmt: skip
LATER = group({
    # A worm gear of five to seven turns: a sawtooth.
    "worm of the index": ("index", lambda s: (s.rng.integers(5, 8) * s.alpha / TURN + s.between(0, 1)) % 1.0 - 0.5),
    "knee of another axis": ("output", lambda s: ((axes := s.two())[0], s.knee(s.u[:, axes[1]]))),
    # A rectified sine of the spindle angle, the more the lower the pitch.
    "bearing binds": ("tilt", lambda s: np.abs(np.sin(s.alpha - s.phase())) * (0.3 + np.cos(s.beta))),
    # Two gears that do not close within a turn.
    "two gears": ("index", lambda s: sum(
        s.between(0.5, 1.0) * np.sin(s.between(*teeth) * s.alpha + s.phase()) for teeth in ((2.2, 3.8), (4.2, 6.8))
    )),
    # All outputs shift if the triad leans far enough to one side.
    "touches on one side": ("outputs", lambda s: (
        np.maximum(s.u @ s.vector() - s.between(0.0, 0.5), 0.0)[:, None] * s.normal(size=3)
    )),
    # One output follows the direction of rising air, less and less.
    "convection dies away": ("any output", lambda s: np.tanh(2.0 * s.u @ s.vector()) * np.exp(-s.of / s.between(0.1, 0.4))),
    # The triad falls to one side of its play.
    "loose screw": ("tilt", lambda s: np.sign(s.u @ s.vector() - s.between(-0.2, 0.2))),
    # Six to ten swings.
    "pump beats": ("output", lambda s: (s.axis(), np.sin(TURN * (s.between(6, 10) * s.of + s.between())))),
    # Base levelling and pitch differ in each quadrant of the spindle.
    "wedge under a foot": ("table", lambda s: given(
        ((s.alpha - s.phase()) // (np.pi / 2)).astype(int) % 4, lambda quadrant: s.normal(size=(4, 2))[quadrant].T
    )),
    # A pull to the nearest of three to five detents.
    "motor cogs": ("index", lambda s: np.abs(np.sin(s.rng.integers(3, 6) * (s.alpha - s.phase()) / 2))),
    # A pulse in time on two outputs.
    "gust": ("outputs", lambda s: (
        np.exp(-0.5 * ((s.share - s.between(0.1, 0.9)) / s.between(0.04, 0.1)) ** 2)[:, None]
        * s.normal(size=3) * (np.arange(3) != s.rng.integers(3))
    )),
    # The index changes the flank of its gear where gravity's torque exceeds the preload.
    "unbalanced load": ("index", lambda s: np.tanh(
        (np.sin(s.alpha - s.phase()) * np.sin(s.beta) - s.between(0.2, 0.7)) / s.between(0.02, 0.1)
    )),
    # One bias follows a heater that is switched three to five times.
    "heater cycles": ("any output", lambda s: (
        np.sin(TURN * (s.between(3, 5) * s.share + s.between(0, 1))) > s.between(-0.3, 0.3)
    ).astype(float)),
    # The triad rotates in its glue as gravity pulled it at this position and those before.
    "glue creeps": ("tilt", lambda s: given(s.u @ s.vector(), lambda pull: s.past(1.5, 5.0) @ pull)),
    # One output is in error by the part of its input beyond a threshold, on one side only.
    "spring bottoms": ("output", lambda s: (
        axis := s.axis(),
        np.maximum(s.rng.choice([-1.0, 1.0]) * s.u[:, axis] - s.between(0.2, 0.7), 0.0) ** s.between(1.0, 2.0),
    )),
})  # fmt: skip
LATEST = group({
    # One bias follows the temperature above a threshold.
    "knee in temperature": ("output", lambda s: (
        s.axis(), np.maximum(s.degc - np.quantile(s.degc, s.between(0.3, 0.7)), 0.0)
    )),
    # A ripple over the output, two to four periods in a g.
    "converter ripple": ("output", lambda s: (
        axis := s.axis(), np.sin(TURN * s.between(2.0, 4.0) * s.u[:, axis] + s.phase())
    )),
    # The index rests on the flank of its approach, into which gravity's torque presses it.
    "flank under load": ("index", lambda s: s.side * np.sin(s.alpha - s.phase()) * np.cos(s.beta)),
    # A coupling of three jaws, the more the longer it has run.
    "coupling wears": ("index", lambda s: s.of ** s.between(1.0, 2.0) * np.sin(3 * s.alpha + s.phase())),
    # A magnetic part next to the head pulls all outputs as the triad sweeps by.
    "iron nearby": ("outputs", lambda s: (
        (1.4 - np.cos(s.alpha - s.phase()) * np.cos(s.beta - s.between(0, np.pi / 2))) ** -s.between(1.5, 3.0)
    )[:, None] * s.normal(size=3)),
    # The index follows the balls of the bearing, whose cage falls back with every step.
    "cage of the bearing": ("index", lambda s: given(
        s.between(0.36, 0.44) * (s.alpha + s.between(0.5, 2.0) * np.arange(s.count)),
        lambda cage: np.sin(s.rng.integers(2, 5) * cage + s.phase()),
    )),
    # One bias follows how far the triad was turned to a heater, at this position and before.
    "heater on one side": ("any output", lambda s: given(
        s.past(1.0, 4.0), lambda past: past @ np.maximum(np.cos(s.alpha - s.phase()), 0.0) / np.sum(past, axis=1)
    )),
    # Every detent of the index has an error, the same at all pitch settings.
    "worn detents": ("index", lambda s: given(
        np.unique(np.round(s.alpha, 6), return_inverse=True), lambda own: s.normal(size=len(own[0]))[own[1]]
    )),
})  # fmt: skip
UNSEEN = group({
    # The load pulls the head down in pitch.
    "head droops": ("pitch", lambda s: np.maximum(np.cos(s.alpha - s.phase()), 0.0) * np.cos(s.beta)),
    # One bias changes between two levels three to six times.
    "two levels": ("any output", lambda s: np.searchsorted(
        np.sort(s.between(s.setup.time_s[0], s.setup.time_s[-1], s.rng.integers(3, 7))), s.setup.time_s
    ) % 2.0),
    # The scale factor of one output follows the input of another, and saturates.
    "scale saturates across": ("output", lambda s: (
        (axes := s.two())[0],
        s.u[:, axes[0]] * np.tanh(s.between(3.0, 6.0) * (s.u[:, axes[1]] - s.between(-0.4, 0.4))),
    )),
    # After each change of pitch the triad comes to rest within some positions.
    "clamp settles": ("tilt", lambda s: np.exp(
        -(s.time_s - np.array([s.time_s[s.pitch == own][0] for own in s.pitch])) / (s.between(1.0, 3.0) * s.step_s)
    )),
})  # fmt: skip
INDEPENDENT = group({
    # The pin goes into the nearest hole of an index plate whose holes the angles do not divide.
    "nearest hole of the plate": ("index", lambda s: given(
        s.alpha * s.rng.choice([18, 19, 20, 21, 27, 29, 30, 42, 43, 46, 54, 58]) / TURN + s.between(0, 1),
        lambda wanted: np.round(wanted) - wanted,
    )),
    # A bracket twists as it follows, late, the temperature of the room.
    "bracket of two metals": ("turns", lambda s: given(
        s.late(s.degc, s.between(60, 900)), lambda late: (late - late[0])[:, None] * s.vector()
    )),
    # Three ratiometric sensors share a supply that sags with the current of their outputs.
    "rail sags under the outputs": ("outputs", lambda s: -(
        np.maximum(s.u - s.between(-0.3, 0.3, 3), 0) ** s.between(0.8, 1.6) @ s.between(0.2, 1.0, 3)
    )[:, None] * (s.u + s.between(0, 2.0) * s.between(0.7, 1.3, 3))),
    # The amplifiers zero themselves at regular times; in between the voltage droops.
    "auto zero droops": ("outputs", lambda s: given(s.between(170, 800), lambda period: (
        1 - np.exp(-np.mod(s.time_s + s.between(0, period), period) / (period * s.between(0.4, 3.0)))
    )[:, None] * s.axes())),
    # Charge creeps onto the nearer electrode, leaks away over many minutes and pulls the mass.
    "charge on the dielectric": ("outputs", lambda s: given(
        s.between(0.5, 3.5),
        lambda steep: s.late(np.sinh(steep * s.u) / np.sinh(steep), s.between(200, 1500), empty=True) * s.axes(),
    )),
})  # fmt: skip


@of(UNLISTED, "index")
def stick_at_one_pitch(s):
    """The spindle sticks for a few positions at one pitch setting, then slips back."""
    rows, stuck = np.flatnonzero(s.pitch == s.rng.choice(s.pitch)), np.zeros(s.count)
    length = s.rng.integers(2, max(3, len(rows) // 2 + 1))
    first = s.rng.integers(len(rows) - length + 1)
    stuck[rows[first : first + length]] = np.linspace(0.5, 1.0, length)
    return stuck


@of(LATER, "tilt")
def clamp_gives_way(s):
    """The triad rotates slowly in its clamp for a third of the time, and is put back."""
    first = s.between(0.1, 0.5)
    return np.where((s.share > first) & (s.share < first + 0.35), (s.share - first) / 0.35, 0.0)


@of(LATER, "outputs")
def supply_falls(s):
    """The supply falls for a while, and with it all scale factors."""
    first, length = s.between(0.1, 0.6), s.between(0.15, 0.3)
    low = np.clip((s.share - first) / 0.05, 0, 1) - np.clip((s.share - first - length) / 0.05, 0, 1)
    return -low[:, None] * s.between(0.3, 1.0, 3) * s.plain


@of(LATER, "pitch")
def pitch_creeps(s):
    """After every change of pitch the table creeps to its stop."""
    creep = np.zeros(s.count)
    for rows in s.settings:
        creep[rows] = s.normal() * np.exp(-np.arange(len(rows)) / s.between(1.0, 3.0))
    return creep


@of(LATER, "attitude")
def clamped_anew_at_each_pitch(s):
    """A different mount at each pitch setting, which works loose a little within each."""
    vectors = np.zeros((s.count, 3))
    for rows in s.settings:
        loose = 1.0 + s.between(0, 0.5) * np.linspace(0, 1, len(rows))
        vectors[rows] = loose[:, None] * s.normal(size=3)
    return vectors


@of(LATER, "tilt")
def cable_winds_up(s):
    """The torque of a cable grows with every turn; it is unwound half-way."""
    wound = np.arange(s.count) * np.pi / 4
    wound = np.where(wound > s.between(0.4, 0.6) * wound[-1], wound - wound[-1] / 2, wound)
    return (wound / wound.max()) ** 2


@of(LATER, "table")
def sun_on_the_bench(s):
    """The bench leans and comes back."""
    lean = np.exp(-0.5 * ((s.of - s.between(0.3, 0.7)) / s.between(0.12, 0.25)) ** 2)
    return lean * s.normal(), lean * s.normal()


@of(LATER, "outputs")
def door_opened(s):
    """All outputs jump and come back slowly."""
    since = s.of - s.between(0.1, 0.7)
    gone = np.where(since > 0, np.exp(-np.maximum(since, 0.0) / s.between(0.05, 0.2)), 0.0)
    return gone[:, None] * s.normal(size=3)


@of(LATEST, "table")
def somebody_leans_on_the_table(s):
    """Twice, each time for a while and in a different direction."""
    both = np.zeros((2, s.count))
    for first in s.between((0.0, 0.5), (0.3, 0.8)):
        leaning = (s.of >= first) & (s.of < first + s.between(0.08, 0.2))
        both += s.normal(size=(2, 1)) * leaning
    return both


@of(LATEST, "outputs")
def neighbour_switched_on(s):
    """For a while a different bias of one output and scale factor of another."""
    first = s.between(0.1, 0.6)
    on = (s.of >= first) & (s.of < first + s.between(0.2, 0.35))
    (biased, scaled), added = s.two(), np.zeros((s.count, 3))
    added[on, biased], added[on, scaled] = s.normal(), 2.0 * s.normal() * s.u[on, scaled]
    return added


@of(UNSEEN, "any output")
def magnet_in_one_direction(s):
    """One output is pulled where the triad points close to a magnet."""
    up = s.u / np.linalg.norm(s.u, axis=1, keepdims=True)
    magnet = up[s.rng.integers(len(up))] + 0.15 * s.normal(size=3)
    return np.sqrt(0.04 + np.sum((up - magnet) ** 2, axis=1)) ** -3.0


@of(INDEPENDENT, "spindle")
def chip_in_the_face_gear(s):
    """From some position on a chip between the gears lifts one side of the spindle; every closing flattens it."""
    closed = np.arange(s.count) - s.rng.integers(3, 16)
    height = np.where(closed >= 0, (1.0 + np.maximum(closed, 0)) ** -s.between(0.2, 0.8), 0.0)
    where = s.phase()
    return height[:, None] * [0.0, np.cos(where), np.sin(where)]


@of(INDEPENDENT, "pitch")
def pitch_walks_with_every_step(s):
    """The spindle's drive nudges the pitch table; the nudges add up until the pitch is set again."""
    back, uneven, heavy = s.between(0.0, 0.4), s.between(0.0, 0.8), s.phase()
    nudge = s.side * (1 + uneven * np.cos(s.alpha - heavy)) * (1 + s.between(0, 1) * np.sin(s.beta))
    walked = np.zeros(s.count)
    for k in np.flatnonzero(np.diff(s.pitch) == 0) + 1:
        walked[k] = (1 - back) * walked[k - 1] + nudge[k]
    return walked


@of(INDEPENDENT, "turns")
def rubber_under_the_triad(s):
    """A pad that is stiffer in one direction yields slowly to the weight of this attitude and the ones before."""
    prompt, mass_at = s.between(0.0, 0.4), s.vector()
    stiff = Rotation.from_rotvec(s.between(0, np.pi) * s.vector()).as_matrix()
    compliance = stiff @ np.diag(s.between(0.1, 1.0, 3)) @ stiff.T
    return np.cross(mass_at, prompt * s.u + (1 - prompt) * s.late(s.u, s.between(60, 600))) @ compliance


@of(INDEPENDENT, "outputs")
def particle_in_the_cavity(s):
    """A loose particle rolls from corner to corner with friction, and disturbs the field differently in each."""
    corners, friction = s.rng.integers(3, 6), s.between(0.15, 0.7)
    angles = TURN * (np.arange(corners) + s.between(-0.2, 0.2, corners)) / corners
    flat = np.stack([np.cos(angles), np.sin(angles), np.zeros(corners)], axis=1)
    # The specific force points up: the lowest corner is the one that it points away from.
    depth = -s.u @ Rotation.from_rotvec(s.between(0, np.pi) * s.vector()).apply(flat).T
    disturbs, corner = s.normal(size=corners)[:, None] * s.axes(), [int(np.argmax(depth[0]))]
    for own in depth[1:]:
        lowest = int(np.argmax(own))
        corner.append(lowest if own[lowest] > own[corner[-1]] + friction else corner[-1])
    return disturbs[corner]


@of(INDEPENDENT, "outputs")
def floor_shakes_and_is_rectified(s):
    """A machine shakes the floor on and off along a slanting line; each sensor rectifies its share."""
    slant, heading = s.between(np.radians(35), np.pi / 2), s.phase()
    line = np.array([np.sin(slant) * np.cos(heading), np.sin(slant) * np.sin(heading), np.cos(slant)])
    shaken = s.in_triad(s.pitched(np.tile(line, (s.count, 1))))
    period, quiet, share = s.between(250, 1500), s.between(0.0, 0.6), s.between(0.3, 0.7)
    on = np.mod(s.time_s / period + s.between(), 1.0) < share
    return np.where(on, 1.0, quiet)[:, None] * shaken**2 * (1 + s.between(-0.8, 0.8) * s.u) * s.axes()


@of(INDEPENDENT, "spindle")
def spindle_climbs_its_bearing(s):
    """The loaded spindle climbs the wall of the side from which it was turned; part of an earlier climb remains."""
    steep, kept, up = s.between(0.5, 1.5), s.between(0.0, 0.5), s.between(-0.6, 0.6)
    climb, state = [], 0.0
    for load, side in zip(np.abs(np.cos(s.beta)) ** steep, s.side, strict=True):
        state = load * (kept * np.clip(state, -1, 1) + (1 - kept) * side)
        climb.append((0.0, up * abs(state), state))
    return np.array(climb)


@of(INDEPENDENT, "spindle")
def bearing_opens_as_it_warms(s):
    """Above some temperature the spindle hangs down in its clearance and is thrown to its heavy side."""
    late = s.late(s.degc, s.between(100, 700))
    open_by = np.maximum(late - np.quantile(late, s.between(0.1, 0.55)), 0)
    hangs, thrown, heavy = s.between(0, 0.7), s.between(0.4, 1.0), s.phase()
    about_y = hangs * np.cos(s.beta) + thrown * np.cos(s.alpha - heavy)
    return open_by[:, None] * np.stack([np.zeros(s.count), about_y, thrown * np.sin(s.alpha - heavy)], axis=1)


@of(INDEPENDENT, "turns")
def plate_turns_on_its_dowel(s):
    """The plate under the triad turns to one end of its clearance if the weight exceeds friction."""
    least = 0.0
    while least <= 0.3:
        # A plate that is pushed to one side only would be a mount that slips.
        normal = s.vector()
        lever = np.cross(normal, s.vector())
        torque = s.u @ (lever / np.linalg.norm(lever))
        least = min(torque.max(), -torque.min())
    friction, share = s.between(0.3, 0.85) * least, s.between(0.5, 1.0)
    turns, state = [], s.between(-1, 1)
    for own in torque:
        state += share * (np.sign(own) - state) * (np.abs(own) > friction)
        turns.append(state)
    return np.array(turns)[:, None] * normal


@of(INDEPENDENT, "outputs")
def mass_clings_to_its_stop(s):
    """A proof mass that came near its stop clings to it until the input pulls it away."""
    weights, added = s.axes(), np.zeros(s.u.shape)
    for i in np.flatnonzero(weights):
        side = s.rng.choice([-1.0, 1.0])
        catches = s.between(0.45, 0.75) * np.max(side * s.u[:, i])
        frees, gain, clings = catches - s.between(0.4, 1.1), s.between(0.0, 0.8), False
        for k, own in enumerate(side * s.u[:, i]):
            clings = own > catches or (clings and own > frees)
            added[k, i] = weights[i] * clings * (1 - gain * own)
    return added


@of(INDEPENDENT, "outputs")
def bits_weigh_wrong(s):
    """The upper bits of a successive-approximation converter have errors."""
    weights, bits, full = s.axes(), s.rng.integers(3, 6), s.between(1.3, 2.6)
    added = np.zeros(s.u.shape)
    for i in np.flatnonzero(weights):
        place = np.clip((s.u[:, i] - s.between(-0.15, 0.15) + full) / (2 * full), 0, 1 - 1e-9)
        code = np.floor(place * 2**bits).astype(int)
        for bit in range(bits):
            # Matching is worse, absolutely, in a larger capacitor: as the root of its area.
            added[:, i] += weights[i] * s.normal() * 2 ** (bit / 2) * ((code >> bit) & 1)
    return added


@of(INDEPENDENT, "outputs")
def slip_ring_is_sooty(s):
    """In one sector of the slip ring the supply is lower; every round polishes the sector, or soils it more."""
    sector = s.bump(0.35, 0.9)
    rounds = s.pitch * s.rng.choice([1.0, -1.0]) * s.between(0.1, 0.7) * 3 / (s.pitch.max() + 1)
    zero, takes = s.between(-1.0, 1.0, 3), s.between(0.6, 1.2, 3)
    return -(sector * np.exp(-rounds))[:, None] * takes * (s.u + zero)


@of(INDEPENDENT, "outputs")
def stale_compensation(s):
    """The chip compensates its temperature, but only in coarse steps."""
    felt = s.late(s.degc, s.between(5, 120))
    step, rest = s.between(0.2, 0.5) * np.ptp(felt), []
    used = felt[0] - s.between(-0.5, 0.5) * step
    for own in felt:
        used = own if np.abs(own - used) >= step else used
        rest.append(own - used)
    return np.array(rest)[:, None] * s.axes() * (1 + s.between(-0.8, 0.8, 3) * s.u)


@of(INDEPENDENT, "level")
def air_table_levels_itself(s):
    """The table sinks to one corner until a valve lifts it back; a change of pitch tips it too."""
    heading, period, overshoot = s.phase(), s.between(300, 1100), s.between(0.0, 0.6)
    moved, low, tilt = s.between(-0.7, 0.7), s.between(-0.5, 0.9), []
    sunk = np.append(0.0, (1 + overshoot) * np.diff(s.setup.time_s) / period + moved * np.diff(np.sin(s.beta)))
    for own in sunk:
        low += own
        while low > 1:
            low -= 1 + overshoot
        low = max(low, -1.0)
        tilt.append(low)
    return np.outer(tilt, [np.cos(heading), np.sin(heading), 0.0])


@of(INDEPENDENT, "outputs")
def chimney_of_the_board(s):
    """Zeros and scale factors follow, by some minutes, the warmth of the attitude."""
    normal, chimney, down = s.vector(), s.between(0.4, 1.2), s.between(0.1, 0.5)
    lying = np.clip(s.u @ normal, -1, 1)
    cooled = 1 + chimney * (1 - lying**2) ** 0.25 - down * np.maximum(-lying, 0)
    warm = s.late(1 / cooled, s.between(40, 400))
    return (warm - warm[0])[:, None] * (s.axes() + s.between(-0.5, 0.5, 3) * s.u)


@of(INDEPENDENT, "index")
def two_operators_take_turns(s):
    """One of two people reads the vernier with parallax, more so at a high pitch, and stops short of it."""
    leans, short, pitch = s.rng.choice([-1.0, 1.0]), s.between(-0.6, 0.6), s.between(-0.4, 0.6)
    lengths = s.rng.integers(2, 8, s.count)
    his = (np.repeat(np.arange(len(lengths)), lengths)[: s.count] + s.rng.integers(2)) % 2
    return his * (leans + short * s.side + leans * pitch * np.sin(s.beta))


def _square_of_another_axis(s):
    """u_x u_y^2 and similar products: an error of the attitude."""
    i, j = s.two()
    return int(s.rng.choice([i, j])), s.u[:, i] * s.u[:, j] ** 2


square_of_another_axis = cause("output", _square_of_another_axis)

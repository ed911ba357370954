"""Causes that are neither in the catalogue nor generic terms: random functions of angles, inputs and time; plain numpy.

`UNLISTED` to `LATEST` are by the authors and were known while the diagnosis was developed; nothing was tuned on `UNSEEN`.
`INDEPENDENT` is by others, who had read neither the program nor its tests. Nothing was tuned on its second half.
A cause is a place at which it acts, and its shape over the positions, given a `Scene`.
"""

from collections.abc import Callable
from typing import Any

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


class Scene:
    """A setup and a generator, with what shapes are made of: `of` 0 to 1 over the run, inputs `u`, and random numbers."""

    def __init__(self, setup: Setup, rng: np.random.Generator):
        self.setup, self.rng, self.between, self.normal = setup, rng, rng.uniform, rng.normal
        self.alpha, self.beta, self.pitch, self.side = setup.alpha, setup.beta, setup.pitch, setup.approach
        self.degc, self.count, self.share, self.of = setup.temperature_degc, len(setup.alpha), *_times(setup)
        self.u = inputs(setup)

    def phase(self) -> float:
        """An angle."""
        return self.rng.uniform(0, TURN)

    def axis(self) -> int:
        """One of three."""
        return int(self.rng.integers(3))

    def two(self) -> np.ndarray:
        """Two different axes."""
        return self.rng.choice(3, 2, replace=False)

    def vector(self) -> np.ndarray:
        """A direction."""
        return direction(self.rng)

    def knee(self, v: np.ndarray) -> np.ndarray:
        """A smooth change at a random input."""
        centre, width = self.between(-0.7, 0.7), self.between(0.05, 0.25)
        return np.tanh((v - centre) / width)

    def late(self, drive: np.ndarray, low: float, high: float, **options: bool) -> np.ndarray:
        """A drive that is followed with a time constant, s."""
        return followed(self.setup, drive, self.between(low, high), **options)

    def since(self, began: float) -> np.ndarray:
        """Seconds from a moment on."""
        return self.setup.time_s - self.setup.time_s[0] + began

    def settings(self) -> list[np.ndarray]:
        """The rows of each pitch setting."""
        return [np.flatnonzero(self.pitch == own) for own in np.unique(self.pitch)]


def _times(setup: Setup) -> tuple[np.ndarray, np.ndarray]:
    return setup.time_s / setup.time_s[-1], elapsed(setup)


def _turns(s: Scene, vectors: np.ndarray) -> Sized:
    return lambda size: outputs(s.setup, Rotation.from_rotvec(size * vectors).apply(s.u))


# How a shape acts. `tilt`: a rotation of the triad about a random axis; `turns`: the same with large angles, about its vectors.
ACTS: dict[str, Callable[[Scene, Any], Sized]] = {
    "index": lambda s, shape: on_index(s.setup, shape),
    "pitch": lambda s, shape: on_pitch(s.setup, shape),
    "tilt": lambda s, shape: on_attitude(s.setup, shape[:, None] * s.vector()),
    "attitude": lambda s, shape: on_attitude(s.setup, shape),
    "turns": _turns,
    "output": lambda s, shape: on_output(s.setup, shape[0], shape[1]),
    "any output": lambda s, shape: on_output(s.setup, s.axis(), shape),
    "outputs": lambda s, shape: on_outputs(s.setup, shape),
    "table": lambda s, shape: on_table(s.setup, *shape),
    "spindle": lambda s, shape: on_spindle(s.setup, shape),
    "seen": lambda s, shape: lambda size: seen_from(s.setup, pitched(s.setup, shape(size))),
}
Shape = Callable[[Scene], Any]
Group = dict[str, Cause]


def cause(acts: str, shape: Shape) -> Cause:
    """The cause of a shape."""

    def drawn(setup: Setup, rng: np.random.Generator) -> Sized:
        scene = Scene(setup, rng)
        return ACTS[acts](scene, shape(scene))

    return drawn


def group(listed: dict[str, tuple[str, Shape]]) -> Group:
    """Causes by their names."""
    return {name: cause(*own) for name, own in listed.items()}


def of(causes: Group, acts: str) -> Callable[[Shape], Shape]:
    """Add a shape that needs more than a line; its name is that of the function."""

    def added(shape: Shape) -> Shape:
        causes[shape.__name__.replace("_", " ")] = cause(acts, shape)
        return shape

    return added


UNLISTED = group({
    "bump of the index": ("index", lambda s: bump(s.alpha, s.rng)),
    # A cable comes taut, the more the higher the pitch.
    "cable pull": ("tilt", lambda s: bump(s.alpha, s.rng) * (0.5 + np.sin(s.beta))),
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
    "wedge under a foot": ("table", lambda s: (
        quadrant := ((s.alpha - s.phase()) // (np.pi / 2)).astype(int) % 4, s.normal(size=(4, 2))[quadrant].T
    )[1]),
    # A pull to the nearest of three to five detents.
    "motor cogs": ("index", lambda s: np.abs(np.sin(s.rng.integers(3, 6) * (s.alpha - s.phase()) / 2))),
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
})  # fmt: skip
UNSEEN = group({
    # The load pulls the head down in pitch.
    "head droops": ("pitch", lambda s: np.maximum(np.cos(s.alpha - s.phase()), 0.0) * np.cos(s.beta)),
    # One bias changes between two levels three to six times.
    "two levels": ("any output", lambda s: np.searchsorted(
        np.sort(s.between(s.setup.time_s[0], s.setup.time_s[-1], s.rng.integers(3, 7))), s.setup.time_s
    ) % 2.0),
})  # fmt: skip
INDEPENDENT: Group = {}


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
def gust(s):
    """A pulse in time on two outputs."""
    away = s.share - s.between(0.1, 0.9)
    pulse = np.exp(-0.5 * (away / s.between(0.04, 0.1)) ** 2)
    return pulse[:, None] * s.normal(size=3) * (np.arange(3) != s.rng.integers(3))


@of(LATER, "index")
def unbalanced_load(s):
    """The index changes the flank of its gear where gravity's torque exceeds the preload."""
    torque = np.sin(s.alpha - s.phase()) * np.sin(s.beta)
    return np.tanh((torque - s.between(0.2, 0.7)) / s.between(0.02, 0.1))


@of(LATER, "outputs")
def supply_falls(s):
    """The supply falls for a while, and with it all scale factors."""
    first, length = s.between(0.1, 0.6), s.between(0.15, 0.3)
    low = np.clip((s.share - first) / 0.05, 0, 1) - np.clip((s.share - first - length) / 0.05, 0, 1)
    return -low[:, None] * s.between(0.3, 1.0, 3) * readings(s.setup, s.setup.nominal, {})


@of(LATER, "pitch")
def pitch_creeps(s):
    """After every change of pitch the table creeps to its stop."""
    creep = np.zeros(s.count)
    for rows in s.settings():
        creep[rows] = s.normal() * np.exp(-np.arange(len(rows)) / s.between(1.0, 3.0))
    return creep


@of(LATER, "any output")
def heater_cycles(s):
    """One bias follows a heater that is switched three to five times."""
    wave = np.sin(TURN * (s.between(3, 5) * s.share + s.between(0, 1)))
    return (wave > s.between(-0.3, 0.3)).astype(float)


@of(LATER, "attitude")
def clamped_anew_at_each_pitch(s):
    """A different mount at each pitch setting, which works loose a little within each."""
    vectors = np.zeros((s.count, 3))
    for rows in s.settings():
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


@of(LATER, "tilt")
def glue_creeps(s):
    """The triad rotates in its glue as gravity pulled it at this position and those before."""
    pull = s.u @ s.vector()
    return past(s.setup, s.between(1.5, 5.0) * step_s(s.setup)) @ pull


@of(LATER, "outputs")
def door_opened(s):
    """All outputs jump and come back slowly."""
    since = s.of - s.between(0.1, 0.7)
    gone = np.where(since > 0, np.exp(-np.maximum(since, 0.0) / s.between(0.05, 0.2)), 0.0)
    return gone[:, None] * s.normal(size=3)


@of(LATER, "output")
def spring_bottoms(s):
    """One output is in error by the part of its input beyond a threshold, on one side only."""
    axis = s.axis()
    beyond = np.maximum(s.rng.choice([-1.0, 1.0]) * s.u[:, axis] - s.between(0.2, 0.7), 0.0)
    return axis, beyond ** s.between(1.0, 2.0)


@of(LATEST, "outputs")
def iron_nearby(s):
    """A magnetic part next to the head pulls all outputs as the triad sweeps by."""
    away = 1.4 - np.cos(s.alpha - s.phase()) * np.cos(s.beta - s.between(0, np.pi / 2))
    return (away ** -s.between(1.5, 3.0))[:, None] * s.normal(size=3)


@of(LATEST, "index")
def cage_of_the_bearing(s):
    """The index follows the balls of the bearing, whose cage falls back with every step."""
    cage = s.between(0.36, 0.44) * (s.alpha + s.between(0.5, 2.0) * np.arange(s.count))
    return np.sin(s.rng.integers(2, 5) * cage + s.phase())


@of(LATEST, "table")
def somebody_leans_on_the_table(s):
    """Twice, each time for a while and in a different direction."""
    both = np.zeros((2, s.count))
    for first in s.between((0.0, 0.5), (0.3, 0.8)):
        leaning = (s.of >= first) & (s.of < first + s.between(0.08, 0.2))
        both += s.normal(size=(2, 1)) * leaning
    return both


@of(LATEST, "index")
def worn_detents(s):
    """Every detent of the index has an error, the same at all pitch settings."""
    settings, number = np.unique(np.round(s.alpha, 6), return_inverse=True)
    return s.normal(size=len(settings))[number]


@of(LATEST, "any output")
def heater_on_one_side(s):
    """One bias follows how far the triad was turned to a heater, at this position and before."""
    weights = past(s.setup, s.between(1.0, 4.0) * step_s(s.setup))
    return weights @ np.maximum(np.cos(s.alpha - s.phase()), 0.0) / np.sum(weights, axis=1)


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


@of(UNSEEN, "tilt")
def clamp_settles(s):
    """After each change of pitch the triad comes to rest within some positions."""
    began = np.array([s.setup.time_s[np.flatnonzero(s.pitch == own)[0]] for own in s.pitch])
    return np.exp(-(s.setup.time_s - began) / (s.between(1.0, 3.0) * step_s(s.setup)))


@of(UNSEEN, "output")
def scale_saturates_across(s):
    """The scale factor of one output follows the input of another, and saturates."""
    axis, other = s.two()
    return axis, s.u[:, axis] * np.tanh(s.between(3.0, 6.0) * (s.u[:, other] - s.between(-0.4, 0.4)))


@of(INDEPENDENT, "spindle")
def chip_in_the_face_gear(s):
    """From some position on a chip between the gears lifts one side of the spindle; every closing flattens it."""
    closed = np.arange(s.count) - s.rng.integers(3, 16)
    height = np.where(closed >= 0, (1.0 + np.maximum(closed, 0)) ** -s.between(0.2, 0.8), 0.0)
    where = s.phase()
    return height[:, None] * [0.0, np.cos(where), np.sin(where)]


@of(INDEPENDENT, "index")
def nearest_hole_of_the_plate(s):
    """The pin goes into the nearest hole of an index plate whose holes the angles do not divide."""
    wanted = s.alpha * s.rng.choice([18, 19, 20, 21, 27, 29, 30, 42, 43, 46, 54, 58]) / TURN + s.between(0, 1)
    return np.round(wanted) - wanted


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
def bracket_of_two_metals(s):
    """A bracket twists as it follows, late, the temperature of the room."""
    late = s.late(s.degc, 60, 900)
    return (late - late[0])[:, None] * s.vector()


@of(INDEPENDENT, "turns")
def rubber_under_the_triad(s):
    """A pad that is stiffer in one direction yields slowly to the weight of this attitude and the ones before."""
    prompt, mass_at = s.between(0.0, 0.4), s.vector()
    stiff = Rotation.from_rotvec(s.between(0, np.pi) * s.vector()).as_matrix()
    compliance = stiff @ np.diag(s.between(0.1, 1.0, 3)) @ stiff.T
    return np.cross(mass_at, prompt * s.u + (1 - prompt) * s.late(s.u, 60, 600)) @ compliance


@of(INDEPENDENT, "outputs")
def charge_on_the_dielectric(s):
    """Charge creeps onto the nearer electrode, leaks away over many minutes and pulls the mass."""
    steep, leak = s.between(0.5, 3.5), s.between(200, 1500)
    return followed(s.setup, np.sinh(steep * s.u) / np.sinh(steep), leak, empty=True) * some_axes(s.rng)


@of(INDEPENDENT, "outputs")
def particle_in_the_cavity(s):
    """A loose particle rolls from corner to corner with friction, and disturbs the field differently in each."""
    corners, friction = s.rng.integers(3, 6), s.between(0.15, 0.7)
    angles = TURN * (np.arange(corners) + s.between(-0.2, 0.2, corners)) / corners
    flat = np.stack([np.cos(angles), np.sin(angles), np.zeros(corners)], axis=1)
    # The specific force points up: the lowest corner is the one that it points away from.
    depth = -s.u @ Rotation.from_rotvec(s.between(0, np.pi) * s.vector()).apply(flat).T
    disturbs, corner = s.normal(size=corners)[:, None] * some_axes(s.rng), [int(np.argmax(depth[0]))]
    for own in depth[1:]:
        lowest = int(np.argmax(own))
        corner.append(lowest if own[lowest] > own[corner[-1]] + friction else corner[-1])
    return disturbs[corner]


@of(INDEPENDENT, "outputs")
def rail_sags_under_the_outputs(s):
    """Three ratiometric sensors share a supply that sags with the current of their outputs."""
    sourced = np.maximum(s.u - s.between(-0.3, 0.3, 3), 0) ** s.between(0.8, 1.6)
    sag = sourced @ s.between(0.2, 1.0, 3)
    return -sag[:, None] * (s.u + s.between(0, 2.0) * s.between(0.7, 1.3, 3))


@of(INDEPENDENT, "outputs")
def auto_zero_droops(s):
    """The amplifiers zero themselves at regular times; in between the voltage droops."""
    period = s.between(170, 800)
    since = np.mod(s.since(s.between(0, period)), period)
    return (1 - np.exp(-since / (period * s.between(0.4, 3.0))))[:, None] * some_axes(s.rng)


@of(INDEPENDENT, "outputs")
def floor_shakes_and_is_rectified(s):
    """A machine shakes the floor on and off along a slanting line; each sensor rectifies its share."""
    slant, heading = s.between(np.radians(35), np.pi / 2), s.phase()
    line = np.array([np.sin(slant) * np.cos(heading), np.sin(slant) * np.sin(heading), np.cos(slant)])
    shaken = in_triad(s.setup, pitched(s.setup, np.tile(line, (s.count, 1))))
    period, quiet, share = s.between(250, 1500), s.between(0.0, 0.6), s.between(0.3, 0.7)
    on = np.mod(s.since(0.0) / period + s.between(), 1.0) < share
    return np.where(on, 1.0, quiet)[:, None] * shaken**2 * (1 + s.between(-0.8, 0.8) * s.u) * some_axes(s.rng)


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
    late = s.late(s.degc, 100, 700)
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
    weights, added = some_axes(s.rng), np.zeros(s.u.shape)
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
    weights, bits, full = some_axes(s.rng), s.rng.integers(3, 6), s.between(1.3, 2.6)
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
    sector = bump(s.alpha, s.rng, 0.35, 0.9)
    rounds = s.pitch * s.rng.choice([1.0, -1.0]) * s.between(0.1, 0.7) * 3 / (s.pitch.max() + 1)
    zero, takes = s.between(-1.0, 1.0, 3), s.between(0.6, 1.2, 3)
    return -(sector * np.exp(-rounds))[:, None] * takes * (s.u + zero)


@of(INDEPENDENT, "outputs")
def stale_compensation(s):
    """The chip compensates its temperature, but only in coarse steps."""
    felt = s.late(s.degc, 5, 120)
    step, rest = s.between(0.2, 0.5) * np.ptp(felt), []
    used = felt[0] - s.between(-0.5, 0.5) * step
    for own in felt:
        used = own if np.abs(own - used) >= step else used
        rest.append(own - used)
    return np.array(rest)[:, None] * some_axes(s.rng) * (1 + s.between(-0.8, 0.8, 3) * s.u)


@of(INDEPENDENT, "seen")
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
    tip, up = np.outer(tilt, [np.cos(heading), np.sin(heading), 0.0]), np.array([0.0, 0.0, 1.0])
    return lambda size: Rotation.from_rotvec(size * tip).apply(up)


@of(INDEPENDENT, "outputs")
def chimney_of_the_board(s):
    """Zeros and scale factors follow, by some minutes, the warmth of the attitude."""
    normal, chimney, down = s.vector(), s.between(0.4, 1.2), s.between(0.1, 0.5)
    lying = np.clip(s.u @ normal, -1, 1)
    cooled = 1 + chimney * (1 - lying**2) ** 0.25 - down * np.maximum(-lying, 0)
    warm = s.late(1 / cooled, 40, 400)
    return (warm - warm[0])[:, None] * (some_axes(s.rng) + s.between(-0.5, 0.5, 3) * s.u)


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

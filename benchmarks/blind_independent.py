"""Ten causes that are in no catalogue, written by someone who has read neither the program nor its tests.

After them the program was given turns in the mount, and swings in time as quick as the positions can show.
"""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from blind_instrument import Setup, readings, turned
from blind_sized import Sized, direction, inputs


def chip_in_the_face_gear(setup: Setup, rng: np.random.Generator) -> Sized:
    """From some position on a chip lies between the face gears of the spindle and lifts one side of it; every closing of
    the gears flattens it."""
    closed = np.arange(len(setup.alpha)) - rng.integers(3, 16)
    height = np.where(closed >= 0, (1.0 + np.maximum(closed, 0)) ** -rng.uniform(0.2, 0.8), 0.0)
    where = rng.uniform(0, 2 * np.pi)
    # The chip stays on the lower gear: the axis about which it tips the spindle stands still while alpha turns.
    tip = np.stack([np.zeros(len(height)), np.cos(where) * height, np.sin(where) * height], axis=1)
    f = turned("y", setup.beta + setup.nominal["dbeta"][setup.pitch], np.tile([0.0, 0.0, 1.0], (len(height), 1)))
    return lambda size: seen_by_axes(setup, Rotation.from_rotvec(size * tip).apply(f))


def nearest_hole_of_the_plate(setup: Setup, rng: np.random.Generator) -> Sized:
    """The circle of the index plate has a number of holes that the angles do not divide: the pin goes into the nearest."""
    # None is a multiple, give or take one, of the 8, 12 or 16 angles: that could be no more than a gain of the index.
    holes = rng.choice([18, 19, 20, 21, 27, 29, 30, 42, 43, 46, 54, 58])
    wanted = setup.alpha * holes / (2 * np.pi) + rng.uniform(0, 1)
    missed = np.round(wanted) - wanted
    return lambda size: readings(replace(setup, alpha=setup.alpha + size * missed), setup.nominal, {})


def pitch_walks_with_every_step(setup: Setup, rng: np.random.Generator) -> Sized:
    """The jerk of the spindle's drive nudges the pitch table, to the side from which the angle is approached, and more
    where the load hangs against it; the nudges add up, springing back a little, until the pitch is set anew."""
    back, uneven, heavy = rng.uniform(0.0, 0.4), rng.uniform(0.0, 0.8), rng.uniform(0, 2 * np.pi)
    nudge = setup.approach * (1 + uneven * np.cos(setup.alpha - heavy)) * (1 + rng.uniform(0, 1) * np.sin(setup.beta))
    walked = np.zeros(len(nudge))
    for k in range(1, len(nudge)):
        if setup.pitch[k] == setup.pitch[k - 1]:
            walked[k] = (1 - back) * walked[k - 1] + nudge[k]
    return lambda size: readings(replace(setup, beta=setup.beta + size * walked), setup.nominal, {})


def bracket_of_two_metals(setup: Setup, rng: np.random.Generator) -> Sized:
    """The triad sits on a bracket of steel and aluminium that twists as it follows, late, the temperature of the room."""
    late = _followed(setup, setup.temperature_degc[:, None], rng.uniform(60, 900))[:, 0]
    twist = (late - late[0])[:, None] * direction(rng)
    return lambda size: outputs(setup, Rotation.from_rotvec(size * twist).apply(inputs(setup)))


def rubber_under_the_triad(setup: Setup, rng: np.random.Generator) -> Sized:
    """The triad stands on a rubber pad, stiffer one way than the other, that yields to the weight of the present attitude
    only slowly and still remembers several earlier ones."""
    prompt, mass_at = rng.uniform(0.0, 0.4), direction(rng)
    stiff = Rotation.from_rotvec(rng.uniform(0, np.pi) * direction(rng)).as_matrix()
    compliance = stiff @ np.diag(rng.uniform(0.1, 1.0, 3)) @ stiff.T
    f = inputs(setup)
    load = prompt * f + (1 - prompt) * _followed(setup, f, rng.uniform(60, 600))
    lean = np.cross(mass_at, load) @ compliance
    return lambda size: outputs(setup, Rotation.from_rotvec(size * lean).apply(f))


def charge_on_the_dielectric(setup: Setup, rng: np.random.Generator) -> Sized:
    """Charge creeps onto the oxide of the electrode that the proof mass is nearer to, faster than in proportion, leaks
    away over many minutes and pulls the mass."""
    steep, leak = rng.uniform(0.5, 3.5), rng.uniform(200, 1500)
    drive = np.sinh(steep * inputs(setup)) / np.sinh(steep)
    charge = _followed(setup, drive, leak, empty=True) * _some_axes(rng)
    return lambda size: readings(setup, setup.nominal, {}) + size * charge


def particle_in_the_cavity(setup: Setup, rng: np.random.Generator) -> Sized:
    """A loose particle under the lid of a sensor lies in one of a few corners; it rolls to another only when that one has
    become lower by more than friction holds, and in each it disturbs the field differently."""
    corners, friction = rng.integers(3, 6), rng.uniform(0.15, 0.7)
    angles = 2 * np.pi * (np.arange(corners) + rng.uniform(-0.2, 0.2, corners)) / corners
    flat = np.stack([np.cos(angles), np.sin(angles), np.zeros(corners)], axis=1)
    places = Rotation.from_rotvec(rng.uniform(0, np.pi) * direction(rng)).apply(flat)
    # The specific force points up: the lowest corner is the one that it points away from.
    depth = -inputs(setup) @ places.T
    disturbs = rng.normal(size=corners)[:, None] * _some_axes(rng)
    lies = [int(np.argmax(depth[0]))]
    for own in depth[1:]:
        lowest = int(np.argmax(own))
        lies.append(lowest if own[lowest] > own[lies[-1]] + friction else lies[-1])
    return lambda size: readings(setup, setup.nominal, {}) + size * disturbs[lies]


def rail_sags_under_the_outputs(setup: Setup, rng: np.random.Generator) -> Sized:
    """Three ratiometric sensors share a weak supply that sags with the current their outputs source: it takes gain and
    part of the mid-rail zero from all three."""
    v = inputs(setup)
    sourced = np.maximum(v - rng.uniform(-0.3, 0.3, 3), 0) ** rng.uniform(0.8, 1.6)
    sag = sourced @ rng.uniform(0.2, 1.0, 3)
    zero = rng.uniform(0, 2.0) * rng.uniform(0.7, 1.3, 3)
    return lambda size: readings(setup, setup.nominal, {}) - size * sag[:, None] * (v + zero)


def auto_zero_droops(setup: Setup, rng: np.random.Generator) -> Sized:
    """The amplifiers zero themselves at regular times; in between the held voltage droops away."""
    period = rng.uniform(170, 800)
    since = np.mod(setup.time_s - setup.time_s[0] + rng.uniform(0, period), period)
    droop = 1 - np.exp(-since / (period * rng.uniform(0.4, 3.0)))
    added = droop[:, None] * _some_axes(rng)
    return lambda size: readings(setup, setup.nominal, {}) + size * added


def floor_shakes_and_is_rectified(setup: Setup, rng: np.random.Generator) -> Sized:
    """A machine next door that runs off and on shakes the floor along a slanting line; each sensor rectifies the share
    along its own axis, more where gravity already loads it."""
    slant, heading = rng.uniform(np.radians(35), np.pi / 2), rng.uniform(0, 2 * np.pi)
    line = np.array([np.sin(slant) * np.cos(heading), np.sin(slant) * np.sin(heading), np.cos(slant)])
    shaken = turned("y", setup.beta + setup.nominal["dbeta"][setup.pitch], np.tile(line, (len(setup.beta), 1)))
    shaken = turned("x", setup.alpha, shaken)
    for axis, angle in zip("zyx", setup.nominal["dtheta"][::-1], strict=True):
        shaken = turned(axis, np.array(angle), shaken)
    period, quiet, share = rng.uniform(250, 1500), rng.uniform(0.0, 0.6), rng.uniform(0.3, 0.7)
    t = np.mod((setup.time_s - setup.time_s[0]) / period + rng.uniform(), 1.0)
    power = np.where(t < share, 1.0, quiet)
    added = power[:, None] * shaken**2 * (1 + rng.uniform(-0.8, 0.8) * inputs(setup)) * _some_axes(rng)
    return lambda size: readings(setup, setup.nominal, {}) + size * added


def _some_axes(rng: np.random.Generator) -> np.ndarray:
    """Weights of the three axes, some of which are spared; never all."""
    weights = rng.choice([-1.0, 1.0], 3) * rng.uniform(0.3, 1.0, 3)
    hit = rng.permutation(3)[: rng.integers(1, 4)]
    return np.where(np.isin(np.arange(3), hit), weights, 0.0)


def _followed(setup: Setup, drive: np.ndarray, tau: float, empty: bool = False) -> np.ndarray:
    """What follows the drive of each position (rows) with a time constant, s; at first at rest with it, or empty."""
    gone = np.append(60.0, np.diff(setup.time_s))
    state = np.zeros(drive.shape[1]) if empty else drive[0]
    rows = []
    for own, step in zip(drive, gone, strict=True):
        state = state + (1 - np.exp(-step / tau)) * (own - state)
        rows.append(state)
    return np.array(rows)


def outputs(setup: Setup, u: np.ndarray) -> np.ndarray:
    """The outputs of axes that see the inputs `u`, g."""
    return (1 + setup.nominal["dK"]) * u + setup.nominal["bias"]


def seen_by_axes(setup: Setup, f: np.ndarray) -> np.ndarray:
    """The outputs when gravity, seen from the pitch table, is `f` (positions, 3)."""
    f = turned("x", setup.alpha, f)
    for axis, angle in zip("zyx", setup.nominal["dtheta"][::-1], strict=True):
        f = turned(axis, np.array(angle), f)
    g21, g31, g32 = setup.nominal["gamma"]
    u = np.stack([f[:, 0], f[:, 1] + g21 * f[:, 0], f[:, 2] + g31 * f[:, 0] + g32 * f[:, 1]], axis=1)
    return outputs(setup, u)


INDEPENDENT = {
    "chip in the face gear": chip_in_the_face_gear,
    "nearest hole of the plate": nearest_hole_of_the_plate,
    "pitch walks with every step": pitch_walks_with_every_step,
    "bracket of two metals": bracket_of_two_metals,
    "rubber under the triad": rubber_under_the_triad,
    "charge on the dielectric": charge_on_the_dielectric,
    "particle in the cavity": particle_in_the_cavity,
    "rail sags under the outputs": rail_sags_under_the_outputs,
    "auto zero droops": auto_zero_droops,
    "floor shakes and is rectified": floor_shakes_and_is_rectified,
}

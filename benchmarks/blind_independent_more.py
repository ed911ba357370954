"""Ten more causes that are in no catalogue, written by someone who has read neither the program nor its tests.

On these nothing was tuned.
"""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from blind_independent import outputs, seen_by_axes
from blind_instrument import Setup, readings, turned
from blind_sized import Sized, bump_at, direction, inputs


def spindle_climbs_its_bearing(setup: Setup, rng: np.random.Generator) -> Sized:
    """In its plain bearing the loaded spindle climbs the wall of the side towards which it was turned last, aside and up;
    part of an earlier climb remains. There is no climb where the spindle stands upright and loads no wall."""
    steep, kept, up = rng.uniform(0.5, 1.5), rng.uniform(0.0, 0.5), rng.uniform(-0.6, 0.6)
    load = np.abs(np.cos(setup.beta)) ** steep
    climb, state = np.zeros(len(load)), 0.0
    for k in range(len(load)):
        state = load[k] * (kept * np.clip(state, -1, 1) + (1 - kept) * setup.approach[k])
        climb[k] = state
    tip = np.stack([np.zeros(len(climb)), up * np.abs(climb), climb], axis=1)
    return lambda size: seen_by_axes(setup, Rotation.from_rotvec(size * tip).apply(_pitched(setup)))


def bearing_opens_as_it_warms(setup: Setup, rng: np.random.Generator) -> Sized:
    """Above some temperature the housing, which follows the room late, outgrows the bearing: in the clearance the spindle
    hangs down, and is thrown to its heavy side as it turns."""
    late = _lagging(setup, setup.temperature_degc, rng.uniform(100, 700))
    open_by = np.maximum(late - np.quantile(late, rng.uniform(0.1, 0.55)), 0)
    hangs, thrown, heavy = rng.uniform(0, 0.7), rng.uniform(0.4, 1.0), rng.uniform(0, 2 * np.pi)
    about_y = hangs * np.cos(setup.beta) + thrown * np.cos(setup.alpha - heavy)
    about_z = thrown * np.sin(setup.alpha - heavy)
    tip = open_by[:, None] * np.stack([np.zeros(len(late)), about_y, about_z], axis=1)
    return lambda size: seen_by_axes(setup, Rotation.from_rotvec(size * tip).apply(_pitched(setup)))


def plate_turns_on_its_dowel(setup: Setup, rng: np.random.Generator) -> Sized:
    """The plate under the triad has clearance about its dowel: it turns to one end of it when the weight across its lever
    exceeds friction, part of the way at a time, and stays where it is otherwise."""
    f = inputs(setup)
    while True:
        normal = direction(rng)
        lever = np.cross(normal, direction(rng))
        torque = f @ (lever / np.linalg.norm(lever))
        # A plate that is pushed to one side only turns once, which would be a mount that slips.
        least = min(torque.max(), -torque.min())
        if least > 0.3:
            break
    friction, share = rng.uniform(0.3, 0.85) * least, rng.uniform(0.5, 1.0)
    lies, state = np.zeros(len(f)), rng.uniform(-1, 1)
    for k, own in enumerate(torque):
        if np.abs(own) > friction:
            state += share * (np.sign(own) - state)
        lies[k] = state
    return lambda size: outputs(setup, Rotation.from_rotvec(size * lies[:, None] * normal).apply(f))


def mass_clings_to_its_stop(setup: Setup, rng: np.random.Generator) -> Sized:
    """A proof mass that has come near its stop clings to it by a corner, tilted, until the input pulls it away by far
    enough; meanwhile the sensor has another zero and a little less gain."""
    v, hit = inputs(setup), _hit(rng)
    added = np.zeros(v.shape)
    for i in np.flatnonzero(hit):
        side = rng.choice([-1.0, 1.0])
        catches = rng.uniform(0.45, 0.75) * np.max(side * v[:, i])
        frees, gain = catches - rng.uniform(0.4, 1.1), rng.uniform(0.0, 0.8)
        clings = False
        for k, own in enumerate(side * v[:, i]):
            clings = own > catches or (clings and own > frees)
            added[k, i] = hit[i] * clings * (1 - gain * own)
    return lambda size: readings(setup, setup.nominal, {}) + size * added


def bits_weigh_wrong(setup: Setup, rng: np.random.Generator) -> Sized:
    """The capacitors of the upper bits of a successive-approximation converter do not halve exactly: wherever one of
    these bits is set the output is off by its own error."""
    v, hit, bits = inputs(setup), _hit(rng), rng.integers(3, 6)
    full = rng.uniform(1.3, 2.6)
    added = np.zeros(v.shape)
    for i in np.flatnonzero(hit):
        middle = rng.uniform(-0.15, 0.15)
        code = np.floor(np.clip((v[:, i] - middle + full) / (2 * full), 0, 1 - 1e-9) * 2**bits).astype(int)
        for bit in range(bits):
            # Matching is worse, absolutely, in a larger capacitor: as the root of its area.
            added[:, i] += hit[i] * rng.normal() * 2 ** (bit / 2) * ((code >> bit) & 1)
    return lambda size: readings(setup, setup.nominal, {}) + size * added


def slip_ring_is_sooty(setup: Setup, rng: np.random.Generator) -> Sized:
    """One sector of the slip ring that feeds the triad is sooty: there the ratiometric supply is lower and takes gain and
    part of the zero of all outputs; with every round the brush polishes the sector, or soils it more."""
    sector = bump_at(setup.alpha, rng.uniform(0, 2 * np.pi), rng.uniform(0.35, 0.9))
    rounds = setup.pitch * rng.choice([1.0, -1.0]) * rng.uniform(0.1, 0.7) * 3 / (setup.pitch.max() + 1)
    lost = sector * np.exp(-rounds)
    zero, takes = rng.uniform(-1.0, 1.0, 3), rng.uniform(0.6, 1.2, 3)
    added = -lost[:, None] * takes * (inputs(setup) + zero)
    return lambda size: readings(setup, setup.nominal, {}) + size * added


def stale_compensation(setup: Setup, rng: np.random.Generator) -> Sized:
    """The chip compensates its own temperature, but takes the temperature anew only when it has changed by a whole step
    of its coarse thermometer: what has changed since remains in zero and gain."""
    felt = _lagging(setup, setup.temperature_degc, rng.uniform(5, 120))
    step = rng.uniform(0.2, 0.5) * np.ptp(felt)
    held, left = felt[0] - rng.uniform(-0.5, 0.5) * step, np.zeros(len(felt))
    for k, own in enumerate(felt):
        if np.abs(own - held) >= step:
            held = own
        left[k] = own - held
    zero, gain = _hit(rng), rng.uniform(-0.8, 0.8, 3)
    added = left[:, None] * zero * (1 + gain * inputs(setup))
    return lambda size: readings(setup, setup.nominal, {}) + size * added


def air_table_levels_itself(setup: Setup, rng: np.random.Generator) -> Sized:
    """The table floats on air springs that leak: it sinks to one corner until a valve opens and lifts it back over the
    middle of a dead band; a change of pitch moves the weight and tips it too."""
    heading, period, overshoot = rng.uniform(0, 2 * np.pi), rng.uniform(300, 1100), rng.uniform(0.0, 0.6)
    moved = rng.uniform(-0.7, 0.7)
    tilt, low = np.zeros(len(setup.beta)), rng.uniform(-0.5, 0.9)
    for k in range(len(tilt)):
        if k:
            low += (1 + overshoot) * (setup.time_s[k] - setup.time_s[k - 1]) / period
            low += moved * (np.sin(setup.beta[k]) - np.sin(setup.beta[k - 1]))
        while low > 1:
            low -= 1 + overshoot
        low = max(low, -1.0)
        tilt[k] = low
    tip = tilt[:, None] * np.array([np.cos(heading), np.sin(heading), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    return lambda size: seen_by_axes(setup, _pitched(setup, Rotation.from_rotvec(size * tip).apply(up)))


def chimney_of_the_board(setup: Setup, rng: np.random.Generator) -> Sized:
    """The board heats itself; upright it is a chimney and cools well, lying with the chips down it cools badly. The
    sensors' zeros and gains follow this warmth of the attitude by some minutes."""
    normal, chimney, down = direction(rng), rng.uniform(0.4, 1.2), rng.uniform(0.1, 0.5)
    f = inputs(setup)
    lying = np.clip(f @ normal, -1, 1)
    cooled = 1 + chimney * (1 - lying**2) ** 0.25 - down * np.maximum(-lying, 0)
    warm = _lagging(setup, 1 / cooled, rng.uniform(40, 400))
    added = (warm - warm[0])[:, None] * (_hit(rng) + rng.uniform(-0.5, 0.5, 3) * f)
    return lambda size: readings(setup, setup.nominal, {}) + size * added


def two_operators_take_turns(setup: Setup, rng: np.random.Generator) -> Sized:
    """Two people set the angles by eye in turns of a few positions: the one stands to the side of the vernier and reads
    it with parallax, the more so the more the head is pitched, and stops short on the side from which he comes."""
    leans, short, pitched = rng.choice([-1.0, 1.0]), rng.uniform(-0.6, 0.6), rng.uniform(-0.4, 0.6)
    his, first = [], bool(rng.integers(2))
    while len(his) < len(setup.alpha):
        his += [first] * int(rng.integers(2, 8))
        first = not first
    off = np.array(his[: len(setup.alpha)]) * (leans + short * setup.approach)
    at_pitch = np.array(his[: len(setup.alpha)]) * pitched
    off = off + leans * at_pitch * np.sin(setup.beta)
    return lambda size: readings(replace(setup, alpha=setup.alpha + size * off), setup.nominal, {})


def _hit(rng: np.random.Generator) -> np.ndarray:
    """Signed weights of the axes; one, two or all three are hit."""
    hit = np.zeros(3)
    own = rng.permutation(3)[: rng.integers(1, 4)]
    hit[own] = rng.choice([-1.0, 1.0], len(own)) * rng.uniform(0.4, 1.0, len(own))
    return hit


def _lagging(setup: Setup, drive: np.ndarray, tau: float) -> np.ndarray:
    """What follows the drive with a time constant, s; at rest with it at first."""
    out = np.array(drive, float)
    for k in range(1, len(out)):
        share = 1 - np.exp(-(setup.time_s[k] - setup.time_s[k - 1]) / tau)
        out[k] = out[k - 1] + share * (drive[k] - out[k - 1])
    return out


def _pitched(setup: Setup, f: np.ndarray | None = None) -> np.ndarray:
    """Gravity (or `f`, per position, in the level frame) seen from the pitch table."""
    level = np.tile([0.0, 0.0, 1.0], (len(setup.beta), 1)) if f is None else f
    return turned("y", setup.beta + setup.nominal["dbeta"][setup.pitch], level)


INDEPENDENT_MORE = {
    "spindle climbs its bearing": spindle_climbs_its_bearing,
    "bearing opens as it warms": bearing_opens_as_it_warms,
    "plate turns on its dowel": plate_turns_on_its_dowel,
    "mass clings to its stop": mass_clings_to_its_stop,
    "bits weigh wrong": bits_weigh_wrong,
    "slip ring is sooty": slip_ring_is_sooty,
    "stale compensation": stale_compensation,
    "air table levels itself": air_table_levels_itself,
    "chimney of the board": chimney_of_the_board,
    "two operators take turns": two_operators_take_turns,
}

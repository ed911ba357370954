"""The second blind instrument: mechanisms of sensor, head and surroundings, each by its own physics, in plain numpy.

It shares nothing with the program or with `blind_instrument.py`. The truth in ids of the catalogue follows from each equation
to the lowest order (u: inputs, i: the axis that is hit, p: its pendulous axis, o: its output axis):

| mechanism | lowest order of its equation | truth |
|---|---|---|
| bridge offset | the mass rests q0 off the middle: the electrodes' force has a term q0 w^2: -q0 r u_i^2 | second_order.i |
| weak loop | the mass gives way by u_i r / G and sees q w^2 there: output r^2 / G u_i^3 (even terms cancel) | third_order.i |
| weak loop off the middle | both | second_order.i + third_order.i |
| pendulous angle | the pendulum turns by c u_i, its input axis with it: c u_i u_p | cross_coupling.i.ip |
| skew hinge | compliance C with principal axes turned in the plane of i and p: (C_pp - C_ii) u_i u_p + C_ip (u_i^2 - u_p^2) | \
cross_coupling.i.ip + cross_axis_square.i |
| magnet warms | torque and so scale factor follow the remanence: a (T - T0) u_i | scale_temperature.i |
| gear off centre | arcsin(e / R sin(alpha - phi)) | index_eccentricity |
| oval gear | twice a turn | index_ellipticity |
| swash of the collar | tilt in one plane of the head, cos(alpha - phi) | spindle_wobble_1 |
| oval journal in a vee | the centre goes round twice a turn, with the radii at the two flanks | spindle_wobble_2 |
| cable winds up | torque of a spring on the clamped spindle: a share of alpha | index_gain |
| cable rubs | Coulomb friction, turned over by the overshoot of each approach: +- | index_backlash |
| teeth at random | a value for each spindle angle, the same at all pitch settings | unlisted |
| table drifts | base roll and pitch swing with the room's air, within a pitch setting | unlisted |
| permanent iron | torque m x B of the case's moment in the Earth's field, whose level part is not along gravity | unlisted |
| soft iron | torque of the induced moment, quadratic in the field | unlisted |
| cable with hysteresis | Dahl friction that turns over within steps: depends on the path | unlisted |
| cable pulls | slack for a part of the turn, tips the spindle for the rest | unlisted |
| flicker and random walk | correlated from position to position; a bias that wanders with time | noise_coloured, or unlisted |

Unlisted: `unexplained`, or a class that includes it. `second_check.py` checks both kinds of statement on each case, in numbers.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from in_use_instrument import Schedule
from second_head import Felt, Mechanism


AXES = "xyz"
UNLISTED = ("unexplained",)
# The ids of the truth, and the mechanism.
Drawn = tuple[tuple[str, ...], Mechanism]


def force_balance(u: np.ndarray, per_g: float, offset: float, softness: float, stray: float = 0.3) -> np.ndarray:
    """Output, in g, of a proof mass between two electrodes that is held by the difference of their forces.

    With q the displacement in gaps and w the feedback voltage over the bias voltage, the electrodes push the mass with
    E = ((1 + w)^2 / (1 - q)^2 - (1 - w)^2 / (1 + q)^2) / 4 (units of their force at unit voltage; the term q in it is the
    electrostatic softening). At rest `per_g u - hinge q + E = 0`. The bridge measures (C1 - C2) / (C1 + C2 + stray)
    = (q + offset) / (1 + stray (1 - q^2)), and w is that times a gain 1 / softness with the opposite sign. The output is
    -w / per_g.
    """
    hinge = 0.5
    w = -per_g * u
    for _ in range(15):
        q = np.full_like(w, -offset)
        for _ in range(4):
            q = -offset - softness * w * (1 + stray * (1 - q**2))
        force = ((1 + w) ** 2 / (1 - q) ** 2 - (1 - w) ** 2 / (1 + q) ** 2) / 4
        # The force is nearly w: a fixed-point step that contracts by the order of w and softness.
        w = w - (per_g * u - hinge * q + force)
    return -w / per_g


def _on_axis(axis: int, response: Callable[[Felt, float], np.ndarray]) -> Mechanism:
    """One output as a function of what is felt and of a size; the others are the inputs."""

    def respond(felt: Felt, size: float) -> np.ndarray:
        out = felt.u.copy()
        out[:, axis] = response(felt, size)
        return out

    return lambda own, size: replace(own, respond=lambda felt: respond(felt, size))


def _axes(rng: np.random.Generator) -> tuple[int, int, int]:
    """Input axis, pendulous axis, output axis (right-handed)."""
    i = int(rng.integers(3))
    return (i, (i + 1) % 3, (i + 2) % 3)


def _pair(first: int, second: int) -> str:
    return "".join(sorted(AXES[first] + AXES[second]))


def bridge_offset(plan: Schedule, rng: np.random.Generator) -> Drawn:
    i, per_g, sign = rng.integers(3), rng.uniform(0.1, 0.25), rng.choice([-1.0, 1.0])
    balance = lambda felt, size: force_balance(felt.u[:, i], per_g, sign * size, 1e-5)  # noqa: E731
    return (f"second_order.{AXES[i]}",), _on_axis(i, balance)


def weak_loop(plan: Schedule, rng: np.random.Generator) -> Drawn:
    i, per_g = rng.integers(3), rng.uniform(0.1, 0.25)
    balance = lambda felt, size: force_balance(felt.u[:, i], per_g, 0.0, size)  # noqa: E731
    return (f"third_order.{AXES[i]}",), _on_axis(i, balance)


def weak_loop_off_the_middle(plan: Schedule, rng: np.random.Generator) -> Drawn:
    i, per_g = rng.integers(3), rng.uniform(0.1, 0.25)
    # The two terms are per_g offset and per_g^2 softness.
    ratio = per_g * rng.choice([-1.0, 1.0]) * np.exp(rng.uniform(-2.0, 1.0))
    balance = lambda felt, size: force_balance(felt.u[:, i], per_g, ratio * size, size)  # noqa: E731
    return (f"second_order.{AXES[i]}", f"third_order.{AXES[i]}"), _on_axis(i, balance)


def pendulous_angle(plan: Schedule, rng: np.random.Generator) -> Drawn:
    i, p, o = _axes(rng)
    p = int(rng.choice([p, o]))
    rest = rng.normal(0, 1e-3)

    def output(felt: Felt, size: float) -> np.ndarray:
        out = felt.u[:, i]
        for _ in range(5):
            turned = rest + size * out
            out = felt.u[:, i] * np.cos(turned) + felt.u[:, p] * np.sin(turned)
        return out

    return (f"cross_coupling.{AXES[i]}.{_pair(i, p)}",), _on_axis(i, output)


def skew_hinge(plan: Schedule, rng: np.random.Generator) -> Drawn:
    i, p, _ = _axes(rng)
    skew, stiff = rng.uniform(np.radians(22), np.radians(38)), rng.uniform(0.0, 0.3)
    along = np.array([[np.cos(skew), -np.sin(skew)], [np.sin(skew), np.cos(skew)]])
    compliance = along @ np.diag([1.0, stiff]) @ along.T

    def output(felt: Felt, size: float) -> np.ndarray:
        force = felt.u[:, [i, p]]
        gives = size * force @ compliance
        # The centre of mass moves, and the force acts at it with another lever about the hinge.
        return force[:, 0] + force[:, 0] * gives[:, 1] - force[:, 1] * gives[:, 0]

    return (f"cross_axis_square.{AXES[i]}", f"cross_coupling.{AXES[i]}.{_pair(i, p)}"), _on_axis(i, output)


def magnet_warms(plan: Schedule, rng: np.random.Generator) -> Drawn:
    i, bend = rng.integers(3), rng.uniform(0.0, 1e-3)

    def output(felt: Felt, size: float) -> np.ndarray:
        warm = felt.degc - 20.0
        return felt.u[:, i] / (1 - size * (warm + bend * warm**2))

    return (f"scale_temperature.{AXES[i]}",), _on_axis(i, output)


def gear_off_centre(plan: Schedule, rng: np.random.Generator) -> Drawn:
    phase = rng.uniform(0, 2 * np.pi)
    return ("index_eccentricity",), lambda own, size: replace(own, index=np.arcsin(size * np.sin(plan.alpha - phase)))


def oval_gear(plan: Schedule, rng: np.random.Generator) -> Drawn:
    phase = rng.uniform(0, 2 * np.pi)
    # A pitch radius 1 + size cos 2(.): the arc that has passed is the integral of it.
    return ("index_ellipticity",), lambda own, size: replace(own, index=size / 2 * np.sin(2 * (plan.alpha - phase)))


def swash_of_the_collar(plan: Schedule, rng: np.random.Generator) -> Drawn:
    """The collar is not square to the spindle and runs over one high pad: the spindle nods in the plane of the pad."""
    phase, pad = rng.uniform(0, 2 * np.pi, 2)
    nods = np.cos(plan.alpha - phase)[:, None] * np.array([0.0, np.cos(pad), np.sin(pad)])
    return ("spindle_wobble_1",), lambda own, size: replace(own, tip=size * nods)


def oval_journal_in_a_vee(plan: Schedule, rng: np.random.Generator) -> Drawn:
    """A journal of radius 1 + size cos 2(.) on two flanks: its centre rises as each contact asks."""
    phase, down = rng.uniform(0, 2 * np.pi), np.pi / 2 + rng.uniform(-0.3, 0.3)
    flanks = down + np.radians([-50.0, 50.0])
    normals = np.stack([np.cos(flanks), np.sin(flanks)], axis=1)
    lifted = np.cos(2 * (flanks - plan.alpha[:, None] - phase))
    centre = -np.linalg.solve(normals, lifted.T).T
    # The rear bearing is round: the front's centre tips the spindle about the axis across.
    tip = np.stack([np.zeros(len(centre)), -centre[:, 1], centre[:, 0]], axis=1)
    return ("spindle_wobble_2",), lambda own, size: replace(own, tip=size * tip)


def cable_winds_up(plan: Schedule, rng: np.random.Generator) -> Drawn:
    sign = rng.choice([-1.0, 1.0])
    return ("index_gain",), lambda own, size: replace(own, index=sign * size * plan.alpha)


def cable_rubs(plan: Schedule, rng: np.random.Generator) -> Drawn:
    return ("index_backlash",), lambda own, size: replace(own, index=-size * plan.approach)


def cable_with_hysteresis(plan: Schedule, rng: np.random.Generator) -> Drawn:
    """Dahl friction: dT = (1 - T sgn(d alpha)) d alpha / give. Each angle is approached with an overshoot of some degrees."""
    give, over = rng.uniform(0.5, 2.0), rng.uniform(0.02, 0.15)
    torque, at, held = rng.uniform(-1, 1), 0.0, []
    for target, side in zip(plan.alpha, plan.approach, strict=True):
        for goal in (target - side * over, target):
            sense = np.sign(goal - at)
            torque = sense + (torque - sense) * np.exp(-abs(goal - at) / give)
            at = goal
        held.append(torque)
    return UNLISTED, lambda own, size: replace(own, index=-size * np.array(held))


def cable_pulls(plan: Schedule, rng: np.random.Generator) -> Drawn:
    """The cable runs from a clip on the spindle to an anchor on the head, slack while the two are near each other."""
    clip = plan.alpha - rng.uniform(0, 2 * np.pi)
    away = rng.uniform(1.5, 2.5) * np.array([1.0, 0.0]) - np.stack([np.cos(clip), np.sin(clip)], axis=1)
    length = np.linalg.norm(away, axis=1)
    taut = np.maximum(length - np.quantile(length, rng.uniform(0.35, 0.65)), 0.0) / length
    pull = taut[:, None] * away
    heading = rng.uniform(0, 2 * np.pi)
    y, z = (
        np.cos(heading) * pull[:, 0] - np.sin(heading) * pull[:, 1],
        np.sin(heading) * pull[:, 0] + np.cos(heading) * pull[:, 1],
    )
    tip = np.stack([np.zeros(len(y)), -z, y], axis=1)
    return UNLISTED, lambda own, size: replace(own, tip=size * tip)


def teeth_at_random(plan: Schedule, rng: np.random.Generator) -> Drawn:
    """Two rings of 72 teeth bear on their highest pairs: the index is where these four pairs' flanks have it."""
    heights, flanks, number = rng.normal(size=(2, 72)), rng.normal(size=(2, 72)), np.arange(72)
    off = []
    for step in np.round(plan.alpha / np.radians(5)).astype(int):
        meets = (number + step) % 72
        bear = np.argsort(heights[0] + heights[1, meets])[-4:]
        off.append(np.mean(flanks[0, bear] - flanks[1, meets[bear]]))
    return UNLISTED, lambda own, size: replace(own, index=size * np.array(off))


def table_drifts(plan: Schedule, rng: np.random.Generator) -> Drawn:
    """The table leans about a slanting axis as the air of the room swings in temperature, later and less, and creeps."""
    passed = (plan.time_s - plan.time_s[0]) / np.ptp(plan.time_s)
    swings = np.sin(2 * np.pi * (passed / rng.uniform(0.2, 0.5) + rng.uniform()))
    leans = swings + rng.uniform(-0.5, 0.5) * (1 - np.exp(-passed / rng.uniform(0.3, 1.5)))
    heading = rng.uniform(0, 2 * np.pi)
    axis = np.array([np.cos(heading), np.sin(heading), 0.0])
    return UNLISTED, lambda own, size: replace(own, table=size * leans[:, None] * axis)


def _field(rng: np.random.Generator) -> np.ndarray:
    """The Earth's field of middle latitudes at a head that points anywhere; its strength is in the sizes."""
    dip, heading = np.radians(rng.uniform(50, 70)), rng.uniform(0, 2 * np.pi)
    return np.array([np.cos(dip) * np.cos(heading), np.cos(dip) * np.sin(heading), -np.sin(dip)])


def permanent_iron(plan: Schedule, rng: np.random.Generator) -> Drawn:
    (i, _, o), field, moment = _axes(rng), _field(rng), rng.normal(size=3)
    torque = lambda felt: np.cross(moment, felt.attitude @ field)[:, o]  # noqa: E731
    return UNLISTED, _on_axis(i, lambda felt, size: felt.u[:, i] + size * torque(felt))


def soft_iron(plan: Schedule, rng: np.random.Generator) -> Drawn:
    (i, _, o), field, rod = _axes(rng), _field(rng), rng.normal(size=3)
    rod /= np.linalg.norm(rod)

    def output(felt: Felt, size: float) -> np.ndarray:
        inside = felt.attitude @ field
        return felt.u[:, i] + size * (inside @ rod) * np.cross(rod, inside)[:, o]

    return UNLISTED, _on_axis(i, output)


def nothing(plan: Schedule, rng: np.random.Generator) -> Drawn:
    return (), lambda own, size: own


def flicker_and_random_walk(plan: Schedule, rng: np.random.Generator) -> Drawn:
    return ("noise_coloured",), lambda own, size: own


KINDS: dict[str, Callable[[Schedule, np.random.Generator], Drawn]] = {
    own.__name__.replace("_", " "): own
    for own in (
        nothing, bridge_offset, weak_loop, weak_loop_off_the_middle, pendulous_angle, skew_hinge, magnet_warms, gear_off_centre,
        oval_gear, swash_of_the_collar, oval_journal_in_a_vee, cable_winds_up, cable_rubs, teeth_at_random, table_drifts,
        permanent_iron, soft_iron, cable_with_hysteresis, cable_pulls, flicker_and_random_walk,
    )
}  # fmt: skip
# Those that no data without these columns can name.
NEEDS_COLUMNS = ("magnet warms", "cable rubs", "flicker and random walk")

"""A dividing head with a triad on it, in plain numpy: shares no code with the program under test.

Rotations are those of the frames (passive: the vector turns the other way). Every effect is written down here a second time.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np


AXES = "xyz"
SIGMA = 1e-4  # g


@dataclass
class Setup:
    """Plan (rad, s, degC, +-1) and true nominal parameters of one instrument on one head.

    `mounting`: of each position where the triad was remounted, `turns` of each: what turns a vector into its frame. Each has a
    mount and pitch errors of its own.
    """

    alpha: np.ndarray
    beta: np.ndarray
    time_s: np.ndarray
    temperature_degc: np.ndarray
    approach: np.ndarray
    pitch: np.ndarray
    nominal: dict[str, np.ndarray]
    names: list[str] = field(default_factory=list)
    mounting: np.ndarray | None = None
    turns: np.ndarray | None = None

    @property
    def mountings(self) -> np.ndarray:
        """The number of the mounting of each position."""
        return np.zeros(len(self.alpha), int) if self.mounting is None else self.mounting


def turned(axis: str, angle: np.ndarray, f: np.ndarray) -> np.ndarray:
    """The vectors `f` seen from a frame turned about `axis` by `angle`."""
    if not np.any(angle):
        return f
    own = AXES.index(axis)
    following, last = (own + 1) % 3, (own + 2) % 3
    cos, sin, out = np.cos(angle), np.sin(angle), f.copy()
    out[:, following] = cos * f[:, following] + sin * f[:, last]
    out[:, last] = cos * f[:, last] - sin * f[:, following]
    return out


def mounted(f: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """The vectors `f` seen from a frame with a mount of these angles about x, y and z."""
    for axis, angle in zip("zyx", angles[::-1], strict=True):
        f = turned(axis, angle, f)
    return f


def random_setup(
    rng: np.random.Generator,
    settings: int,
    angles: int,
    mount_deg: float = 1.0,
    soak_degc: float = 25.0,
) -> Setup:
    """The paper's 3 x 8 positions or others, in measuring order, with random small errors of everything: a mount of at
    most `mount_deg`, a mean temperature of `soak_degc`."""
    levels = np.radians(np.linspace(0, 90, settings))
    turns = np.arange(angles) * 2 * np.pi / angles
    count = settings * angles
    mount = rng.normal(size=3)
    mount *= np.radians(mount_deg) * rng.uniform() ** (1 / 3) / np.linalg.norm(mount)
    nominal = {
        "dK": rng.normal(0, 3e-3, 3),
        "bias": rng.normal(0, 3e-3, 3),
        "gamma": rng.normal(0, 1e-3, 3),
        "dtheta": mount,
        "dbeta": rng.uniform(-3e-3, 3e-3, settings),
    }
    time = np.cumsum(rng.uniform(50, 70, count))
    wander = np.cumsum(rng.normal(0, 0.15, count))
    return Setup(
        alpha=np.tile(turns, settings),
        beta=np.repeat(levels, angles),
        time_s=time,
        temperature_degc=soak_degc + rng.normal(0, 1) + wander + rng.normal(0, 0.1, count),
        approach=rng.choice([-1.0, 1.0], count),
        pitch=np.repeat(np.arange(settings), angles),
        nominal=nominal,
        names=[f"{k}-{j + 1}" for k in range(settings) for j in range(angles)],
    )


def extended(setup: Setup, cells: list[tuple[float, float]], rng: np.random.Generator) -> Setup:
    """The same instrument with more positions (alpha, beta in deg); a new pitch setting gets an error of its own."""
    levels, errors, pitch = [*np.unique(np.round(setup.beta, 9))], list(setup.nominal["dbeta"]), list(setup.pitch)
    for _, beta in cells:
        near = [k for k, level in enumerate(levels) if abs(level - np.radians(beta)) < 1e-6]
        if not near:
            levels.append(np.radians(beta))
            errors.append(rng.uniform(-3e-3, 3e-3))
        pitch.append(near[0] if near else len(levels) - 1)
    count = len(cells)
    return Setup(
        alpha=np.concatenate([setup.alpha, np.radians([alpha for alpha, _ in cells])]),
        beta=np.concatenate([setup.beta, np.radians([beta for _, beta in cells])]),
        time_s=np.concatenate([setup.time_s, setup.time_s[-1] + 60.0 * np.arange(1, count + 1)]),
        temperature_degc=np.concatenate([setup.temperature_degc, np.full(count, 25.0)]),
        approach=np.concatenate([setup.approach, np.ones(count)]),
        pitch=np.array(pitch),
        nominal=setup.nominal | {"dbeta": np.array(errors)},
        names=[*setup.names, *(f"next-{k + 1}" for k in range(count))],
    )


def readings(setup: Setup, nominal: dict[str, np.ndarray], effects: dict[str, np.ndarray]) -> np.ndarray:
    """Noise-free readings, g; effects in rad, g, s and their products."""
    mounting = setup.mountings
    level = setup.pitch + (setup.pitch.max() + 1) * mounting
    f = _in_the_fixture(setup, nominal["dbeta"][level], effects)
    f = _in_the_case(setup, f, nominal["dtheta"].reshape(-1, 3)[mounting], mounting, effects)
    return sensed(setup, f, nominal, effects)


def along_axes(f: np.ndarray, gamma: np.ndarray) -> np.ndarray:
    """Forces `f` of the frame of the case along the axes of the triad."""
    g21, g31, g32 = gamma
    return np.stack([f[:, 0], f[:, 1] + g21 * f[:, 0], f[:, 2] + g31 * f[:, 0] + g32 * f[:, 1]], axis=1)


def sensed(setup: Setup, f: np.ndarray, nominal: dict[str, np.ndarray], effects: dict[str, np.ndarray]) -> np.ndarray:
    """Readings of the triad, g, of forces `f` in the frame of its case."""
    mounting, u = setup.mountings, along_axes(f, nominal["gamma"])
    out = (1 + nominal["dK"]) * u + nominal["bias"]
    for i, a in enumerate(AXES):
        if not any(name.endswith(f".{a}") or f".{a}." in name for name in effects):
            continue
        for name, shapes in of_an_axis(setup, u, i, mounting).items():
            if name in effects:
                out[:, i] += sum(c * shape for c, shape in zip(effects[name], shapes, strict=True))
    if "warm_up" in effects:
        *amplitudes, tau = effects["warm_up"]
        out = out + np.exp(-(setup.time_s - setup.time_s[0]) / tau)[:, None] * np.array(amplitudes)
    for name in POLYNOMIALS.keys() & effects.keys():
        size, about = effects[name]
        axis, (kind, _, _) = AXES.index(name[-1]), name.partition("_polynomial")
        t, v = setup.time_s - setup.time_s[0], u[:, axis]
        shapes = {
            "temperature": (setup.temperature_degc - about) ** 2,
            "time": (t - about) ** 2,
            "input": v**2 + about * v**3,
        }
        out[:, axis] += size * shapes[kind]
    if "settling" in effects:
        *amplitudes, tau = effects["settling"]
        level = setup.pitch + (setup.pitch.max() + 1) * mounting
        began = np.array([setup.time_s[np.flatnonzero(level == own)[0]] for own in level])
        out = out + np.exp(-(setup.time_s - began) / tau)[:, None] * np.array(amplitudes)
    return out


def _in_the_fixture(setup: Setup, pitch_error: np.ndarray, effects: dict[str, np.ndarray]) -> np.ndarray:
    """Gravity as the head turns it into the frame of its fixture, g."""
    s, n = setup, len(setup.alpha)
    get = lambda name, size: np.asarray(effects.get(name, np.zeros(size)), float)  # noqa: E731
    f = np.tile([0.0, 0.0, 1.0], (n, 1)) * (1 + get("gravity_value", 1)[0])
    f = turned("x", get("base_levelling", 1)[0] * np.ones(n), f)
    f = turned("y", s.beta + pitch_error, f)
    f = turned("z", get("axis_perpendicularity", 1)[0] * np.ones(n), f)
    ecc, ell, tri = get("index_eccentricity", 2), get("index_ellipticity", 2), get("?index_third", 2)
    alpha = s.alpha + ecc[0] * np.cos(s.alpha) + ecc[1] * np.sin(s.alpha)
    alpha += ell[0] * np.cos(2 * s.alpha) + ell[1] * np.sin(2 * s.alpha)
    alpha += tri[0] * np.cos(3 * s.alpha) + tri[1] * np.sin(3 * s.alpha)
    alpha += np.append(0.0, get("index_zero", s.pitch.max()))[s.pitch]
    alpha += get("index_gain", 1)[0] * s.alpha + get("index_backlash", 1)[0] * s.approach
    for order in (1, 2):
        w = get(f"spindle_wobble_{order}", 4)
        f = turned("y", w[0] * np.cos(order * s.alpha) + w[1] * np.sin(order * s.alpha), f)
        f = turned("z", w[2] * np.cos(order * s.alpha) + w[3] * np.sin(order * s.alpha), f)
    f = turned("x", alpha, f)
    bend = get("fixture_flexure", 2)
    y_before = f[:, 1].copy()
    f = turned("y", bend[0] * f[:, 2], f)
    return turned("z", -bend[1] * y_before, f)


def _in_the_case(
    setup: Setup, f: np.ndarray, mount: np.ndarray, mounting: np.ndarray, effects: dict[str, np.ndarray]
) -> np.ndarray:
    """Vectors `f` of the fixture's frame in that of the triad's case, which is mounted with errors `mount`, rad."""
    f = f if setup.turns is None else np.einsum("nij,nj->ni", setup.turns[mounting], f)
    slip = np.asarray(effects.get("?mount_slip", np.zeros(3)), float)
    f = mounted(f, (mount + slip * _late(setup)[:, None]).T)
    rises = {"mount_drift": setup.time_s - setup.time_s[0], "mount_temperature": setup.temperature_degc - 25}
    for name, follows in rises.items():
        if name in effects:
            f = mounted(f, np.outer(effects[name], follows))
    if "mount_by_pitch" in effects:
        f = mounted(f, np.outer(effects["mount_by_pitch"], setup.pitch == 0))
    return f


def _late(setup: Setup) -> np.ndarray:
    """1 from the middle position on, 0 before."""
    n = len(setup.alpha)
    return (np.arange(n) >= n // 2).astype(float)


def of_an_axis(setup: Setup, u: np.ndarray, i: int, mounting: np.ndarray) -> dict[str, list[np.ndarray]]:
    """What one unit of each coefficient of each effect of axis `i` adds to its readings, of inputs `u`."""
    n, a, v = len(u), AXES[i], u[:, i]
    j, k = [o for o in range(3) if o != i]
    t, warm, late = setup.time_s - setup.time_s[0], setup.temperature_degc - 25, _late(setup)
    last = np.maximum(np.arange(n) - 1, 0)
    last = np.where(mounting[last] == mounting, last, np.arange(n))
    rate = 60 * np.append(0.0, np.diff(setup.temperature_degc) / np.diff(setup.time_s))
    at_pitch = [(setup.pitch == number).astype(float) for number in range(1, setup.pitch.max() + 1)]
    return {
        f"second_order.{a}": [v**2],
        f"third_order.{a}": [v**3],
        f"scale_asymmetry.{a}": [np.abs(v)],
        f"bias_asymmetry.{a}": [np.sign(v)],
        f"cross_coupling.{a}.xy": [u[:, 0] * u[:, 1]],
        f"cross_coupling.{a}.xz": [u[:, 0] * u[:, 2]],
        f"cross_coupling.{a}.yz": [u[:, 1] * u[:, 2]],
        f"cross_axis_square.{a}": [u[:, j] ** 2, u[:, k] ** 2],
        f"bias_drift.{a}": [t],
        f"scale_drift.{a}": [v * t],
        f"bias_temperature.{a}": [warm],
        f"scale_temperature.{a}": [v * warm],
        f"misalignment_drift.{a}": [u[:, j] * t, u[:, k] * t],
        f"misalignment_temperature.{a}": [u[:, j] * warm, u[:, k] * warm],
        f"fifth_order.{a}": [v**5],
        f"bias_by_pitch.{a}": at_pitch,
        f"scale_by_pitch.{a}": [v * own for own in at_pitch],
        f"memory.{a}": [v[last] - v],
        f"hysteresis.{a}": [np.clip((v - v[last]) / 0.1, -1, 1)],
        f"bias_temperature_square.{a}": [(setup.temperature_degc - setup.temperature_degc.mean()) ** 2],
        f"bias_drift_square.{a}": [(t - t.mean()) ** 2],
        f"temperature_rate.{a}": [rate],
        # No entry of the catalogue describes these.
        f"?square_times_sine.{a}": [v**2 * np.sin(setup.alpha)],
        f"?step_half_way.{a}": [late],
        f"?gain_step_half_way.{a}": [v * late],
        f"?hum.{a}": [np.sin(2 * np.pi * 3 * t / t[-1]), np.cos(2 * np.pi * 3 * t / t[-1])],
        f"?triple_product.{a}": [u[:, 0] * u[:, 1] * u[:, 2]],
        f"?parabolic_drift.{a}": [(t / t[-1] - 0.5) ** 2],
    }


# Number of coefficients of each effect; those with ? are described by no entry of the catalogue.
COEFFICIENTS = {
    "base_levelling": 1,
    "axis_perpendicularity": 1,
    "index_eccentricity": 2,
    "index_ellipticity": 2,
    "index_gain": 1,
    "index_backlash": 1,
    "spindle_wobble_1": 4,
    "spindle_wobble_2": 4,
    "fixture_flexure": 2,
    "gravity_value": 1,
    **{f"{name}.{a}": 1 for name in ("second_order", "third_order", "scale_asymmetry", "bias_asymmetry") for a in AXES},
    **{f"cross_coupling.{a}.{pair}": 1 for a in AXES for pair in ("xy", "xz", "yz")},
    **{f"cross_axis_square.{a}": 2 for a in AXES},
    **{f"{n}_{k}.{a}": 1 for n in ("bias", "scale") for k in ("drift", "temperature") for a in AXES},
    "warm_up": 3,
}
# Causes met less often; by setting there is one coefficient fewer than pitch settings.
BY_SETTING = -1
RARE = {
    **{
        f"{name}.{a}": 1
        for name in (
            "fifth_order",
            "memory",
            "hysteresis",
            "bias_temperature_square",
            "bias_drift_square",
            "temperature_rate",
        )
        for a in AXES
    },
    **{f"{name}_by_pitch.{a}": BY_SETTING for name in ("bias", "scale") for a in AXES},
    "index_zero": BY_SETTING,
    "settling": 3,
    **{f"misalignment_{by}.{a}": 2 for by in ("drift", "temperature") for a in AXES},
    "mount_drift": 3,
    "mount_temperature": 3,
    # At the first setting.
    "mount_by_pitch": 3,
}
# Squares about references other than the mean, and an input's square with its cube: what is to be found of each.
POLYNOMIALS = {
    f"{kind}_polynomial.{a}": (f"{first}.{a}", f"{second}.{a}")
    for kind, first, second in (
        ("temperature", "bias_temperature", "bias_temperature_square"),
        ("time", "bias_drift", "bias_drift_square"),
        ("input", "second_order", "third_order"),
    )
    for a in AXES
}
# From the middle position on.
JUMPS = {"?mount_slip": 3, **{f"?step_half_way.{a}": 1 for a in AXES}}
UNKNOWN = {
    "?index_third": 2,
    **{f"?square_times_sine.{a}": 1 for a in AXES},
    **{f"?gain_step_half_way.{a}": 1 for a in AXES},
    **{f"?hum.{a}": 2 for a in AXES},
    **{f"?triple_product.{a}": 1 for a in AXES},
}


def knocked(
    setup: Setup, projector: np.ndarray, measured: np.ndarray, position: int, rng: np.random.Generator
) -> tuple[np.ndarray, str]:
    """The readings with one position off by 8 sigma in a random direction, and the fault's label."""
    unit = np.zeros_like(measured)
    unit[position] = rng.normal(size=3)
    size = np.linalg.norm(projector @ unit.ravel())
    return measured + unit * 8 * SIGMA / size, f"outlier_position:{setup.names[position]}"


def exchanged(
    setup: Setup, projector: np.ndarray, measured: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, str] | None:
    """The readings with those of two positions exchanged, and the fault's label; None where it does not show."""
    i, j = sorted(rng.choice(len(measured), 2, replace=False))
    swapped = measured.copy()
    swapped[[i, j]] = measured[[j, i]]
    if np.linalg.norm(projector @ (swapped - measured).ravel()) < 8 * SIGMA:
        return None
    return swapped, f"swapped_positions:{setup.names[i]}+{setup.names[j]}"


def nominal_columns(setup: Setup) -> np.ndarray:
    """Readings by the nominal parameters near the truth, (readings, parameters): central differences."""
    base = setup.nominal
    columns = []
    for name, values in base.items():
        for k in range(len(values)):
            shifted = []
            for sign in (1, -1):
                moved = {key: value.copy() for key, value in base.items()}
                moved[name][k] += sign * 1e-5
                shifted.append(readings(setup, moved, {}).ravel())
            columns.append((shifted[0] - shifted[1]) / 2e-5)
    return np.stack(columns, axis=1)


def unreachable(setup: Setup) -> np.ndarray:
    """Projector on what the nominal model cannot reach near the truth."""
    q, _ = np.linalg.qr(nominal_columns(setup))
    return np.eye(len(q)) - q @ q.T


def sized(
    setup: Setup, projector: np.ndarray, name: str, d: float, rng: np.random.Generator, least_share: float = 0.05
) -> tuple[np.ndarray, np.ndarray, float] | None:
    """Coefficients in a random direction whose unreachable part has norm d sigma.

    Returns coefficients, unreachable signal / sigma, visible share; None when less than `least_share` of it is visible.
    """
    count = 1 if name in POLYNOMIALS else (COEFFICIENTS | RARE | JUMPS | UNKNOWN)[name]
    direction = rng.normal(size=setup.pitch.max() if count == BY_SETTING else count)
    tail = [rng.uniform(0.07, 0.5) * np.ptp(setup.time_s)] if name == "warm_up" else []
    tail = [rng.uniform(40, 250)] if name == "settling" else tail
    tail = [_about(setup, name, rng)] if name in POLYNOMIALS else tail
    plain = readings(setup, setup.nominal, {})
    size = 1e-6
    for _ in range(4):
        coefficients = np.array([*(size * direction), *tail])
        whole = (readings(setup, setup.nominal, {name: coefficients}) - plain).ravel() / SIGMA
        signal = projector @ whole
        norm = np.linalg.norm(signal)
        if norm < least_share * np.linalg.norm(whole):
            return None
        size *= d / norm
    return coefficients, signal, float(norm / np.linalg.norm(whole))


def _about(setup: Setup, name: str, rng: np.random.Generator) -> float:
    """Where the parabola of a polynomial turns, degC or s, within the run and as far beyond; of an input how much cube there is
    beside the square."""
    if name.startswith("input"):
        return float(rng.uniform(0.5, 2.0) * rng.choice([-1, 1]))
    along = setup.temperature_degc if name.startswith("temperature") else setup.time_s - setup.time_s[0]
    return float(along.min() + rng.uniform(-0.5, 1.5) * np.ptp(along))


def resembles_none(setup: Setup, projector: np.ndarray, signal: np.ndarray, least: float) -> bool:
    """Whether every single entry of the catalogue leaves at least `least` sigma of a signal unexplained.

    A cause that some entry describes to within the noise is not one "that no entry describes".
    """
    for columns in _entries(setup):
        left, singular, _ = np.linalg.svd(projector @ columns, full_matrices=False)
        span = left[:, singular > 1e-3 * singular[0]]
        if np.linalg.norm(signal - span @ (span.T @ signal)) < least:
            return False
    return True


def _entries(setup: Setup) -> Iterator[np.ndarray]:
    """What each effect, and each jump from any position on, does to all readings: (rows, coefficients)."""
    plain, span = readings(setup, setup.nominal, {}), np.ptp(setup.time_s)
    tails = {"warm_up": [0.2 * span], "settling": [120.0]}
    for name, count in (COEFFICIENTS | RARE).items():
        number, tail = setup.pitch.max() if count == BY_SETTING else count, tails.get(name, [])
        step = 1e-8 if name.endswith(("gain", "temperature", "drift")) or "drift" in name else 1e-5
        changed = (readings(setup, setup.nominal, {name: [*(step * unit), *tail]}) for unit in np.eye(number))
        yield np.stack([(own - plain).ravel() for own in changed], axis=1)
    turned_by = [setup.nominal | {"dtheta": setup.nominal["dtheta"] + 1e-5 * unit} for unit in np.eye(3)]
    slips = np.stack([readings(setup, nominal, {}) - plain for nominal in turned_by], axis=2)
    biases = np.broadcast_to(1e-5 * np.eye(3), (len(plain), 3, 3))
    for position in range(1, len(plain)):
        late = (np.arange(len(plain)) >= position)[:, None, None]
        yield (slips * late).reshape(-1, 3)
        yield from ((biases * late)[:, :, axis].reshape(-1, 1) for axis in range(3))

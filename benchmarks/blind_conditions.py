"""The conditions of the stress study: what is hidden in what instrument, and the position file that a user would have."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import blind_instrument as blind
from blind_independent import INDEPENDENT
from blind_independent_more import INDEPENDENT_MORE
from blind_judge import Case
from blind_mistakes import AXES, MISTAKES, OF_ANGLES, Columns
from blind_plans import remounted, swept, twice
from blind_sized import Sized, sized_to
from blind_unlisted import LATER, UNLISTED, square_of_another_axis
from blind_unseen import LATEST, UNSEEN
from tumblecal.data import PositionSet, read_positions


PLANS = {"3x4": (3, 4), "3x8": (3, 8), "4x12": (4, 12), "5x16": (5, 16)}
NAMES = list(blind.COEFFICIENTS)
_TRIES = 500


@dataclass(frozen=True)
class Condition:
    """What is hidden.

    - `draw`: names of the effects (of `blind.COEFFICIENTS`), drawn anew for each case; `sizes`: d of each.
    - `unlisted`: a cause that is in no catalogue, with `sizes[0]`.
    - `mount_deg`, `bias_g`: largest mount, and biases that are evenly spread up to this where it is not 0.
    - `soak_degc`: mean temperature; `sweep_degc`: temperatures that the run goes through.
    - `least_share`: of an effect that must be visible; `most_cosine`: of two effects' signals.
    - `outliers`, `swap`: gross faults added. `repeat`: "" or how the plan is measured twice.
    - `turns_deg`: how the triad stands in each of its mountings, Rx Ry Rz; none: it is not remounted.
    - `mistake`: of `MISTAKES`, done to the finished file; `mistaken`: only to the rows of this mounting.
    - `plans`: those that it is drawn from.
    """

    draw: Callable[[np.random.Generator], Sequence[str]] = lambda rng: ()
    sizes: tuple[float, ...] = ()
    unlisted: Callable[[blind.Setup, np.random.Generator], Sized] | None = None
    mount_deg: float = 1.0
    bias_g: float = 0.0
    soak_degc: float = 25.0
    sweep_degc: tuple[float, ...] = ()
    least_share: float = 0.05
    most_cosine: float = 0.5
    outliers: int = 0
    swap: bool = False
    repeat: str = ""
    turns_deg: tuple[tuple[float, float, float], ...] = ()
    mistake: str = ""
    mistaken: str = ""
    plans: tuple[str, ...] = tuple(PLANS)


def drawn(name: str, rng: np.random.Generator, number: int = 0) -> Case:
    """A case of a condition; `data`: the columns of its position file."""
    condition = CONDITIONS[name]
    plan, known = str(rng.choice(condition.plans)), bool(rng.integers(2))
    for _ in range(_TRIES):
        setup = blind.random_setup(rng, *PLANS[plan], condition.mount_deg, soak_degc=condition.soak_degc)
        if condition.bias_g:
            setup.nominal["bias"] = rng.uniform(-condition.bias_g, condition.bias_g, 3)
        if condition.sweep_degc:
            setup = swept(setup, condition.sweep_degc, rng)
        if condition.repeat:
            setup = twice(setup, condition.repeat)
        if condition.turns_deg:
            setup = remounted(setup, condition.turns_deg, rng)
        projector = blind.unreachable(setup)
        hidden = _hidden(condition, setup, projector, rng)
        if hidden is None:
            continue
        clean, truth = hidden
        measured = clean + blind.SIGMA * rng.normal(size=clean.shape)
        measured, gross = _gross(condition, setup, projector, measured, rng)
        if gross is None:
            continue
        columns = columns_of(setup, measured, known, condition.repeat)
        accepted = (tuple(sorted([*truth, *gross])),)
        if condition.mistake:
            spoil, ids = MISTAKES[condition.mistake]
            rows = columns["mount"] == condition.mistaken if condition.mistaken else slice(None)
            part = {column: values[rows].copy() for column, values in columns.items()}
            spoil(part, rng)
            for column, values in part.items():
                columns[column][rows] = values
            accepted = tuple(tuple(sorted([*accepted[0], id])) for id in ids)
        if condition.unlisted is square_of_another_axis:
            # Lies in their span where attitudes are free: the same signal under other names.
            accepted = (*accepted, tuple(f"third_order.{axis}" for axis in blind.AXES))
        return Case(name, number, plan, known, accepted, columns, refusal=bool(condition.mistake))
    raise RuntimeError(f"{name}: nothing drawn in {_TRIES} tries with {plan}")


def _hidden(condition, setup, projector, rng) -> tuple[np.ndarray, list[str]] | None:
    """Clean readings and the names in them; None where the draw is no fair case."""
    if condition.unlisted is not None:
        sized = condition.unlisted(setup, rng)
        scaled = sized_to(sized, projector, blind.SIGMA, condition.sizes[0])
        if (
            scaled is None
            or not blind.resembles_none(setup, projector, scaled[1], 5.0)
            or _in_one(projector, scaled[1])
        ):
            return None
        return sized(scaled[0]), ["unexplained"]
    names = list(condition.draw(rng))
    effects, signals = {}, []
    for name, d in zip(names, condition.sizes, strict=True):
        scaled = blind.sized(setup, projector, name, d, rng, condition.least_share)
        if scaled is None:
            return None
        signals.append(scaled[1] / np.linalg.norm(scaled[1]))
        effects[name] = scaled[0]
    if any(abs(a @ b) > condition.most_cosine for i, a in enumerate(signals) for b in signals[:i]):
        return None
    for name, (coefficient, *_) in effects.items() if condition.soak_degc != 25.0 else ():
        # What it makes of the soak's mean is part of the scale and bias there, which are as small as any.
        leaf = "bias" if name.startswith("bias") else "dK"
        setup.nominal[leaf][blind.AXES.index(name[-1])] -= coefficient * (condition.soak_degc - 25.0)
    return blind.readings(setup, setup.nominal, effects), names


def _in_one(projector: np.ndarray, signal: np.ndarray) -> bool:
    """Whether one position off would explain a signal to within 5 sigma."""
    spans = (np.linalg.qr(projector[:, first : first + 3])[0] for first in range(0, len(signal), 3))
    return any(np.linalg.norm(signal - span @ (span.T @ signal)) < 5.0 for span in spans)


def _gross(condition, setup, projector, measured, rng) -> tuple[np.ndarray, list[str] | None]:
    """The readings with outlying positions or a swap, and their labels; None for a swap that does not show."""
    labels = []
    for position in rng.choice(len(measured), condition.outliers, replace=False):
        measured, label = blind.knocked(setup, projector, measured, position, rng)
        labels.append(label)
    if condition.swap:
        if (swap := blind.exchanged(setup, projector, measured, rng)) is None:
            return measured, None
        measured, label = swap
        labels.append(label)
    return measured, labels


def columns_of(setup: blind.Setup, measured: np.ndarray, known: bool, repeat: str = "") -> Columns:
    """The columns of a position file."""
    count = len(measured)
    columns: Columns = {
        "position": np.array(setup.names),
        "alpha_deg": np.degrees(setup.alpha).round(9),
        "beta_deg": np.degrees(setup.beta).round(9),
        "time_s": setup.time_s,
        "temperature_degc": setup.temperature_degc,
        "approach": setup.approach,
        **{name: measured[:, k].copy() for k, name in enumerate(AXES)},
    }
    if known:
        columns |= {f"a{axis}_sd_g": np.full(count, blind.SIGMA) for axis in blind.AXES}
    if repeat == "two runs":
        columns["run"] = np.repeat(["1", "2"], count // 2)
    if setup.mounting is not None:
        columns["mount"] = np.array(list("ABC"))[setup.mounting]
    return columns


def positions_of(columns: Columns) -> PositionSet:
    """The position set that is read from these columns."""
    with TemporaryDirectory() as folder:
        write(Path(folder) / "unit.csv", columns)
        return read_positions(Path(folder) / "unit.csv", check_size=False)


def write(path: Path, columns: Columns) -> None:
    """A position file as text."""
    cells = ([str(cell) for cell in values.tolist()] for values in columns.values())
    rows = zip(*cells, strict=True)
    path.write_text("\n".join([",".join(columns), *(",".join(row) for row in rows)]) + "\n")


def several(count: int, names: Sequence[str] = NAMES) -> Callable:
    """So many different effects of these."""
    return lambda rng: [names[k] for k in rng.choice(len(names), count, replace=False)]


def on_three_axes(*families: str, count: int = 1) -> Callable:
    """So many of these families, on each axis with a coefficient of its own."""
    return lambda rng: [f"{own}.{axis}" for own in rng.choice(families, count, replace=False) for axis in blind.AXES]


FAMILIES = sorted({name.rpartition(".")[0] for name in NAMES if name.endswith(".y") and name.count(".") == 1})
# Twelve positions cannot hold three causes apart, nor a bump from a position off.
LARGER = ("3x8", "4x12", "5x16")
WITHOUT_ENTRY = {"unlisted": UNLISTED | LATER | LATEST | UNSEEN, "independent": INDEPENDENT | INDEPENDENT_MORE}
THERMAL = [name for name in NAMES if "temperature" in name]
BEFORE = [f"{name}.{axis}" for name in ("memory", "hysteresis") for axis in blind.AXES]
JUMPS = [name for name in NAMES if name.startswith("bias_asymmetry")]
SIX = tuple(f"{leaf}_temperature.{axis}" for leaf in ("bias", "scale") for axis in blind.AXES)
CHAMBER = {
    "bias and scale factor": SIX,
    "bias, scale factor and a wobble": (*SIX, "spindle_wobble_2"),
    "bias, its square and scale factor": (*SIX, *(f"bias_temperature_square.{axis}" for axis in blind.AXES)),
}


def a_jump_and_another(rng: np.random.Generator) -> list[str]:
    """An effect that jumps with the sign of an input, and one that does not."""
    others = [name for name in NAMES if name not in JUMPS]
    return [str(rng.choice(JUMPS)), str(rng.choice(others))]


CONDITIONS: dict[str, Condition] = {
    "nothing": Condition(),
    "nothing, 10 deg mount, 0.2 g bias": Condition(mount_deg=10.0, bias_g=0.2),
    **{f"one, d = {d}": Condition(several(1), (d,)) for d in (5, 7, 10, 30, 100, 1000)},
    **{f"two, d = {d}": Condition(several(2), (d, d)) for d in (8, 30, 100)},
    **{f"three, d = {d}": Condition(several(3), (d, d, d), plans=LARGER) for d in (12, 30)},
    **{f"two, d = {d} and 8": Condition(several(2), (d, 8)) for d in (100, 1000)},
    **{f"a jump at zero input, d = {d}": Condition(several(1, JUMPS), (d,)) for d in (30, 100, 1000)},
    **{f"a jump at zero input and another, d = {d} each": Condition(a_jump_and_another, (d, d)) for d in (30, 300)},
    "three, d = 1000, 20 and 9": Condition(several(3), (1000, 20, 9), plans=LARGER),
    **{
        f"{kind} beside {words}, d = {d}": Condition(names, (d,), plans=LARGER, **gross)
        for d in (100, 1000)
        for words, names in {"one": several(1), "a jump at zero input": several(1, JUMPS)}.items()
        for kind, gross in {"outlier": {"outliers": 1}, "swap": {"swap": True}}.items()
    },
    **{
        f"{words} in a chamber, d = {d} each": Condition(
            lambda rng, names=names: names,
            (d,) * len(names),
            sweep_degc=(-20, 70, 25, 40),
            most_cosine=0.9,
            plans=LARGER,
        )
        for d in (10, 100)
        for words, names in CHAMBER.items()
    },
    "10 deg mount, one d = 8": Condition(several(1), (8,), mount_deg=10.0),
    **{
        f"10 deg mount, the position before, d = {d}": Condition(several(1, BEFORE), (d,), mount_deg=10.0)
        for d in (8, 100, 1000)
    },
    "0.2 g bias, one d = 8": Condition(several(1), (8,), bias_g=0.2),
    **{
        f"soak at {soak} degC, thermal d = 8": Condition(several(1, THERMAL), (8,), soak_degc=soak, least_share=0.0)
        for soak in (-40, 25, 45, 60, 85)
    },
    **{f"on three axes, d = {d} each": Condition(on_three_axes(*FAMILIES), (d, d, d)) for d in (4, 7)},
    **{
        f"two families on three axes, d = {d} each": Condition(
            on_three_axes(*FAMILIES, count=2), (d,) * 6, most_cosine=0.8, plans=LARGER
        )
        for d in (10, 30)
    },
    **{
        f"drift on three axes, d = {d} each": Condition(on_three_axes("bias_drift", "scale_drift"), (d, d, d))
        for d in (4, 7)
    },
    **{f"{count} outlier(s)": Condition(outliers=count) for count in (1, 2, 3)},
    **{f"{count} outlier(s), one d = 8": Condition(several(1), (8,), outliers=count) for count in (1, 2, 3)},
    "swap": Condition(swap=True),
    "swap, one d = 8": Condition(several(1), (8,), swap=True),
    **{
        f"plan twice in {repeat}, {words}": Condition(sizes=(12,), unlisted=unlisted, repeat=repeat)
        for repeat in ("one run", "two runs")
        for words, unlisted in {"u_x u_y^2": square_of_another_axis, "cable pull": UNLISTED["cable pull"]}.items()
    },
    **{
        f"{listed}: {words}, d = {d}": Condition(sizes=(d,), unlisted=unlisted, plans=LARGER)
        for d in (10, 30, 100)
        for listed, causes in WITHOUT_ENTRY.items()
        for words, unlisted in causes.items()
    },
    **{
        f"remounted, {words}": Condition(draw, sizes, turns_deg=turns, plans=("3x4", "3x8"))
        for turns in (((0, 0, 0), (0, 0, 90)),)
        for words, draw, sizes in (
            ("nothing", several(0), ()),
            *((f"one, d = {d}", several(1), (d,)) for d in (8, 100)),
            *((f"one met less often, d = {d}", several(1, list(blind.RARE)), (d,)) for d in (8, 100)),
        )
    },
    **{
        f"remounted, mistake{place}: {words}": Condition(
            mistake=words, mistaken=place[-1:], turns_deg=turns, plans=plans
        )
        for place, turns, plans in (
            ("", ((0, 0, 0), (0, 90, 0), (180, 0, 0)), ("3x4",)),
            (" in B", ((0, 0, 0), (0, 0, 90)), ("3x4", "3x8")),
        )
        for words in OF_ANGLES
    },
    **{f"mistake: {words}": Condition(mistake=words) for words in MISTAKES},
    "mistake: temperature in kelvin, thermal d = 8": Condition(
        several(1, THERMAL), (8,), mistake="temperature in kelvin"
    ),
}

"""The population `stress`: what is hidden in which instrument, as data, and the position file that a user would have.

The diagnosis was not tuned for these conditions. A set-up error must be rejected with a message, or named and corrected.
"""

import json
import subprocess
import sys
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import blind_instrument as blind
from blind.acting import Sized, sized_to
from blind.judge import Answer, Case, answer_of_record
from blind.mistakes import AXES, MISTAKES, OF_ANGLES, Columns
from blind.plans import LARGER, PLANS, remounted, swept, twice
from blind.unlisted import INDEPENDENT, LATER, LATEST, UNLISTED, UNSEEN, square_of_another_axis
from tumblecal.data import PositionSet, read_positions


NAMES = list(blind.COEFFICIENTS)
_TRIES = 500
Turns = tuple[tuple[float, float, float], ...]


@dataclass(frozen=True)
class Condition:
    """What is hidden.

    - `draw`: names of the effects, drawn for each case; `sizes`: d of each. `unlisted`: a cause without an entry, of
      `sizes[0]`.
    - `mount_deg`: largest mount; `bias_g`: largest bias, if not 0. `soak_degc`: mean temperature; `sweep_degc`: of a chamber.
    - `least_share`: of an effect that must be visible; `most_cosine`: of the signals of two effects.
    - `outliers`, `swap`: gross faults. `repeat`: how the plan is measured twice. `turns_deg`: orientation in each mounting.
    - `mistake`: set-up error in the finished file; `mistaken`: only in the rows of this mounting.
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
    turns_deg: Turns = ()
    mistake: str = ""
    mistaken: str = ""
    plans: tuple[str, ...] = tuple(PLANS)


def several(count: int, names: Sequence[str] = NAMES) -> Callable:
    """So many different effects of these."""
    return lambda rng: [names[k] for k in rng.choice(len(names), count, replace=False)]


def on_three_axes(*families: str, count: int = 1) -> Callable:
    """So many of these families, on each axis with a coefficient of its own."""
    return lambda rng: [f"{own}.{axis}" for own in rng.choice(families, count, replace=False) for axis in blind.AXES]


def a_jump_and_another(rng: np.random.Generator) -> list[str]:
    """An effect that jumps with the sign of an input, and one that does not."""
    others = [name for name in NAMES if name not in JUMPS]
    return [str(rng.choice(JUMPS)), str(rng.choice(others))]


FAMILIES = sorted({name.rpartition(".")[0] for name in NAMES if name.endswith(".y") and name.count(".") == 1})
THERMAL = [name for name in NAMES if "temperature" in name]
BEFORE = [f"{name}.{axis}" for name in ("memory", "hysteresis") for axis in blind.AXES]
JUMPS = [name for name in NAMES if name.startswith("bias_asymmetry")]
SIX = tuple(f"{leaf}_temperature.{axis}" for leaf in ("bias", "scale") for axis in blind.AXES)
CHAMBER = {
    "bias and scale factor": SIX,
    "bias, scale factor and a wobble": (*SIX, "spindle_wobble_2"),
    "bias, its square and scale factor": (*SIX, *(f"bias_temperature_square.{axis}" for axis in blind.AXES)),
}
WITHOUT_ENTRY = {"unlisted": UNLISTED | LATER | LATEST | UNSEEN, "independent": INDEPENDENT}
GROSS = {"outlier": {"outliers": 1}, "swap": {"swap": True}}
QUARTER_TURN: Turns = ((0, 0, 0), (0, 0, 90))


def _chamber(names: Sequence[str], d: float) -> Condition:
    return Condition(lambda rng: names, (d,) * len(names), sweep_degc=(-20, 70, 25, 40), most_cosine=0.9, plans=LARGER)


def _conditions() -> Iterator[tuple[str, Condition]]:
    one = several(1)
    yield "nothing", Condition()
    yield "nothing, 10 deg mount, 0.2 g bias", Condition(mount_deg=10.0, bias_g=0.2)
    for d in (5, 7, 10, 30, 100, 1000):
        yield f"one, d = {d}", Condition(one, (d,))
    for d in (8, 30, 100):
        yield f"two, d = {d}", Condition(several(2), (d, d))
    for d in (12, 30):
        yield f"three, d = {d}", Condition(several(3), (d, d, d), plans=LARGER)
    for d in (100, 1000):
        yield f"two, d = {d} and 8", Condition(several(2), (d, 8))
    for d in (30, 100, 1000):
        yield f"a jump at zero input, d = {d}", Condition(several(1, JUMPS), (d,))
    for d in (30, 300):
        yield f"a jump at zero input and another, d = {d} each", Condition(a_jump_and_another, (d, d))
    yield "three, d = 1000, 20 and 9", Condition(several(3), (1000, 20, 9), plans=LARGER)
    for d in (100, 1000):
        for words, names in {"one": one, "a jump at zero input": several(1, JUMPS)}.items():
            for kind, gross in GROSS.items():
                yield f"{kind} beside {words}, d = {d}", Condition(names, (d,), plans=LARGER, **gross)
    for d in (10, 100):
        for words, names in CHAMBER.items():
            yield f"{words} in a chamber, d = {d} each", _chamber(names, d)
    yield "10 deg mount, one d = 8", Condition(one, (8,), mount_deg=10.0)
    for d in (8, 100, 1000):
        yield f"10 deg mount, the position before, d = {d}", Condition(several(1, BEFORE), (d,), mount_deg=10.0)
    yield "0.2 g bias, one d = 8", Condition(one, (8,), bias_g=0.2)
    for soak in (-40, 25, 45, 60, 85):
        yield (
            f"soak at {soak} degC, thermal d = 8",
            Condition(several(1, THERMAL), (8,), soak_degc=soak, least_share=0.0),
        )
    for d in (4, 7):
        yield f"on three axes, d = {d} each", Condition(on_three_axes(*FAMILIES), (d, d, d))
    for d in (10, 30):
        two = on_three_axes(*FAMILIES, count=2)
        yield f"two families on three axes, d = {d} each", Condition(two, (d,) * 6, most_cosine=0.8, plans=LARGER)
    for d in (4, 7):
        yield (
            f"drift on three axes, d = {d} each",
            Condition(on_three_axes("bias_drift", "scale_drift"), (d, d, d)),
        )
    for count in (1, 2, 3):
        yield f"{count} outlier(s)", Condition(outliers=count)
    for count in (1, 2, 3):
        yield f"{count} outlier(s), one d = 8", Condition(one, (8,), outliers=count)
    yield "swap", Condition(swap=True)
    yield "swap, one d = 8", Condition(one, (8,), swap=True)
    for repeat in ("one run", "two runs"):
        for words, cause in {"u_x u_y^2": square_of_another_axis, "cable pull": UNLISTED["cable pull"]}.items():
            yield f"plan twice in {repeat}, {words}", Condition(sizes=(12,), unlisted=cause, repeat=repeat)
    for d in (10, 30, 100):
        for listed, causes in WITHOUT_ENTRY.items():
            for words, cause in causes.items():
                yield f"{listed}: {words}, d = {d}", Condition(sizes=(d,), unlisted=cause, plans=LARGER)
    turned = {"turns_deg": QUARTER_TURN, "plans": ("3x4", "3x8")}
    yield "remounted, nothing", Condition(several(0), **turned)
    for words, names in {"one": NAMES, "one met less often": list(blind.RARE)}.items():
        for d in (8, 100):
            yield f"remounted, {words}, d = {d}", Condition(several(1, names), (d,), **turned)
    three = {"turns_deg": ((0, 0, 0), (0, 90, 0), (180, 0, 0)), "plans": ("3x4",)}
    for place, mounted in (("", three), (" in B", turned)):
        for words in OF_ANGLES:
            yield (
                f"remounted, mistake{place}: {words}",
                Condition(mistake=words, mistaken=place[-1:], **mounted),
            )
    for words in MISTAKES:
        yield f"mistake: {words}", Condition(mistake=words)
    yield (
        "mistake: temperature in kelvin, thermal d = 8",
        Condition(several(1, THERMAL), (8,), mistake="temperature in kelvin"),
    )


CONDITIONS = dict(_conditions())
KINDS = CONDITIONS


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
        measured, gross = clean + blind.SIGMA * rng.normal(size=clean.shape), []
        for position in rng.choice(len(measured), condition.outliers, replace=False):
            measured, label = blind.knocked(setup, projector, measured, position, rng)
            gross.append(label)
        if condition.swap:
            if (swap := blind.exchanged(setup, projector, measured, rng)) is None:
                continue
            measured, label = swap
            gross.append(label)
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
            # The same signal under other names where the attitudes are free.
            accepted = (*accepted, tuple(f"third_order.{axis}" for axis in blind.AXES))
        return Case(name, number, plan, known, accepted, columns, refusal=bool(condition.mistake))
    raise RuntimeError(f"{name}: nothing drawn in {_TRIES} tries with {plan}")


def _hidden(condition: Condition, setup: blind.Setup, projector, rng) -> tuple[np.ndarray, list[str]] | None:
    """Clean readings and the names in them; None if the draw is no fair case."""
    if condition.unlisted is not None:
        sized = condition.unlisted(setup, rng)
        scaled = sized_to(sized, projector, blind.SIGMA, condition.sizes[0])
        if scaled is None or not blind.resembles_none(setup, projector, scaled[1], 5.0):
            return None
        return None if _is_one_outlier(projector, scaled[1]) else (sized(scaled[0]), ["unexplained"])
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
        # Its part at the mean temperature belongs to scale factor and bias, which are as small as any.
        leaf = "bias" if name.startswith("bias") else "dK"
        setup.nominal[leaf][blind.AXES.index(name[-1])] -= coefficient * (condition.soak_degc - 25.0)
    return blind.readings(setup, setup.nominal, effects), names


def _is_one_outlier(projector: np.ndarray, signal: np.ndarray) -> bool:
    """Whether one outlier position would explain a signal to within 5 sigma."""
    spans = (np.linalg.qr(projector[:, first : first + 3])[0] for first in range(0, len(signal), 3))
    return any(np.linalg.norm(signal - span @ (span.T @ signal)) < 5.0 for span in spans)


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


def write(path: Path, columns: Columns, *comments: str) -> None:
    """A position file as text."""
    cells = ([str(cell) for cell in values.tolist()] for values in columns.values())
    rows = zip(*cells, strict=True)
    path.write_text("\n".join([*comments, ",".join(columns), *(",".join(row) for row in rows)]) + "\n")


def positions_of(columns: Columns) -> PositionSet:
    """The position set that is read from these columns."""
    with TemporaryDirectory() as folder:
        write(Path(folder) / "unit.csv", columns)
        return read_positions(Path(folder) / "unit.csv", check_size=False)


def cases(kind: str, count: int, seed: int) -> Iterator[Case]:
    """So many position files of a condition."""
    rng = np.random.default_rng([seed, zlib.crc32(kind.encode())])
    return (drawn(kind, rng, number) for number in range(count))


def answered(cases: Iterable[Case]) -> Iterator[tuple[Case, Answer]]:
    """All cases of a condition by one command."""
    for _, group in groupby(cases, key=lambda case: case.kind):
        batch = list(group)
        with TemporaryDirectory() as folder:
            files = [Path(folder) / f"unit{k:04d}.csv" for k in range(len(batch))]
            for file, case in zip(files, batch, strict=True):
                write(file, case.data)
            refused = diagnosed(files, Path(folder) / "out")
            for file, case in zip(files, batch, strict=True):
                record = None if file in refused else json.loads(_record(file, Path(folder) / "out").read_text())
                yield case, answer_of_record(record, refused.get(file, "").replace(str(file), file.name))


def diagnosed(files: list[Path], out: Path) -> dict[Path, str]:
    """Diagnose all files; the messages about those without a result. A traceback ends a command: it then runs again without
    its file."""
    refused: dict[Path, str] = {}
    while waiting := [file for file in files if file not in refused and not _record(file, out).exists()]:
        # The results of a single file are in `out` itself.
        folder = out if len(waiting) > 1 else out / waiting[0].stem
        command = [sys.executable, "-m", "tumblecal.cli", "diagnose", *map(str, waiting), "--out", str(folder)]
        done = subprocess.run([*command, "--workers", "1", "--no-figures"], capture_output=True, text=True)
        lines = done.stderr.strip().splitlines()
        for file in waiting if done.returncode == 2 else ():
            own = [line for line in lines if str(file) in line]
            if own and not _record(file, out).exists():
                refused[file] = own[0]
        rest = [file for file in waiting if file not in refused and not _record(file, out).exists()]
        if rest:
            refused[rest[0]] = f"crash ({done.returncode}): {lines[-1] if lines else ''}"
    return refused


def _record(file: Path, out: Path) -> Path:
    return out / file.stem / "diagnosis.json"

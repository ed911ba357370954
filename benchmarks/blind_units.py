"""Many units on one head: is an error of the head named, and is a sensor's never called the head's? Of `blind_study.py`.

Hides effects in batches of the blind instrument (plain numpy), whose units differ in everything else, and gives each batch to
`tumblecal diagnose --units`. The size d is the norm, in sigma, of the part that the nominal model leaves of the effect in the
first unit. `right`: the hidden error, or one of its equivalents, is the best explanation; `wrong`: an error is called shared
that is not. `--option alone` names the same errors file by file; `--option screen` stops where the command would diagnose every
unit again with the head known: the same answer on the shared errors, in a tenth of the time.

    python benchmarks/blind_units.py 8 200

times the command on so many units.
"""

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import blind_instrument as blind
import tumblecal


tumblecal.enable_float64()
from blind_judge import Answer, Case  # noqa: E402
from blind_noise import position_set  # noqa: E402
from tumblecal.data import PositionSet, write_positions  # noqa: E402
from tumblecal.diagnosis import Diagnoser  # noqa: E402
from tumblecal.diagnosis.units import joint_diagnosis  # noqa: E402


HEAD = (
    "base_levelling",
    "axis_perpendicularity",
    "index_eccentricity",
    "index_ellipticity",
    "index_gain",
    "index_backlash",
    "spindle_wobble_1",
    "spindle_wobble_2",
    "fixture_flexure",
    "gravity_value",
)
SENSOR = tuple(name for name in blind.COEFFICIENTS if name not in HEAD)
MIXED = ((3, 8), (4, 12), (3, 6), (5, 8))
Effects = list[dict[str, np.ndarray]]


@dataclass(frozen=True)
class Condition:
    """What is hidden in a batch: `hide` gives the effects of every unit and the name that all share (None: nothing)."""

    units: int
    hide: Callable[[np.random.Generator, list[blind.Setup]], tuple[Effects, str | None]]
    known: bool = True
    plans: tuple[tuple[int, int], ...] = ((3, 8),)


def drawn(rng: np.random.Generator, setup: blind.Setup, names: tuple[str, ...], d: float) -> tuple[str, np.ndarray]:
    """An effect that the first unit's plan can show, and its coefficients."""
    projector = blind.unreachable(setup)
    while True:
        name = names[rng.integers(len(names))]
        sized = blind.sized(setup, projector, name, d, rng)
        if sized is not None:
            return name, sized[0]


def scaled(name: str, coefficients: np.ndarray, factor: float) -> np.ndarray:
    """Another size of the same effect; a time constant stays."""
    return np.append(coefficients[:-1] * factor, coefficients[-1]) if name == "warm_up" else coefficients * factor


def of_the_head(d: float):
    def hide(rng, setups):
        name, coefficients = drawn(rng, setups[0], HEAD, d)
        return [{name: coefficients} for _ in setups], name

    return hide


def of_the_head_beside_own(d: float, own: float):
    def hide(rng, setups):
        effects, name = of_the_head(d)(rng, setups)
        for setup, hidden in zip(setups, effects, strict=True):
            other, coefficients = drawn(rng, setup, SENSOR, own)
            hidden[other] = coefficients
        return effects, name

    return hide


def of_differing_size(d: float, factors):
    def hide(rng, setups):
        name, coefficients = drawn(rng, setups[0], SENSOR, d)
        return [{name: scaled(name, coefficients, factor)} for factor in factors(rng, len(setups))], None

    return hide


def in_one_unit(d: float):
    def hide(rng, setups):
        name, coefficients = drawn(rng, setups[0], HEAD + SENSOR, d)
        return [{name: coefficients}, *({} for _ in setups[1:])], None

    return hide


def another_in_each(d: float):
    def hide(rng, setups):
        return [dict([drawn(rng, setup, SENSOR, d)]) for setup in setups], None

    return hide


def nothing(rng, setups):
    return [{} for _ in setups], None


def alike(rng, count):
    return rng.uniform(0.3, 1.7, count)


def either_sign(rng, count):
    return rng.normal(0, 1, count)


KINDS = {
    "8 units, d = 3.5": Condition(8, of_the_head(3.5)),
    "8 units, d = 2.5": Condition(8, of_the_head(2.5)),
    "8 units, d = 3.5, noise unknown": Condition(8, of_the_head(3.5), known=False),
    "8 units, d = 2.5, noise unknown": Condition(8, of_the_head(2.5), known=False),
    "8 units, d = 3.5, mixed plans": Condition(8, of_the_head(3.5), plans=MIXED),
    "8 units, d = 30": Condition(8, of_the_head(30.0)),
    "8 units, d = 100": Condition(8, of_the_head(100.0)),
    "8 units, d = 3.5, each with an effect of its own of 8": Condition(8, of_the_head_beside_own(3.5, 8.0)),
    "3 units, d = 5": Condition(3, of_the_head(5.0)),
    "20 units, d = 1.7": Condition(20, of_the_head(1.7)),
    "8 units, nothing": Condition(8, nothing),
    "8 units, nothing, noise unknown": Condition(8, nothing, known=False),
    "8 units, a sensor's effect of 3.5 times 0.3 to 1.7": Condition(8, of_differing_size(3.5, alike)),
    "8 units, a sensor's effect of 8 times 0.3 to 1.7": Condition(8, of_differing_size(8.0, alike)),
    "8 units, a sensor's effect of 5, either sign": Condition(8, of_differing_size(5.0, either_sign)),
    "8 units, a sensor's effect of 5, either sign, noise unknown": Condition(
        8, of_differing_size(5.0, either_sign), known=False
    ),
    "8 units, an effect of 8 in one": Condition(8, in_one_unit(8.0)),
    "8 units, an effect of 30 in one": Condition(8, in_one_unit(30.0)),
    "8 units, another effect of 8 in each": Condition(8, another_in_each(8.0)),
    "3 units, a sensor's effect of 8 times 0.3 to 1.7": Condition(3, of_differing_size(8.0, alike)),
    "20 units, a sensor's effect of 3.5 times 0.3 to 1.7": Condition(20, of_differing_size(3.5, alike)),
}


def batch(condition: Condition, rng: np.random.Generator) -> tuple[list[PositionSet], str | None]:
    """The units' data and what they share."""
    plans = [condition.plans[k % len(condition.plans)] for k in range(condition.units)]
    setups = [blind.random_setup(rng, *plan) for plan in plans]
    effects, name = condition.hide(rng, setups)
    sets = []
    for setup, hidden in zip(setups, effects, strict=True):
        clean = blind.readings(setup, setup.nominal, hidden)
        measured = clean + blind.SIGMA * rng.normal(size=clean.shape)
        sets.append(position_set(setup, measured, condition.known))
    return sets, name


def command(files: list[Path], out: Path, *options: str) -> None:
    arguments = [sys.executable, "-m", "tumblecal.cli", "diagnose", *options, *map(str, files), "--out", str(out)]
    subprocess.run(arguments, check=True, stdout=subprocess.DEVNULL)


def written(folder: Path, sets: list[PositionSet]) -> list[Path]:
    files = [folder / f"unit{number:03d}.csv" for number in range(len(sets))]
    for file, positions in zip(files, sets, strict=True):
        write_positions(file, positions)
    return files


def by_command(sets: list[PositionSet]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Labels of the best explanation and its equivalents, from diagnosis.json."""
    with tempfile.TemporaryDirectory() as folder:
        files = written(Path(folder), sets)
        command(files, Path(folder) / "out", "--units")
        best = json.loads((Path(folder) / "out" / "diagnosis.json").read_text())["explanations"][0]
    return tuple(best["effects"]), [tuple(labels) for labels in best["equivalents"]]


class Screened:
    """The same without the second diagnosis of every unit, in this process."""

    def __init__(self):
        self.diagnoser = Diagnoser(nested=False)

    def __call__(self, sets: list[PositionSet]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """Labels of the best explanation and its equivalents."""
        found = joint_diagnosis([self.diagnoser.begun(positions).screened for positions in sets], [""] * len(sets))
        return found.joint.best.shared.labels, list(found.joint.best.shared.equivalents)


def cases(kind: str, count: int, seed: int) -> Iterator[Case]:
    """So many batches."""
    condition, number = KINDS[kind], list(KINDS).index(kind)
    rng = np.random.default_rng([seed, number])
    for k in range(count):
        sets, name = batch(condition, rng)
        yield Case(kind, k, f"{condition.units} units", condition.known, (() if name is None else (name,),), sets)


def answered(drawn: Iterable[Case], screen: bool = False, alone: bool = False) -> Iterator[tuple[Case, Answer]]:
    """Diagnosed by the command; a shared name is a claim without a probability."""
    answer, diagnoser = Screened() if screen else by_command, Diagnoser(nested=False)
    for case in drawn:
        (labels, equivalents), measures = answer(case.data), {}
        (truth,) = case.accepted
        if alone and truth:
            named = [diagnoser.begun(positions).screened.best for positions in case.data]
            measures["file by file"] = float(np.mean([truth in (best.labels, *best.equivalents) for best in named]))
        yield (
            case,
            Answer(
                labels,
                (labels, *equivalents),
                1.0,
                "",
                bool(labels),
                bool(labels),
                tuple(equivalents),
                measures=measures,
            ),
        )


def main():
    for count in map(int, sys.argv[1:]):
        sets, _ = batch(Condition(count, of_the_head(3.5)), np.random.default_rng([1, count]))
        with tempfile.TemporaryDirectory() as folder:
            files = written(Path(folder), sets)
            started = time.perf_counter()
            command(files, Path(folder) / "out", "--units")
            print(f"{count} units of 24 positions: {time.perf_counter() - started:.1f} s", flush=True)


if __name__ == "__main__":
    main()

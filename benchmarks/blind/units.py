"""The population `units`: many units on one head. Is an error of the head named, and is a sensor's never attributed to it?

Batches of the blind instrument, whose units differ in everything else, through `tumblecal diagnose --units`. d is the visible
norm of the effect in the first unit. `right`: the hidden error, or one of its equivalents, is the best explanation; `wrong`: an
error is reported as shared that is not. `file by file`: share of the units for which a diagnosis of its file names the error.
"""

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import blind_instrument as blind
import tumblecal


tumblecal.enable_float64()
from blind.judge import Answer, Case  # noqa: E402
from blind_noise import position_set  # noqa: E402
from tumblecal.data import write_positions  # noqa: E402


HEAD = (
    *("base_levelling", "axis_perpendicularity", "index_eccentricity", "index_ellipticity", "index_gain"),
    *("index_backlash", "spindle_wobble_1", "spindle_wobble_2", "fixture_flexure", "gravity_value"),
)
SENSOR = tuple(name for name in blind.COEFFICIENTS if name not in HEAD)
MIXED = ((3, 8), (4, 12), (3, 6), (5, 8))


@dataclass(frozen=True)
class Condition:
    """A batch.

    - `units`; `shared`: d of an error of the head; `own`: d of an effect of each sensor, a different one in each.
    - `sensor`: d of one effect of all sensors, with factors `sizes`; `one`: d of an effect in the first unit only.
    """

    units: int
    shared: float = 0.0
    own: float = 0.0
    sensor: float = 0.0
    one: float = 0.0
    sizes: Callable[[np.random.Generator, int], np.ndarray] = lambda rng, count: rng.uniform(0.3, 1.7, count)
    known: bool = True
    plans: tuple[tuple[int, int], ...] = ((3, 8),)


def either_sign(rng: np.random.Generator, count: int) -> np.ndarray:
    """Factors of a sensor's effect."""
    return rng.normal(0, 1, count)


KINDS = {
    "8 units, d = 3.5": Condition(8, shared=3.5),
    "8 units, d = 2.5": Condition(8, shared=2.5),
    "8 units, d = 3.5, noise unknown": Condition(8, shared=3.5, known=False),
    "8 units, d = 2.5, noise unknown": Condition(8, shared=2.5, known=False),
    "8 units, d = 3.5, mixed plans": Condition(8, shared=3.5, plans=MIXED),
    "8 units, d = 30": Condition(8, shared=30.0),
    "8 units, d = 100": Condition(8, shared=100.0),
    "8 units, d = 3.5, each with an effect of its own of 8": Condition(8, shared=3.5, own=8.0),
    "3 units, d = 5": Condition(3, shared=5.0),
    "20 units, d = 1.7": Condition(20, shared=1.7),
    "8 units, nothing": Condition(8),
    "8 units, nothing, noise unknown": Condition(8, known=False),
    "8 units, a sensor's effect of 3.5 times 0.3 to 1.7": Condition(8, sensor=3.5),
    "8 units, a sensor's effect of 8 times 0.3 to 1.7": Condition(8, sensor=8.0),
    "8 units, a sensor's effect of 5, either sign": Condition(8, sensor=5.0, sizes=either_sign),
    "8 units, a sensor's effect of 5, either sign, noise unknown": Condition(
        8, sensor=5.0, sizes=either_sign, known=False
    ),
    "8 units, an effect of 8 in one": Condition(8, one=8.0),
    "8 units, an effect of 30 in one": Condition(8, one=30.0),
    "8 units, another effect of 8 in each": Condition(8, own=8.0),
    "3 units, a sensor's effect of 8 times 0.3 to 1.7": Condition(3, sensor=8.0),
    "20 units, a sensor's effect of 3.5 times 0.3 to 1.7": Condition(20, sensor=3.5),
}


def effect(rng: np.random.Generator, setup: blind.Setup, names: tuple[str, ...], d: float) -> tuple[str, np.ndarray]:
    """A visible effect and its coefficients."""
    projector = blind.unreachable(setup)
    while True:
        name = names[rng.integers(len(names))]
        if (sized := blind.sized(setup, projector, name, d, rng)) is not None:
            return name, sized[0]


def hidden(condition: Condition, rng: np.random.Generator, setups: list[blind.Setup]) -> tuple[list[dict], str | None]:
    """The effects of every unit, and the error of the head."""
    effects, shared = [{} for _ in setups], None
    if condition.shared:
        shared, size = effect(rng, setups[0], HEAD, condition.shared)
        effects = [{shared: size} for _ in setups]
    if condition.sensor:
        name, size = effect(rng, setups[0], SENSOR, condition.sensor)
        # A time constant is not a size.
        scaled = np.arange(len(size)) < len(size) - (name == "warm_up")
        for own, factor in zip(effects, condition.sizes(rng, len(setups)), strict=True):
            own[name] = np.where(scaled, factor, 1.0) * size
    if condition.one:
        effects[0] = dict([effect(rng, setups[0], HEAD + SENSOR, condition.one)])
    if condition.own:
        effects = [
            own | dict([effect(rng, setup, SENSOR, condition.own)]) for own, setup in zip(effects, setups, strict=True)
        ]
    return effects, shared


def cases(kind: str, count: int, seed: int) -> Iterator[Case]:
    """So many batches; `data`: the position sets of the units."""
    condition = KINDS[kind]
    rng = np.random.default_rng([seed, list(KINDS).index(kind)])
    for number in range(count):
        plans = [condition.plans[k % len(condition.plans)] for k in range(condition.units)]
        setups = [blind.random_setup(rng, *plan) for plan in plans]
        effects, shared = hidden(condition, rng, setups)
        sets = []
        for setup, own in zip(setups, effects, strict=True):
            clean = blind.readings(setup, setup.nominal, own)
            sets.append(position_set(setup, clean + blind.SIGMA * rng.normal(size=clean.shape), condition.known))
        truth = () if shared is None else (shared,)
        yield Case(kind, number, f"{condition.units} units", condition.known, (truth,), sets)


def answered(drawn: Iterable[Case]) -> Iterator[tuple[Case, Answer]]:
    """Diagnosed by the command; a shared name is a claim without a probability."""
    for case in drawn:
        with tempfile.TemporaryDirectory() as folder:
            files = [Path(folder) / f"unit{number:03d}.csv" for number in range(len(case.data))]
            for file, positions in zip(files, case.data, strict=True):
                write_positions(file, positions)
            command = [sys.executable, "-m", "tumblecal.cli", "diagnose", "--units", *map(str, files), "--out", folder]
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
            best = json.loads((Path(folder) / "diagnosis.json").read_text())["explanations"][0]
        labels, others = tuple(best["effects"]), tuple(tuple(own) for own in best["equivalents"])
        yield case, Answer(labels, (labels, *others), 1.0, "", bool(labels), bool(labels), identical=others)

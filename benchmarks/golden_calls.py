"""The calls of `tumblecal diagnose` whose answers `golden_answers.py` keeps, and their files.

All files of `simulated_files.py` in batches; further ones that need options or are of another kind: hand-held sets, recordings,
raw samples, uneven plans, units on one head, single files (with repeated selection and next positions), a noise stated by an
option, and real files where a folder is given.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

import blind_catalogue
import blind_conditions
import blind_units
import hand_held_null
import stated_sd
from blind_instrument import SIGMA
from simulated_files import SIMULATORS, name_of
from tumblecal.data import write_positions


SEED = 45
# Files of each kind of the simulators.
_OF_EACH_KIND = 5
# Files of one call: the compiled programs are shared within it.
_AT_ONCE = 40
_SAMPLES, _RATE_HZ = 40, 10.0
_UNITS = (
    "8 units, d = 3.5",
    "8 units, d = 2.5, noise unknown",
    "8 units, d = 30",
    "8 units, nothing",
    "8 units, a sensor's effect of 8 times 0.3 to 1.7",
    "3 units, d = 5",
)


@dataclass(frozen=True)
class Call:
    """One call of the command: `kinds` of its files, `options` as words of the command line."""

    name: str
    files: tuple[Path, ...]
    kinds: tuple[str, ...]
    options: tuple[str, ...] = ()


def written(folder: Path, real: Path | None, *, of_each_kind: int = _OF_EACH_KIND) -> list[Call]:
    """Write all files into a folder; the calls that diagnose them.

    `real`: a folder with position files, searched with its subfolders.
    """
    folder.mkdir(parents=True, exist_ok=True)
    plain: list[tuple[str, Path]] = []
    for simulator, kinds in SIMULATORS.items():
        for kind, drawn in kinds.items():
            for number in range(of_each_kind):
                path = folder / f"{name_of(simulator, kind, number)}.csv"
                if not path.exists():
                    drawn(SEED, number).write(path)
                plain.append((f"{simulator}: {kind}", path))
    for kind, path, write in _others(folder):
        write(path)
        plain.append((kind, path))
    plain.sort(key=lambda own: _plan_of(own[1]))
    calls = [
        _call(f"batch {first // _AT_ONCE:02d}", plain[first : first + _AT_ONCE])
        for first in range(0, len(plain), _AT_ONCE)
    ]
    one_size = [own for own in plain if own[0].startswith("in use: one, d") and "_sd_" not in _plan_of(own[1])[0]]
    again = [("noise stated by an option", _copied(path, folder / f"stated_{path.name}")) for _, path in one_size[:8]]
    calls.append(_call("stated by an option", again, "--noise-sd", "0.1mg"))
    singles = [path for kind, path in plain if kind in ("stress: one d=7", "stress: two d=8", "second: cable pulls")]
    calls += [
        _call(f"single {path.stem}", [("single file", _copied(path, folder / f"single_{path.name}"))])
        for path in singles[:5]
    ]
    calls += [*_with_samples(folder), *_of_units(folder)]
    if real is not None:
        calls += [_call(f"real {path.stem}", [("real", path)]) for path in sorted(real.rglob("*.csv"))]
    return calls


def _call(name: str, files: list[tuple[str, Path]], *options: str) -> Call:
    return Call(name, tuple(path for _, path in files), tuple(kind for kind, _ in files), options)


def _copied(path: Path, to: Path) -> Path:
    to.write_bytes(path.read_bytes())
    return to


def _plan_of(path: Path) -> tuple[str, int, str]:
    """Header, number of lines and name: files of one kind of plan follow one another."""
    lines = path.read_text().splitlines()
    header = next(line for line in lines if not line.startswith("#"))
    return header, len(lines), path.name


def _others(folder: Path) -> Iterator[tuple[str, Path, object]]:
    """Kind, path and writer of the files of other kinds that need no option."""
    for number in range(16):
        hidden, count = 8.0 * (number % 2), (20, 30, 40)[number % 3]
        rng = np.random.default_rng([SEED, 1, number])
        path = folder / f"hand_held_{number}.csv"
        yield (
            "hand-held, d = 8" if hidden else "hand-held",
            path,
            partial(hand_held_null.null_set, rng, count, hidden=hidden),
        )
    for number, kind in enumerate([*stated_sd.NOISES] * 2):
        data, _ = stated_sd.recorded(kind, SEED + number)
        yield (
            f"recording: {kind}",
            folder / f"recording_{number}.csv",
            lambda path, data=data: write_positions(path, data),
        )
    for number in range(8):
        rng = np.random.default_rng([SEED, 2, number])
        case = blind_catalogue.hidden(rng, "4x12", blind_catalogue.one_of(blind_conditions.NAMES), (12,))
        columns = blind_conditions.columns_of(case.setup, case.measured, bool(number % 2))
        rows = np.sort(rng.permutation(len(case.measured))[: rng.integers(24, 40)])
        columns = {name: values[rows] for name, values in columns.items()}
        yield "uneven plan", folder / f"uneven_{number}.csv", partial(blind_conditions.write, columns=columns)


def _with_samples(folder: Path) -> Iterator[Call]:
    """Position means with the samples that they are the means of."""
    for number in range(4):
        rng = np.random.default_rng([SEED, 3, number])
        case = blind_catalogue.hidden(rng, "3x8", blind_catalogue.one_of(blind_conditions.NAMES), (10,))
        noise = SIGMA * np.sqrt(_SAMPLES) * rng.normal(size=(len(case.clean), _SAMPLES, 3))
        samples = case.clean[:, None] + noise
        path, table = folder / f"samples_{number}.csv", folder / f"of_samples_{number}.csv"
        blind_conditions.write(path, blind_conditions.columns_of(case.setup, samples.mean(axis=1), False))
        times = case.setup.time_s[:, None] + (np.arange(_SAMPLES) - _SAMPLES / 2) / _RATE_HZ
        rows = [
            f"{name},{','.join(map(repr, reading))},{time!r}"
            for name, readings, own in zip(case.setup.names, samples.tolist(), times.tolist(), strict=True)
            for reading, time in zip(readings, own, strict=True)
        ]
        table.write_text("\n".join(["position,ax_g,ay_g,az_g,time_s", *rows]) + "\n")
        yield _call(path.stem, [("with samples", path)], "--samples", str(table))


def _of_units(folder: Path) -> Iterator[Call]:
    for number, title in enumerate(_UNITS):
        sets, _ = blind_units.batch(blind_units.KINDS[title], np.random.default_rng([SEED, 4, number]))
        files = [folder / f"batch{number}_unit{k}.csv" for k in range(len(sets))]
        for path, data in zip(files, sets, strict=True):
            write_positions(path, data)
        yield _call(f"units {number}", [(f"units: {title}", path) for path in files], "--units")

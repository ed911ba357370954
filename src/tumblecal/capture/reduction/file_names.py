"""The files of one recording: folders and patterns replaced by them, in natural order (2 before 10); positions from their
names: angles, faces, and names and numbers of a plan's positions."""

import glob
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from os.path import commonpath
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.ground.errors import InputError


# In a folder, files with these suffixes are recordings; it may also contain plans, pages and figures.
_TEXTS = (".csv", ".tsv", ".txt", ".dat", ".log", ".asc", ".jsonl", ".xlsx")
_OTHERS = (".parquet", ".mat", ".h5", ".hdf5", ".bag", ".db3", ".mcap", ".ulg", ".bin", ".mtb", ".raw")
# A folder with one of these files is a single recording.
_WHOLE = ("journal.log", "raw.log", "metadata.yaml")
# Files of results, and files in folders of results.
_RESULTS = ("positions.csv", "positions.parquet")
_OF_RESULTS = ("reduction.json", "calibration.json")


def recording_files(given: Sequence[Path], others: Sequence[Path | None] = ()) -> list[Path]:
    """The given files, with folders and patterns replaced by their recordings; a recording that is a folder is not replaced.

    Files are in the given order, unless it is alphabetical, as from a shell's pattern.

    **Arguments:**

    - `others`: files that are not recordings although they are in such a folder.

    **Raises:** `InputError` for a pattern, or several folders, without a recording.
    """
    left_out = {path.resolve() for path in others if path is not None}
    files: list[Path] = []
    for path in given:
        found = [recording for recording in _within(path) if recording.resolve() not in left_out]
        if not found:
            raise InputError(
                f"{path}: no file of a recording; give files, a folder, or a pattern such as 'faces/*.csv'"
            )
        files += found
    files = list(dict.fromkeys(files))
    return sorted(files, key=natural) if [*map(str, files)] == sorted(map(str, files)) else files


def natural(path: Path) -> list[Any]:
    """The sort key of paths in natural order."""
    return [
        (part.isdecimal(), int(part) if part.isdecimal() else part) for part in re.split(r"(\d+)", str(path)) if part
    ]


def _is_result(path: Path) -> bool:
    return path.name in _RESULTS or (
        any((path.parent / name).exists() for name in _OF_RESULTS) and path.name == "summary.csv"
    )


def _within(path: Path) -> list[Path]:
    if path.is_dir() and not any((path / name).exists() for name in _WHOLE):
        inside = (inner for inner in path.rglob("*") if inner.suffix.lower() in _TEXTS + _OTHERS and inner.is_file())
        recordings = (inner for inner in inside if not inner.name.startswith(".") and not _is_result(inner))
        return sorted(recordings, key=natural) or [path]
    if not path.exists() and any(mark in str(path) for mark in "*?["):
        return sorted(map(Path, glob.glob(str(path), recursive=True)), key=natural)
    return [path]


# Angles that differ by less are equal, deg; a face of a cube is the position of a plan within this angle, deg.
_SAME_DEG, _FACE_DEG = 0.01, 20.0
_SIGN = r"(minus|neg|plus|pos|[-−+mnp])?"
_ANGLE = re.compile(rf"(?:(?<![a-z])|(?<=deg))(alpha|beta|a|b)[ _=]*{_SIGN}[ _]*(\d+(?:[.,]\d+)?)")
_ENDS = r"(?:up|u|down|dn|d|pos(?:itive)?|neg(?:ative)?|plus|minus|p|n|m|[-−+]1 ?g|[-−+])"
_FACES = (
    re.compile(rf"(?:(?<![a-z])|(?<=acc)|(?<=axis))([xyz])(?:[ _-]?axis)?[ _-]?({_ENDS})(?![a-z0-9])"),
    re.compile(rf"(?<![a-z0-9])({_ENDS})[ _]?([xyz])(?![a-z]|[ _-]?{_ENDS}(?![a-z0-9]))"),
)
_DOWN = ("d", "n", "m", "-", "−")


@dataclass(frozen=True)
class Meaning:
    """An interpretation of names: `by`, in words; the index of each file's position in the plan, or its angles (files, 2), deg.

    `sure`: whether the names state the position itself; a count of files does not.
    """

    by: str
    steps: tuple[int | None, ...] = ()
    angles: tuple[tuple[float, float] | None, ...] = ()
    sure: bool = True

    @property
    def known(self) -> list[bool]:
        """Mask of the files with a position."""
        return [position is not None for position in self.steps or self.angles]


def stems_of(files: Sequence[Path]) -> list[str]:
    """The files' names below their common folder, without suffixes of formats."""
    paths = [path.absolute() for path in files]
    common = Path(commonpath([path.parent for path in paths]))
    stems = [path.relative_to(common).with_suffix("").as_posix() for path in paths]
    return stems if len(set(stems)) == len(stems) else [path.relative_to(common).as_posix() for path in paths]


def meanings(files: Sequence[Path], plan: CapturePlan | None) -> list[Meaning]:
    """All interpretations of the names that give at least one file a position; complete ones first."""
    stems = [stem.lower() for stem in stems_of(files)]
    if plan is None:
        return [_by_angles(stems)] if any(map(_angles_of, stems)) else []
    ways = [_by_names(stems, plan), _by_angles_in_plan(stems, plan), _by_faces(stems, plan)]
    if dashes_are_unclear(files):
        ways.append(_by_angles_in_plan(stems, plan, unsigned=True))
    ways = [way for way in ways if any(way.known)]
    if not ways:
        ways += [way for way in _by_numbers(stems, plan) if all(way.known)]
    return sorted(ways, key=lambda way: not all(way.known))


def dashes_are_unclear(files: Sequence[Path]) -> bool:
    """Whether every angle follows a dash, which may be a minus sign or a separator."""
    found = [match for stem in stems_of(files) for match in _ANGLE.finditer(stem.lower()) if float(_plain(match[3]))]
    return len(found) > 1 and all(match[2] == "-" for match in found)


def _plain(text: str) -> str:
    return text.replace(",", ".")


def _angles_of(stem: str, *, unsigned: bool = False) -> dict[str, float] | None:
    """Angles by the letters `a` and `b`, deg; None if a letter has two values."""
    found: dict[str, float] = {}
    for label, sign, digits in _ANGLE.findall(stem):
        value = float(_plain(digits)) * (-1 if sign and sign[0] in _DOWN and not (unsigned and sign == "-") else 1)
        if found.get(label[0], value) != value:
            return None
        found[label[0]] = value
    return found


def _by_angles(stems: Sequence[str]) -> Meaning:
    found = [_angles_of(stem) or {} for stem in stems]
    angles = tuple((values["a"], values["b"]) if len(values) == 2 else None for values in found)
    return Meaning("the angles in the names", angles=angles)


def _by_angles_in_plan(stems: Sequence[str], plan: CapturePlan, *, unsigned: bool = False) -> Meaning:
    """Positions of the plan with the angles in the names; `unsigned`: a dash is not a minus sign."""
    found = [_angles_of(stem, unsigned=unsigned) for stem in stems]
    dash = " (a dash is not a minus sign)" if unsigned else ""
    return Meaning(f"the angles in the names{dash}", _each(found, lambda angles: _steps_at(angles, plan), plan))


def _steps_at(angles: dict[str, float] | None, plan: CapturePlan) -> list[int]:
    if not angles:
        return []
    wanted = {"a": "alpha_deg", "b": "beta_deg"}

    def at(step: object) -> bool:
        differences = [
            abs((getattr(step, wanted[letter]) - value + 180) % 360 - 180) for letter, value in angles.items()
        ]
        return max(differences) < _SAME_DEG

    return [k for k, step in enumerate(plan.steps) if at(step)]


def _each(found: Sequence, steps_of: Callable[..., list[int]], plan: CapturePlan) -> tuple[int | None, ...]:
    """The position of each file, None if several fit; positions that the plan lists more than once are assigned in turn."""
    times: dict[tuple[int, ...], int] = {}
    steps: list[int | None] = []
    for candidates in (tuple(steps_of(each)) for each in found):
        number = times[candidates] = times.get(candidates, -1) + 1
        same_angles = len({(plan.steps[k].alpha_deg, plan.steps[k].beta_deg) for k in candidates}) == 1
        steps.append(candidates[number % len(candidates)] if same_angles else None)
    return tuple(steps)


def _by_faces(stems: Sequence[str], plan: CapturePlan) -> Meaning:
    expected = np.array([plan.expected(k) for k in range(len(plan.steps))])

    def steps_of(up: NDArray[np.float64] | None) -> list[int]:
        if up is None:
            return []
        angles = np.degrees(np.arccos(np.clip(expected @ up, -1, 1)))
        return np.flatnonzero((angles < _FACE_DEG) & (angles < angles.min() + 1)).tolist()

    return Meaning(
        "the faces in the names (up, + or p: the axis reads +1 g)", _each(list(map(_face, stems)), steps_of, plan)
    )


def _face(stem: str) -> NDArray[np.float64] | None:
    """The direction that points up, from a name such as `x_up`, `+x` or `z-`; None for no direction or two."""
    found = {(axis, end[0] in _DOWN) for axis, end in _FACES[0].findall(stem)}
    found |= {(axis, end[0] in _DOWN) for end, axis in _FACES[1].findall(stem)}
    if len(found) != 1:
        return None
    ((axis, down),) = found
    return np.array([float(letter == axis) for letter in "xyz"]) * (-1 if down else 1)


def _tokens(text: str) -> list[str]:
    return [
        str(int(token)) if token.isdecimal() else token for token in re.findall(r"[^\W\d_]+|\d+|[+-]", text.lower())
    ]


def _by_names(stems: Sequence[str], plan: CapturePlan) -> Meaning:
    """Positions whose name is in a file's name (the longest such name), except names that are only numbers."""
    names = [_tokens(str(step.name)) for step in plan.steps]

    def steps_of(words: list[str]) -> list[int]:
        def within(name: list[str]) -> bool:
            return any(words[k : k + len(name)] == name for k in range(len(words) - len(name) + 1))

        matching = [k for k, name in enumerate(names) if name and not all(map(str.isdecimal, name)) and within(name)]
        longest = max((len(names[k]) for k in matching), default=0)
        return [k for k in matching if len(names[k]) == longest]

    return Meaning("the plan's names", _each(list(map(_tokens, stems)), steps_of, plan))


def _by_numbers(stems: Sequence[str], plan: CapturePlan) -> list[Meaning]:
    """Positions by the only number in which the names differ: as name, counted from 0 or 1, or in the plan's order."""
    parts = [re.split(r"(\d+)", stem) for stem in stems]
    if len({tuple(part[::2]) for part in parts}) != 1 or len(parts[0]) < 3:
        return []
    numbers = np.array([[int(digits) for digits in part[1::2]] for part in parts], object)
    varies = np.flatnonzero([len(set(column)) > 1 for column in numbers.T])
    keys = [tuple(row) for row in numbers[:, varies]]
    # Several numbers form one only if they are date and time, without other words between.
    between = parts[0][2 * varies[0] + 2 : 2 * varies[-1] + 1 : 2] if len(varies) else ["?"]
    if len(set(keys)) != len(keys) or not all(re.fullmatch("[-_ .:t]*", text) for text in between):
        return []
    count, values = len(plan.steps), [key[0] for key in keys]
    ways = []
    if len(keys) == count:
        order = sorted(range(count), key=lambda k: keys[k])
        ways.append(Meaning("the numbers in the names, in the plan's order", _ranks(order), sure=False))
    if len(keys[0]) > 1:
        return ways
    by_name = {str(step.name).lstrip("0") or "0": k for k, step in enumerate(plan.steps)}
    named = tuple(by_name.get(str(value)) for value in values)
    if None not in named and len(values) < count:
        ways.append(Meaning("the plan's names, numbers", named, sure=False))
    elif len(values) < count and min(values) == 0 and max(values) < count:
        ways.append(Meaning("the numbers in the names, counted from 0", tuple(values), sure=False))
    elif len(values) < count and max(values) == count:
        ways.append(Meaning("the numbers in the names, counted from 1", tuple(v - 1 for v in values), sure=False))
    for letter, angles in (("a", {s.alpha_deg for s in plan.steps}), ("b", {s.beta_deg for s in plan.steps})):
        if len(angles) > 1 and set(values) <= {angle % 360 for angle in angles} and max(values) > count:
            steps = _each([{letter: float(value)} for value in values], lambda angles: _steps_at(angles, plan), plan)
            ways.append(Meaning(f"the numbers in the names, as {'alpha' if letter == 'a' else 'beta'}_deg", steps))
    return ways


def _ranks(order: Sequence[int]) -> tuple[int, ...]:
    ranks = dict(zip(order, range(len(order)), strict=True))
    return tuple(ranks[k] for k in range(len(order)))

"""The orientation of the triad in each mounting: quarter turns found from the readings.

A triad that is remounted in another orientation has another nominal attitude: one of the 24 proper quarter turns.
Readings at the commanded angles determine the turn, because it changes them by about 1 g, and the errors to be
calibrated by a hundredth of that. dtheta is then relative to the nominal attitude and stays small.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Annotated, TypeAlias

import numpy as np
from jaxtyping import Bool, Float
from pydantic import BeforeValidator

from tumblecal.chain import Chain, Where
from tumblecal.data import PositionSet
from tumblecal.ground.errors import InputError
from tumblecal.ground.frames import gravity_in_head, rotation_matrix
from tumblecal.ground.record import ResultRecord
from tumblecal.words import sentence


# Turns whose mean distances from the readings differ by less than this (g) fit equally well.
EQUAL = 0.1
# Mean distance (g) from every turn above which the triad is between turns; any of the nearest turns is then suitable.
_OBLIQUE = 0.35
# With fewer positions than this, one faulty position could decide.
FEWEST = 4
# Distances are limited to this (g), so that a reading in another unit does not decide.
_FARTHEST = 2.0

Angles: TypeAlias = tuple[float, float, float]


class MountingRecord(ResultRecord):
    """The turn of a mounting in JSON files."""

    rotation_deg: Angles


Mountings = dict[str, Annotated[MountingRecord, BeforeValidator(lambda turn: {"rotation_deg": turn})]]


@dataclass(frozen=True)
class QuarterTurn:
    """One of the turns: its matrix, and `angles_deg` about x, y, z as in a rig's rotation_deg."""

    matrix: Float[np.ndarray, "3 3"]
    angles_deg: Angles


@cache
def quarter_turns() -> tuple[QuarterTurn, ...]:
    """The 24 proper quarter turns, the simplest angles of each; no turn first."""
    listed = sorted(
        product((0.0, 90.0, -90.0, 180.0), repeat=3),
        key=lambda angles: (sum(angle != 0 for angle in angles), sum(map(abs, angles))),
    )
    found: dict[bytes, QuarterTurn] = {}
    for x, y, z in listed:
        matrix = np.round(rotation_matrix(np.radians(np.array([x, y, z])))) + 0.0
        found.setdefault(matrix.tobytes(), QuarterTurn(matrix, (x, y, z)))
    return tuple(found.values())


def turn_of(matrix: Float[np.ndarray, "3 3"]) -> Angles | None:
    """The angles of a quarter turn (deg about x, y, z); None for any other rotation."""
    return next((turn.angles_deg for turn in quarter_turns() if np.max(np.abs(turn.matrix - matrix)) < 1e-9), None)


def turn_words(angles_deg: Sequence[float]) -> str:
    """A turn in words, such as `90 deg about z`; several angles as in a rig file."""
    about = [(angle, axis) for angle, axis in zip(angles_deg, "xyz", strict=True) if angle]
    if len(about) == 1:
        return f"{about[0][0]:g} deg about {about[0][1]}"
    return f"by rotation_deg = [{', '.join(f'{angle:g}' for angle in angles_deg)}]"


def distances(data: PositionSet, rows: Bool[np.ndarray, " positions"]) -> Float[np.ndarray, "2 24"]:
    """Mean distance (g) of some readings from those of a perfect triad at each turn, and at each turn with all axes mirrored;
    zero for fewer than `FEWEST` rows."""
    if rows.sum() < FEWEST:
        return np.zeros((2, len(quarter_turns())))
    size = float(np.median(np.linalg.norm(data.readings[rows], axis=1)))
    matrices = np.stack([turn.matrix for turn in quarter_turns()])
    ideal = np.einsum("tij,nj->tni", matrices, gravity_in_head(data.alpha[rows], data.beta[rows]))
    readings = data.readings[rows] / max(size, 1e-12)
    away = np.stack([np.linalg.norm(readings - sign * ideal, axis=2) for sign in (1.0, -1.0)])
    return np.minimum(away, _FARTHEST).mean(axis=2)


def mounting_words(turns: Mapping[str, Sequence[float]]) -> str:
    """The assumed turns of the mountings in one sentence; empty if none is turned."""
    turned = [f"{turn_words(turn)} in mounting {label}" for label, turn in turns.items() if any(turn)]
    return sentence("positions/turned", turned=turned) if turned else ""


def turns_of(chain: Chain, where: Where) -> dict[str, Angles]:
    """The quarter turns (deg about x, y, z) of a chain's mountings; mountings at other angles are omitted."""
    if chain.orientations is None:
        return {}
    turns = [turn_of(np.asarray(matrix)) for matrix in chain.orientations]
    return {label: turn for label, turn in zip(mount_labels(where), turns, strict=True) if turn is not None}


def mount_labels(where: Where) -> list[str]:
    """The mountings' labels in the order of their parameters."""
    return [name.removeprefix("@mount=") for name in where.names("mount")]


def turned_mountings(data: PositionSet) -> dict[str, Angles]:
    """The nominal rotation of every mounting (deg about x, y, z, as in a rig file) if they differ; otherwise {}.

    For one mounting, or equal orientations in all, no turn is assumed: axes exchanged in the whole file are an error of its
    columns.

    **Raises:** `InputError` if the turn is not clear from the readings, if axes are mirrored between mountings, or if
    the triad was turned within a mounting.
    """
    mount, run = data.labels("mount"), data.labels("run")
    parts = list(dict.fromkeys(zip(mount, run, strict=True)))
    if len(parts) < 2 or data.hand_held:
        return {}
    rows = [np.array([labels == part for labels in zip(mount, run, strict=True)]) for part in parts]
    fits = _of_one_handedness(data, [distances(data, here) for here in rows], [_named(*part, data) for part in parts])
    possible = [nearest_turns(away) for away in fits]
    if frozenset.intersection(*possible):
        return {}
    labels = list(dict.fromkeys(mount))
    by_label = {label: [k for k, part in enumerate(parts) if part[0] == label] for label in labels}
    chosen: dict[str, QuarterTurn] = {}
    for label, numbers in by_label.items():
        common = frozenset.intersection(*(possible[k] for k in numbers))
        if not common:
            raise InputError(_turned_within(data, label, [(parts[k][1], fits[k]) for k in numbers]))
        away = np.max([fits[k] for k in numbers], axis=0)
        nearest = min(common, key=lambda number: away[number])
        if 0 not in common and len(common) > 1 and away[nearest] < _OBLIQUE:
            raise InputError(_unclear_turn(data, label, labels))
        chosen[label] = quarter_turns()[0 if 0 in common else nearest]
    if len({turn.angles_deg for turn in chosen.values()}) == 1:
        return {}
    return {label: turn.angles_deg for label, turn in chosen.items()}


def nominal_rotations(turns: dict[str, Angles], labels: Sequence[str]) -> Float[np.ndarray, "mounts 3 3"] | None:
    """The nominal orientation of each mounting in the order of `labels`; None if none is turned."""
    if not turns:
        return None
    matrices = {turn.angles_deg: turn.matrix for turn in quarter_turns()}
    return np.stack([matrices[turns[label]] for label in labels])


def nearest_turns(away: Float[np.ndarray, "24"]) -> frozenset[int]:
    """Numbers of the turns whose fit is about equal to the best."""
    return frozenset(np.flatnonzero(away <= away.min() + EQUAL).tolist())


def _of_one_handedness(
    data: PositionSet, fits: list[Float[np.ndarray, "2 24"]], names: list[str]
) -> list[Float[np.ndarray, "24"]]:
    """Distances of each part from the proper turns. If all parts are mirrored (columns with the wrong sign): from the turns
    relative to the mirrored axes of the first part."""
    better = np.array([proper.min() - mirrored.min() for proper, mirrored in fits])
    if np.all(better <= EQUAL):
        return [proper for proper, _ in fits]
    if np.all(better >= -EQUAL):
        first_mirrored = next(mirrored for _, mirrored in fits if np.any(mirrored))
        first = quarter_turns()[int(np.argmin(first_mirrored))].matrix
        numbers = {turn.matrix.tobytes(): k for k, turn in enumerate(quarter_turns())}
        order = [numbers[(first @ turn.matrix + 0.0).tobytes()] for turn in quarter_turns()]
        return [mirrored[order] for _, mirrored in fits]
    odd = [name for name, difference in zip(names, better, strict=True) if difference > EQUAL]
    raise InputError(
        f"{data.source}: in {', '.join(odd)} the axes are mirrored against those of the other positions (a column of "
        "the wrong sign, or two exchanged), which no turn of the triad explains; correct these columns"
    )


def _named(mount: str, run: str, data: PositionSet) -> str:
    return " of ".join(
        [*([f"run {run}"] if len(data.runs) > 1 else []), *([f"mount {mount}"] if data.mount is not None else [])]
    )


def _turned_within(data: PositionSet, label: str, runs: list[tuple[str, np.ndarray]]) -> str:
    orientations = "; ".join(
        f"in run {run} {'aligned with the head' if not any(turn) else f'turned {turn_words(turn)}'}"
        for run, turn in ((run, quarter_turns()[int(np.argmin(away))].angles_deg) for run, away in runs)
    )
    return (
        f"{data.source}: within mount {label} the orientation of the triad changes ({orientations}); if it was remounted, "
        "state this in a column mount (such as A and B)"
    )


def _unclear_turn(data: PositionSet, label: str, labels: Sequence[str]) -> str:
    entries = " ".join(f'[mounts."{name}"] rotation_deg = [0, 0, 0]' for name in labels)
    return (
        f"{data.source}: mount {label}: the triad is turned, but the readings do not determine the turn; state it in a "
        f"rig file: --rig FILE, as in configs/remount.toml, with {entries} and the angles (about x, y, z) of each"
    )

"""How the triad stood in each mounting: the quarter turns that its readings show.

A triad that is taken out of its fixture and put back turned has another nominal attitude: one of the 24 proper quarter
turns. Readings at the commanded angles tell which, since a turn changes them by something like 1 g and the errors that a
calibration is after by a hundredth of that. dtheta then counts from the nominal attitude and stays small.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from tumblecal.chain import Chain, Where
from tumblecal.data import PositionSet
from tumblecal.estimation.quarter_turns import (
    FEWEST,
    Angles,
    QuarterTurn,
    distances,
    quarter_turns,
    turn_of,
    turn_words,
)
from tumblecal.ground.errors import InputError


# Turns whose mean distance from the readings (g) differs by less fit equally well.
_ALIKE = 0.1
# Readings this far (g) from those at every turn: the triad stands between turns, and any of the nearest will do.
_OBLIQUE = 0.35


def mounting_words(turns: Mapping[str, Sequence[float]]) -> str:
    """In one sentence, how the mountings that are turned are taken; empty when none is."""
    said = [f"{turn_words(turn)} in mounting {label}" for label, turn in turns.items() if any(turn)]
    return f"The triad is taken as turned {' and '.join(said)}; dtheta counts from there." if said else ""


def turns_of(chain: Chain, where: Where) -> dict[str, Angles]:
    """The quarter turns (deg about x, y, z) by which a chain's mountings are turned; without those at other angles."""
    if chain.orientations is None:
        return {}
    turns = [turn_of(np.asarray(matrix)) for matrix in chain.orientations]
    return {label: turn for label, turn in zip(mount_labels(where), turns, strict=True) if turn is not None}


def mount_labels(where: Where) -> list[str]:
    """The mountings' labels in the order of their parameters."""
    return [name.removeprefix("@mount=") for name in where.names("mount")]


def turned_mountings(data: PositionSet) -> dict[str, Angles]:
    """The nominal rotation of every mounting (deg about x, y, z, as in a rig file) where they are not all alike; else {}.

    Data of one mounting, or of mountings that all stand alike, are left as they are: axes exchanged throughout are a
    matter of the file's columns.

    **Raises:** `InputError` when the readings do not tell, when axes are mirrored between mountings, or when the triad
    was turned within a mounting.
    """
    mount, run = data.mount or ("1",) * len(data), data.run or ("1",) * len(data)
    parts = list(dict.fromkeys(zip(mount, run, strict=True)))
    if len(parts) < 2 or data.hand_held:
        return {}
    rows = [np.array([own == part for own in zip(mount, run, strict=True)]) for part in parts]
    fits = _one_handed(data, [distances(data, own) for own in rows], [_named(*part, data) for part in parts])
    seen = [_near(own) for own in fits]
    if frozenset.intersection(*seen):
        return {}
    labels = list(dict.fromkeys(mount))
    by_label = {label: [k for k, part in enumerate(parts) if part[0] == label] for label in labels}
    chosen: dict[str, QuarterTurn] = {}
    for label, own in by_label.items():
        common = frozenset.intersection(*(seen[k] for k in own))
        if not common:
            raise InputError(_turned_within(data, label, [(parts[k][1], fits[k]) for k in own]))
        away = np.max([fits[k] for k in own], axis=0)
        nearest = min(common, key=lambda number: away[number])
        if 0 not in common and len(common) > 1 and away[nearest] < _OBLIQUE:
            raise InputError(_cannot_tell(data, label, labels))
        chosen[label] = quarter_turns()[0 if 0 in common else nearest]
    if len({turn.angles_deg for turn in chosen.values()}) == 1:
        return {}
    return {label: turn.angles_deg for label, turn in chosen.items()}


def seen_turns(data: PositionSet) -> frozenset[int]:
    """Numbers of the quarter turns that fit all readings of a set about equally well, those of mirrored axes counted
    behind them; all of either kind where the set is short."""
    proper, mirrored = distances(data, np.ones(len(data), bool))
    count = len(proper)
    if len(data) < FEWEST:
        return frozenset(range(2 * count))
    if proper.min() <= mirrored.min() + _ALIKE:
        return _near(proper)
    return frozenset(count + number for number in _near(mirrored))


def with_distinct_mounts(sets: Sequence[PositionSet]) -> list[PositionSet]:
    """Sets to be joined, where a set whose triad stands otherwise than in the set before it that names the same mount
    begins a mount of its own: the name of its file."""
    now: dict[str, tuple[str, frozenset[int]]] = {}
    taken = {label for data in sets for label in data.mount or ("1",)}
    named: list[PositionSet] = []
    for data in sets:
        labels = list(data.mount or ("1",) * len(data))
        for label in dict.fromkeys(labels):
            seen = seen_turns(data.chosen([own == label for own in labels]))
            name, before = now.get(label, (label, seen))
            if not seen & before:
                name, before = _own_label(data, label, taken), seen
                taken.add(name)
            now[label] = (name, seen & before)
        new = tuple(now[label][0] for label in labels)
        named.append(replace(data, mount=new) if list(new) != labels else data)
    return named


def _own_label(data: PositionSet, label: str, taken: set[str]) -> str:
    stem = Path(data.source).stem
    wanted = stem if data.mount is None else f"{label} of {stem}"
    names = (wanted, *(f"{wanted} {number}" for number in range(2, len(taken) + 3)))
    return next(name for name in names if name not in taken)


def nominal_rotations(turns: dict[str, Angles], labels: Sequence[str]) -> Float[np.ndarray, "mounts 3 3"] | None:
    """The nominal orientation of each mounting in the order of `labels`; None where nothing is turned."""
    if not turns:
        return None
    matrices = {turn.angles_deg: turn.matrix for turn in quarter_turns()}
    return np.stack([matrices[turns[label]] for label in labels])


def _near(away: Float[np.ndarray, "24"]) -> frozenset[int]:
    """Numbers of the turns that fit about as well as the best."""
    return frozenset(np.flatnonzero(away <= away.min() + _ALIKE).tolist())


def _one_handed(
    data: PositionSet, fits: list[Float[np.ndarray, "2 24"]], names: list[str]
) -> list[Float[np.ndarray, "24"]]:
    """Distances of each part from the proper turns; where all are mirrored alike (columns of the wrong sign), from the
    turns that carry the first part's mirrored axes to those of each."""
    better = np.array([proper.min() - mirrored.min() for proper, mirrored in fits])
    if np.all(better <= _ALIKE):
        return [proper for proper, _ in fits]
    if np.all(better >= -_ALIKE):
        telling = next(mirrored for _, mirrored in fits if np.any(mirrored))
        first = quarter_turns()[int(np.argmin(telling))].matrix
        numbers = {turn.matrix.tobytes(): k for k, turn in enumerate(quarter_turns())}
        order = [numbers[(first @ turn.matrix + 0.0).tobytes()] for turn in quarter_turns()]
        return [mirrored[order] for _, mirrored in fits]
    odd = [name for name, difference in zip(names, better, strict=True) if difference > _ALIKE]
    raise InputError(
        f"{data.source}: in {', '.join(odd)} the axes are mirrored against those of the other positions (a column of "
        "the wrong sign, or two exchanged), which no turn of the triad does; put these columns right"
    )


def _named(mount: str, run: str, data: PositionSet) -> str:
    return " of ".join(
        [*([f"run {run}"] if len(data.runs) > 1 else []), *([f"mount {mount}"] if data.mount is not None else [])]
    )


def _turned_within(data: PositionSet, label: str, runs: list[tuple[str, np.ndarray]]) -> str:
    stands = "; ".join(
        f"in run {run} {'aligned with the head' if not any(turn) else f'turned {turn_words(turn)}'}"
        for run, turn in ((run, quarter_turns()[int(np.argmin(own))].angles_deg) for run, own in runs)
    )
    return (
        f"{data.source}: within mount {label} the triad stands differently, {stands}; where it was remounted, say so "
        "in a column mount (such as A and B)"
    )


def _cannot_tell(data: PositionSet, label: str, labels: Sequence[str]) -> str:
    entries = " ".join(f'[mounts."{name}"] rotation_deg = [0, 0, 0]' for name in labels)
    return (
        f"{data.source}: mount {label}: the triad stands turned, but the readings do not tell how; give a rig that "
        f"does: --rig FILE, like configs/remount.toml, with {entries} and the angles (about x, y, z) of each"
    )

"""The angles of a set put right, mounting by mounting, or by one slip of the whole file."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.chain import Chain
from tumblecal.data import PositionSet
from tumblecal.estimation.angle_hypotheses import SAME, AngleHypothesis, AngleSearch, with_angles
from tumblecal.estimation.angle_misfit import ALIKE, APART, misfit
from tumblecal.estimation.axes_of_parts import PartMap, part_maps
from tumblecal.estimation.mountings import nominal_rotations, turned_mountings
from tumblecal.estimation.quarter_turns import quarter_turns
from tumblecal.estimation.setup_error import SetupError
from tumblecal.ground.errors import InputError
from tumblecal.ground.frames import gravity_in_head


# The intended rotation of the triad at every position; None for none.
Attitudes = Float[np.ndarray, "positions 3 3"] | None
# Readings on the plan's axes, and what was mixed up there.
Mapped = tuple[Float[np.ndarray, "positions 3"], SetupError]

# Where more of the rows than this are far from the angles as written and from those of every hypothesis, nothing is said.
_MOST_ASTRAY = 0.5
# A slip is the right one only where it leaves less than this share of the misfit: true ones left at most 1 %, an effect of a
# thousand sigma that looked like one more than half. (conditions of benchmarks/blind_stress.py)
_MOST_LEFT = 0.4
# Of more mountings and runs than these a slip of one of them is not tried with every mounting's turn seen anew.
_MOST_PARTS = 12


def with_turns(data: PositionSet, chain: Chain | None) -> tuple[PositionSet, Attitudes, list[SetupError]]:
    """A set with the intended rotation of the triad at each position: the chain's, else what the readings show.

    Where the readings show none at the angles as written, or mountings that do not follow them, but do at those of one slip of
    the whole file, the set is put right.

    **Raises:** `InputError` as `turned_mountings`.
    """
    if chain is not None:
        return data, _by_position(data, chain.orientations), []
    try:
        attitudes, refused = _shown(data), None
    except InputError as fault:
        attitudes, refused = None, fault
    searches = [] if refused is not None else _searches(data, attitudes)
    before = _misfit(searches) if searches else np.inf
    if before > APART and 1 < len(set(_parts(data))) <= _MOST_PARTS:
        apart = _told_apart(searches, as_intended(data, attitudes)) if searches else np.inf
        retold = _retold(data)
        if retold and retold[0].left < min(apart - APART, _MOST_LEFT * before):
            slip = _one_slip(retold)
            if refused is None or not _mirrors(data, retold[0]):
                return retold[0].data, retold[0].attitudes, [slip]
            same = "; or ".join([slip.words, *(words for _, words in slip.equal)])
            raise InputError(f"{refused}; or, which is the same here: {same}")
    if refused is not None:
        raise refused
    return data, attitudes, []


def as_intended(data: PositionSet, attitudes: Attitudes) -> Float[np.ndarray, "positions 3"]:
    """What a perfect instrument reads at the angles as written, g."""
    ideal = gravity_in_head(data.alpha, data.beta)
    return ideal if attitudes is None else np.einsum("nij,nj->ni", attitudes, ideal)


def correct_angles(
    data: PositionSet, chain: Chain | None, attitudes: Attitudes, axis_map: Mapped | None
) -> tuple[PositionSet, list[SetupError]]:
    """The set with its angles, or its axes, as they must have been, where the readings do not follow them.

    **Arguments:**

    - `attitudes`: as of `with_turns`. `axis_map`: readings on other axes, which may explain the same.

    **Raises:** `InputError` for angles that the readings do not follow, or that could be put right in several ways.
    """
    searches = _searches(data, attitudes)
    as_written = [search.misfits([search.as_written()]) for search in searches]
    if all(float(cost[0]) < APART for cost, _ in as_written):
        return data, []
    before = sum(float(cost[0]) for cost, _ in as_written)
    mapped, ideal = np.inf, as_intended(data, attitudes)
    if axis_map:
        mapped = sum(float(misfit(ideal[None, own.rows], axis_map[0][own.rows])[0][0]) for own in searches)
    told = [search.best() for search in searches]
    in_parts = [part_maps(search, ideal) for search in searches]
    least_told = min(sum(cost for _, cost, _ in told), sum(cost for _, cost in in_parts))
    if axis_map and mapped < before - APART and mapped < least_told + ALIKE:
        same = [told[0][0][0]] if len(told) == 1 and told[0][1] < mapped + ALIKE else []
        equal = (*axis_map[1].equal, *((hypothesis.label, hypothesis.words) for hypothesis in same))
        return replace(data, readings=axis_map[0]), [replace(axis_map[1], equal=equal)]
    slips: list[tuple[str, SetupError]] = []
    for search, (cost, share), (hypotheses, least, near), (maps, mapped) in zip(
        searches, as_written, told, in_parts, strict=True
    ):
        whole = float(cost[0])
        if mapped < min(whole - APART, _MOST_LEFT * whole) and _rather(search, maps[0], mapped, hypotheses, least):
            if len(maps) > 1:
                raise InputError(_several(data, [part.words for part in maps]))
            slips.append((search.mounting, SetupError("axis_map", maps[0].words)))
            data = replace(data, readings=maps[0].corrected(data.readings))
        elif least < min(whole - APART, _MOST_LEFT * whole) and near > 1 - _MOST_ASTRAY:
            slips.append((search.mounting, _unambiguous(search, hypotheses)))
            data = with_angles(data, hypotheses[0], search.rows)
        elif share[0] < 1 - _MOST_ASTRAY:
            raise InputError(
                f"{data.source}: the readings do not follow the angles ({1 - share[0]:.0%} of the positions are more than "
                "0.1 g off, whatever the sensor's errors); check angle columns, axes and units against the log"
            )
    return data, _told_once(slips, len(searches))


def _rather(
    search: AngleSearch, told: PartMap, mapped: float, hypotheses: Sequence[AngleHypothesis], least: float
) -> bool:
    """Whether readings were on other axes rather than at the angles of a hypothesis: of two that put the triad into the same
    attitudes, a sensor's bias tells."""
    if not hypotheses or abs(mapped - least) > ALIKE:
        return mapped < least
    left = search.left_by_pitch_errors(search.as_written(), told.corrected(search.data.readings))
    return left < _MOST_LEFT * search.left_by_pitch_errors(hypotheses[0])


def _told_once(slips: Sequence[tuple[str, SetupError]], mountings: int) -> list[SetupError]:
    """Slips by mounting: one that all of them have is told once, others with their mounting."""
    told = [slip for _, slip in slips]
    if len(slips) == mountings > 0 and len({(slip.label, slip.words) for slip in told}) == 1:
        # What is the same in each mounting has other words there: its own positions.
        others = list(dict.fromkeys(slip.equal for slip in told))
        alike = len({tuple(label for label, _ in equal) for equal in others}) == 1
        together = zip(*others, strict=True) if alike else ()
        equal = tuple((each[0][0], "; ".join(dict.fromkeys(words for _, words in each))) for each in together)
        return [replace(told[0], equal=equal)]
    return [slip if mountings == 1 else replace(slip, words=f"{slip.words} in mounting {own}") for own, slip in slips]


def _unambiguous(search: AngleSearch, hypotheses: Sequence[AngleHypothesis]) -> SetupError:
    """The best hypothesis.

    **Raises:** `InputError` when hypotheses that fit equally well would put the data right in different ways.
    """
    first, *others = hypotheses
    if not all(search.same(first, other) for other in others):
        raise InputError(_several(search.data, [hypothesis.words for hypothesis in hypotheses]))
    equal = [*first.equal, *((hypothesis.label, hypothesis.words) for hypothesis in others)]
    pair = search.exchanged_pair(first)
    if pair is not None:
        exchanged = " and ".join(search.data.names[row] for row in pair)
        equal.append(("swapped_positions", f"positions {exchanged} are exchanged"))
    return SetupError(first.label, first.words, tuple(equal))


class _Retold(NamedTuple):
    """A set at the angles of a slip, its mountings turned as they then show, and their misfit."""

    left: float
    data: PositionSet
    attitudes: Attitudes
    slip: SetupError


def _retold(data: PositionSet) -> list[_Retold]:
    """The slips of all rows, and of those of each mounting, that leave mountings which can be told; the best first."""
    every, retold = np.ones(len(data), bool), []
    for place, rows in [("", every), *((f" in mounting {label}", rows) for label, rows in _mountings(data))]:
        for hypothesis in AngleSearch(data, None, rows).slips():
            moved = with_angles(data, hypothesis, rows)
            try:
                attitudes = _shown(moved)
            except InputError:
                continue
            slip = SetupError(hypothesis.label, hypothesis.words + place)
            retold.append(_Retold(_misfit(_searches(moved, attitudes)), moved, attitudes, slip))
    return sorted(retold, key=lambda own: own.left)


def _one_slip(retold: Sequence[_Retold]) -> SetupError:
    """The best slip, with those that leave the same data.

    **Raises:** `InputError` when slips that fit equally well would put the data right in different ways.
    """
    first, *others = (own for own in retold if own.left < retold[0].left + ALIKE)
    ideal = as_intended(first.data, first.attitudes)
    if any(np.max(np.abs(as_intended(own.data, own.attitudes) - ideal)) > SAME for own in others):
        raise InputError(_several(first.data, [first.slip.words, *(own.slip.words for own in others)]))
    return replace(first.slip, equal=tuple((own.slip.label, own.slip.words) for own in others))


def _mirrors(data: PositionSet, told: _Retold) -> bool:
    """Whether a slip leaves what one axis of the other sign would, in the mountings and runs that it moves."""
    written, ideal = as_intended(data, told.attitudes), as_intended(told.data, told.attitudes)
    parts = _parts(data)
    moved = {part for part, here in zip(parts, np.max(np.abs(written - ideal), axis=1) > SAME, strict=True) if here}
    rows = np.array([part in moved for part in parts])
    signs = 1.0 - 2.0 * np.eye(3)
    return any(bool(np.max(np.abs(written[rows] - sign * ideal[rows]), initial=0.0) < SAME) for sign in signs)


def _several(data: PositionSet, slips: Sequence[str]) -> str:
    return (
        f"{data.source}: the readings do not follow the angles, and these slips would explain it equally well: "
        f"{'; or '.join(dict.fromkeys(slips))}; check the log and correct the angle columns"
    )


def _searches(data: PositionSet, attitudes: Attitudes) -> list[AngleSearch]:
    return [AngleSearch(data, attitudes, rows, mounting) for mounting, rows in _mountings(data)]


def _misfit(searches: Sequence[AngleSearch]) -> float:
    """Of the angles as written, all mountings together."""
    return sum(float(search.misfits([search.as_written()])[0][0]) for search in searches)


def _told_apart(searches: Sequence[AngleSearch], ideal: Float[np.ndarray, "positions 3"]) -> float:
    """The least misfit of what says more than a slip of other mountings: slips of each as it is turned, or the columns being
    other axes, of either sign, the same ones in all mountings."""
    # A misfit is the same whether readings or attitudes are taken to other axes.
    axes = np.stack([sign * turn.matrix for turn in quarter_turns() for sign in (1.0, -1.0)])
    mapped = np.sum([misfit(ideal[own.rows] @ axes, own.data.readings[own.rows])[0] for own in searches], axis=0)
    return min(float(np.min(mapped)), sum(min(own.best()[1], _misfit([own])) for own in searches))


def _shown(data: PositionSet) -> Attitudes:
    """What the readings show."""
    turns = turned_mountings(data)
    return _by_position(data, nominal_rotations(turns, list(turns)))


def _by_position(data: PositionSet, rotations) -> Attitudes:
    # Mountings are numbered as they first appear.
    mount = data.mount or ("1",) * len(data)
    number = {label: k for k, label in enumerate(dict.fromkeys(mount))}
    return None if rotations is None else np.asarray(rotations)[[number[label] for label in mount]]


def _parts(data: PositionSet) -> list[tuple[str, str]]:
    """Mounting and run of each position."""
    return list(zip(data.mount or ("1",) * len(data), data.run or ("1",) * len(data), strict=True))


def _mountings(data: PositionSet) -> Iterator[tuple[str, Bool[np.ndarray, " positions"]]]:
    mount = np.array(data.mount or ("1",) * len(data))
    for label in dict.fromkeys(mount.tolist()):
        yield label, mount == label

"""Correction of wrong angles: for each mounting separately, or by one set-up error of the whole file."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.chain import Chain
from tumblecal.data import PositionSet
from tumblecal.estimation.angle_hypotheses import SAME, AngleHypothesis, AngleSearch, with_angles
from tumblecal.estimation.angle_misfit import EQUAL, SEPARATE, misfit
from tumblecal.estimation.axes_of_parts import PartMap, part_maps
from tumblecal.estimation.mountings import nominal_rotations, quarter_turns, turned_mountings
from tumblecal.estimation.setup_error import SetupError
from tumblecal.ground.errors import InputError
from tumblecal.ground.frames import gravity_in_head


# The intended rotation of the triad at every position; None for none.
Attitudes = Float[np.ndarray, "positions 3 3"] | None
# Readings on the plan's axes, and the set-up error of the axes.
Mapped = tuple[Float[np.ndarray, "positions 3"], SetupError]

# No correction is made if more of the rows than this are outliers under the best hypothesis.
_MOST_OUTLIERS = 0.5
# A correction must reduce the misfit below this share. True errors left at most 1 %; an effect of a thousand sigma that
# resembled one left more than half (conditions of benchmarks/blind/conditions.py).
_MOST_REMAINING = 0.4
# With more mountings and runs than this, an error in one of them is not tried together with new turns of the mountings.
_MOST_PARTS = 12


def with_turns(data: PositionSet, chain: Chain | None) -> tuple[PositionSet, Attitudes, list[SetupError]]:
    """A set with the intended rotation of the triad at each position: that of the chain, otherwise that of the readings.

    The set is corrected if the readings follow the angles only under one set-up error of the whole file.

    **Raises:** `InputError` as `turned_mountings`.
    """
    if chain is not None:
        return data, _by_position(data, chain.orientations), []
    try:
        attitudes, refused = _turns_in_readings(data), None
    except InputError as fault:
        attitudes, refused = None, fault
    searches = [] if refused is not None else _searches(data, attitudes)
    before = _misfit(searches) if searches else np.inf
    if before > SEPARATE and 1 < len(set(_parts(data))) <= _MOST_PARTS:
        without_retry = _misfit_without_retry(searches, as_intended(data, attitudes)) if searches else np.inf
        retried = _retry(data)
        if retried and retried[0].misfit < min(without_retry - SEPARATE, _MOST_REMAINING * before):
            error = _only_error(retried)
            if refused is None or not _mirrors(data, retried[0]):
                return retried[0].data, retried[0].attitudes, [error]
            same = "; or ".join([error.words, *(words for _, words in error.equal)])
            raise InputError(f"{refused}; or, indistinguishable here: {same}")
    if refused is not None:
        raise refused
    return data, attitudes, []


def as_intended(data: PositionSet, attitudes: Attitudes) -> Float[np.ndarray, "positions 3"]:
    """Readings of a perfect instrument at the recorded angles, g."""
    ideal = gravity_in_head(data.alpha, data.beta)
    return ideal if attitudes is None else np.einsum("nij,nj->ni", attitudes, ideal)


def correct_angles(
    data: PositionSet, chain: Chain | None, attitudes: Attitudes, axis_map: Mapped | None
) -> tuple[PositionSet, list[SetupError]]:
    """The set with corrected angles, or axes, if the readings do not follow them.

    **Arguments:**

    - `attitudes`: as from `with_turns`. `axis_map`: readings on other axes, the alternative explanation.

    **Raises:** `InputError` for angles that the readings do not follow, or that have several possible corrections.
    """
    searches = _searches(data, attitudes)
    as_written = [search.misfits([search.as_written()]) for search in searches]
    if all(float(cost[0]) < SEPARATE for cost, _ in as_written):
        return data, []
    before = sum(float(cost[0]) for cost, _ in as_written)
    by_axes, ideal = np.inf, as_intended(data, attitudes)
    if axis_map:
        by_axes = sum(float(misfit(ideal[None, search.rows], axis_map[0][search.rows])[0][0]) for search in searches)
    best = [search.best() for search in searches]
    of_parts = [part_maps(search, ideal) for search in searches]
    least_misfit = min(sum(cost for _, cost, _ in best), sum(cost for _, cost in of_parts))
    if axis_map and by_axes < before - SEPARATE and by_axes < least_misfit + EQUAL:
        equal_angles = [best[0][0][0]] if len(best) == 1 and best[0][1] < by_axes + EQUAL else []
        equal = (*axis_map[1].equal, *((hypothesis.label, hypothesis.words) for hypothesis in equal_angles))
        return replace(data, readings=axis_map[0]), [replace(axis_map[1], equal=equal)]
    errors: list[tuple[str, SetupError]] = []
    for search, (cost, close), (hypotheses, least, close_after), (maps, by_axes) in zip(
        searches, as_written, best, of_parts, strict=True
    ):
        before_this = float(cost[0])
        if by_axes < min(before_this - SEPARATE, _MOST_REMAINING * before_this) and _axes_rather_than_angles(
            search, maps[0], by_axes, hypotheses, least
        ):
            if len(maps) > 1:
                raise InputError(_ambiguous(data, [part.words for part in maps]))
            errors.append((search.mounting, SetupError("axis_map", maps[0].words)))
            data = replace(data, readings=maps[0].corrected(data.readings))
        elif least < min(before_this - SEPARATE, _MOST_REMAINING * before_this) and close_after > 1 - _MOST_OUTLIERS:
            errors.append((search.mounting, _unambiguous(search, hypotheses)))
            data = with_angles(data, hypotheses[0], search.rows)
        elif close[0] < 1 - _MOST_OUTLIERS:
            raise InputError(
                f"{data.source}: the readings do not follow the angles ({1 - close[0]:.0%} of the positions differ by more "
                "than 0.1 g for any plausible sensor errors); check angle columns, axes and units against the log"
            )
    return data, _merged(errors, len(searches))


def _axes_rather_than_angles(
    search: AngleSearch, best: PartMap, by_axes: float, hypotheses: Sequence[AngleHypothesis], least: float
) -> bool:
    """Whether wrong axes explain the readings better than the angles of a hypothesis.

    If both imply the same attitudes, the bias of the sensor decides.
    """
    if not hypotheses or abs(by_axes - least) > EQUAL:
        return by_axes < least
    residual_ss = search.ss_with_pitch_errors(search.as_written(), best.corrected(search.data.readings))
    return residual_ss < _MOST_REMAINING * search.ss_with_pitch_errors(hypotheses[0])


def _merged(errors: Sequence[tuple[str, SetupError]], mountings: int) -> list[SetupError]:
    """Errors by mounting: one that all mountings share is listed once, others with their mounting."""
    found = [error for _, error in errors]
    if len(errors) == mountings > 0 and len({(error.label, error.words) for error in found}) == 1:
        # The equivalent errors have different words in each mounting, because their positions differ.
        others = list(dict.fromkeys(error.equal for error in found))
        same_ids = len({tuple(label for label, _ in equal) for equal in others}) == 1
        together = zip(*others, strict=True) if same_ids else ()
        equal = tuple((each[0][0], "; ".join(dict.fromkeys(words for _, words in each))) for each in together)
        return [replace(found[0], equal=equal)]
    if mountings == 1:
        return found
    return [replace(error, words=f"{error.words} in mounting {mounting}") for mounting, error in errors]


def _unambiguous(search: AngleSearch, hypotheses: Sequence[AngleHypothesis]) -> SetupError:
    """The best hypothesis.

    **Raises:** `InputError` if hypotheses that fit equally well imply different corrections.
    """
    first, *others = hypotheses
    if not all(search.same(first, other) for other in others):
        raise InputError(_ambiguous(search.data, [hypothesis.words for hypothesis in hypotheses]))
    equal = [*first.equal, *((hypothesis.label, hypothesis.words) for hypothesis in others)]
    pair = search.exchanged_pair(first)
    if pair is not None:
        exchanged = " and ".join(search.data.names[row] for row in pair)
        equal.append(("swapped_positions", f"positions {exchanged} are exchanged"))
    return SetupError(first.label, first.words, tuple(equal))


class _Retried(NamedTuple):
    """A set at the angles of one error, the turns of its mountings at these angles, and the misfit."""

    misfit: float
    data: PositionSet
    attitudes: Attitudes
    error: SetupError


def _retry(data: PositionSet) -> list[_Retried]:
    """Errors of all rows, or of one mounting, with which the turns of the mountings are unambiguous; the best first."""
    every, retried = np.ones(len(data), bool), []
    for place, rows in [("", every), *((f" in mounting {label}", rows) for label, rows in _mountings(data))]:
        for hypothesis in AngleSearch(data, None, rows).scale_errors():
            moved = with_angles(data, hypothesis, rows)
            try:
                attitudes = _turns_in_readings(moved)
            except InputError:
                continue
            error = SetupError(hypothesis.label, hypothesis.words + place)
            retried.append(_Retried(_misfit(_searches(moved, attitudes)), moved, attitudes, error))
    return sorted(retried, key=lambda candidate: candidate.misfit)


def _only_error(retried: Sequence[_Retried]) -> SetupError:
    """The best error, with those that produce the same data.

    **Raises:** `InputError` if errors that fit equally well imply different corrections.
    """
    first, *others = (candidate for candidate in retried if candidate.misfit < retried[0].misfit + EQUAL)
    ideal = as_intended(first.data, first.attitudes)
    if any(np.max(np.abs(as_intended(candidate.data, candidate.attitudes) - ideal)) > SAME for candidate in others):
        raise InputError(_ambiguous(first.data, [first.error.words, *(candidate.error.words for candidate in others)]))
    return replace(first.error, equal=tuple((candidate.error.label, candidate.error.words) for candidate in others))


def _mirrors(data: PositionSet, best: _Retried) -> bool:
    """Whether an error has the effect of one axis with the wrong sign, in the mountings and runs that it changes."""
    written, ideal = as_intended(data, best.attitudes), as_intended(best.data, best.attitudes)
    parts = _parts(data)
    moved = {part for part, here in zip(parts, np.max(np.abs(written - ideal), axis=1) > SAME, strict=True) if here}
    rows = np.array([part in moved for part in parts])
    signs = 1.0 - 2.0 * np.eye(3)
    return any(bool(np.max(np.abs(written[rows] - sign * ideal[rows]), initial=0.0) < SAME) for sign in signs)


def _ambiguous(data: PositionSet, errors: Sequence[str]) -> str:
    return (
        f"{data.source}: the readings do not follow the angles, and these errors would explain it equally well: "
        f"{'; or '.join(dict.fromkeys(errors))}; check the log and correct the angle columns"
    )


def _searches(data: PositionSet, attitudes: Attitudes) -> list[AngleSearch]:
    return [AngleSearch(data, attitudes, rows, mounting) for mounting, rows in _mountings(data)]


def _misfit(searches: Sequence[AngleSearch]) -> float:
    """Misfit of the recorded angles, all mountings together."""
    return sum(float(search.misfits([search.as_written()])[0][0]) for search in searches)


def _misfit_without_retry(searches: Sequence[AngleSearch], ideal: Float[np.ndarray, "positions 3"]) -> float:
    """The least misfit of simpler explanations: separate errors of the mountings as turned, or other axes of the columns with
    either sign, the same in all mountings."""
    # The misfit is the same whether readings or attitudes are converted to other axes.
    axes = np.stack([sign * turn.matrix for turn in quarter_turns() for sign in (1.0, -1.0)])
    by_axes = np.sum(
        [misfit(ideal[search.rows] @ axes, search.data.readings[search.rows])[0] for search in searches], axis=0
    )
    return min(float(np.min(by_axes)), sum(min(search.best()[1], _misfit([search])) for search in searches))


def _turns_in_readings(data: PositionSet) -> Attitudes:
    """Intended rotations according to the readings."""
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

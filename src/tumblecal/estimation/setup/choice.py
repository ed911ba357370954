"""The set-up error of the angles or axes under which the readings follow them: of the whole file, or of each mounting."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from tumblecal.chain import Chain
from tumblecal.data import PositionSet
from tumblecal.estimation.mountings import nominal_rotations, turned_mountings
from tumblecal.estimation.setup.error import SetupError
from tumblecal.estimation.setup.hypotheses import (
    SAME,
    Attitudes,
    Hypothesis,
    Mounting,
    axis_maps,
    scale_errors,
)
from tumblecal.estimation.setup.sensor_fit import EQUAL, SEPARATE, misfit
from tumblecal.ground.errors import InputError
from tumblecal.ground.frames import gravity_in_head


# No correction is made if more of the rows than this are outliers under the best hypothesis.
_MOST_OUTLIERS = 0.5
# A correction must reduce the misfit below this share. True errors left at most 1 %; an effect of a thousand sigma that
# resembled one left more than half (conditions of benchmarks/blind/conditions.py).
_MOST_REMAINING = 0.4
# With more mountings and runs than this, an error in one of them is not tried together with new turns of the mountings.
_MOST_PARTS = 12


@dataclass(frozen=True)
class Turned:
    """A set with the intended rotation of the triad at each position, its mountings, and their misfit; `error`: the corrected
    one, if any."""

    data: PositionSet
    attitudes: Attitudes
    error: SetupError | None = None

    @cached_property
    def mountings(self) -> list[Mounting]:
        """The mountings, whose hypotheses are independent."""
        return [Mounting(self.data, self.attitudes, rows, label) for label, rows in self.data.mountings.items()]

    @cached_property
    def misfit(self) -> float:
        """Misfit of the angles, all mountings together."""
        return sum(mounting.written[0] for mounting in self.mountings)

    @cached_property
    def ideal(self) -> Float[np.ndarray, "positions 3"]:
        """Readings of a perfect instrument, g."""
        f = gravity_in_head(self.data.alpha, self.data.beta)
        return f if self.attitudes is None else np.einsum("nij,nj->ni", self.attitudes, f)


def turned(data: PositionSet, chain: Chain | None) -> Turned:
    """A set with the intended rotation of the triad at each position: that of the chain, otherwise that of the readings.

    The set is corrected if the readings follow the angles only under one set-up error of the whole file, or of one mounting.

    **Raises:** `InputError` as `turned_mountings`.
    """
    if chain is not None:
        return Turned(data, _by_position(data, chain.orientations))
    written, refused = None, None
    try:
        written = _in_readings(data)
    except InputError as fault:
        refused = fault
    before = np.inf if written is None else written.misfit
    parts = len({*zip(data.labels("mount"), data.labels("run"), strict=True)})
    if before > SEPARATE and 1 < parts <= _MOST_PARTS and (retried := _retried(data)):
        simpler = np.inf if written is None else _simpler(written)
        if retried[0].misfit < min(simpler - SEPARATE, _MOST_REMAINING * before):
            best = _only_one(retried)
            if refused is None or not _mirrors(data, best):
                return best
            assert best.error is not None
            words = [best.error.words, *(words for _, words in best.error.equal)]
            raise InputError(f"{refused}; or, indistinguishable here: {'; or '.join(words)}")
    if written is None:
        assert refused is not None
        raise refused
    return written


def with_right_angles(as_turned: Turned) -> tuple[PositionSet, list[SetupError]]:
    """The set with corrected angles, or axes, if the readings do not follow them.

    **Raises:** `InputError` for angles that the readings do not follow, or that have several possible corrections.
    """
    data, mountings = as_turned.data, as_turned.mountings
    if all(mounting.written[0] < SEPARATE for mounting in mountings):
        return data, []
    by_axes = _axes_of_file(as_turned)
    best = int(np.argmin(by_axes))
    least = sum(mounting.best[1] for mounting in mountings)
    if by_axes[best] < min(as_turned.misfit - SEPARATE, least + EQUAL):
        axes = axis_maps()[best]
        same_angles = [own for own in mountings[0].best[0] if own.axes is None][: len(mountings) == 1]
        equal = [(own.label, own.words) for own in same_angles if mountings[0].best[1] < by_axes[best] + EQUAL]
        return replace(data, readings=data.readings @ axes.matrix), [
            SetupError("axis_map", axes.words, (*axes.equal, *equal))
        ]
    errors: list[tuple[str, SetupError]] = []
    for mounting in mountings:
        before, close = mounting.written
        hypotheses, after, close_after = mounting.best
        if after < min(before - SEPARATE, _MOST_REMAINING * before) and close_after > 1 - _MOST_OUTLIERS:
            errors.append((mounting.label, _error_of(mounting, hypotheses)))
            data = hypotheses[0].corrected(data, mounting.rows)
        elif close < 1 - _MOST_OUTLIERS:
            raise InputError(
                f"{data.source}: the readings do not follow the angles ({1 - close:.0%} of the positions differ by more "
                "than 0.1 g for any plausible sensor errors); check angle columns, axes and units against the log"
            )
    return data, _merged(errors, len(mountings))


def _error_of(mounting: Mounting, hypotheses: Sequence[Hypothesis]) -> SetupError:
    """The best hypothesis.

    **Raises:** `InputError` if hypotheses that fit equally well imply different corrections.
    """
    first, *others = (own for own in hypotheses if (own.axes is None) == (hypotheses[0].axes is None))
    if not all(mounting.same(first, other) for other in others):
        raise InputError(_ambiguous(mounting.data, (own.words for own in (first, *others))))
    equal = [*first.equal, *((own.label, own.words) for own in others if own.axes is None)]
    if first.axes is None and (pair := mounting.exchanged_pair(first)):
        equal.append(("swapped_positions", f"positions {pair} are exchanged"))
    return SetupError(first.label, first.words, tuple(equal))


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


def _axes_of_file(as_turned: Turned) -> Float[np.ndarray, " maps"]:
    """Misfit of each of the `axis_maps` in all rows."""
    ideal, readings = as_turned.ideal, as_turned.data.readings
    mapped = np.stack([ideal @ axes.matrix.T for axes in axis_maps()])
    rows = as_turned.data.mountings.values()
    return np.sum([misfit(mapped[:, here], readings[here])[0] for here in rows], axis=0)


def _simpler(written: Turned) -> float:
    """The least misfit of simpler explanations: separate errors of the mountings as turned, or other axes of the columns, the
    same in all mountings."""
    of_mountings = sum(min(mounting.best[1], mounting.written[0]) for mounting in written.mountings)
    return min(float(np.min(_axes_of_file(written))), of_mountings)


def _retried(data: PositionSet) -> list[Turned]:
    """The set under errors of all rows, or of one mounting, with which the turns of the mountings are unambiguous; the best
    first."""
    places = {"": np.ones(len(data), bool)} | {f" in mounting {label}": rows for label, rows in data.mountings.items()}
    retried = []
    for place, rows in places.items():
        for hypothesis in scale_errors(Mounting(data, None, rows)):
            try:
                moved = _in_readings(hypothesis.corrected(data, rows))
            except InputError:
                continue
            retried.append(replace(moved, error=SetupError(hypothesis.label, hypothesis.words + place)))
    return sorted(retried, key=lambda each: each.misfit)


def _only_one(retried: Sequence[Turned]) -> Turned:
    """The best error, with those that produce the same data.

    **Raises:** `InputError` if errors that fit equally well imply different corrections.
    """
    first, *others = (each for each in retried if each.misfit < retried[0].misfit + EQUAL)
    errors = [each.error for each in (first, *others) if each.error is not None]
    if any(np.max(np.abs(other.ideal - first.ideal)) > SAME for other in others):
        raise InputError(_ambiguous(first.data, (error.words for error in errors)))
    equal = tuple((error.label, error.words) for error in errors[1:])
    return replace(first, error=replace(errors[0], equal=equal))


def _mirrors(data: PositionSet, best: Turned) -> bool:
    """Whether an error has the effect of one axis with the wrong sign, in the mountings and runs that it changes."""
    written, ideal = Turned(data, best.attitudes).ideal, best.ideal
    parts = list(zip(data.labels("mount"), data.labels("run"), strict=True))
    moved = {part for part, here in zip(parts, np.max(np.abs(written - ideal), axis=1) > SAME, strict=True) if here}
    rows = np.array([part in moved for part in parts])
    signs = 1.0 - 2.0 * np.eye(3)
    return any(bool(np.max(np.abs(written[rows] - sign * ideal[rows]), initial=0.0) < SAME) for sign in signs)


def _ambiguous(data: PositionSet, errors: Iterable[str]) -> str:
    return (
        f"{data.source}: the readings do not follow the angles, and these errors would explain it equally well: "
        f"{'; or '.join(dict.fromkeys(errors))}; check the log and correct the angle columns"
    )


def _in_readings(data: PositionSet) -> Turned:
    """Intended rotations according to the readings."""
    turns = turned_mountings(data)
    return Turned(data, _by_position(data, nominal_rotations(turns, list(turns))))


def _by_position(data: PositionSet, rotations) -> Attitudes:
    # Mountings are numbered as they first appear.
    number = {label: k for k, label in enumerate(data.mountings)}
    return None if rotations is None else np.asarray(rotations)[[number[label] for label in data.labels("mount")]]

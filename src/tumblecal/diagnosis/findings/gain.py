"""The improvement by the extended model, for held-out data.

Predictions are for data that are not used in the fit, nor in the selection of causes, if it is repeated (`chosen_anew`). For
every fold the search is then made on the linearised chain without it: the fold's readings get free values, which is equivalent
to excluding them. The selected causes are fitted to the rest and predict the fold. This improvement is that of the whole
procedure, not of a selection that fits by chance. The folds are searched together: they differ only in the excluded
directions.
"""

from dataclasses import dataclass
from itertools import combinations, groupby

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import special

from tumblecal.data import PositionSet
from tumblecal.diagnosis.priors import FOLD_ROUNDS, FOLD_SETS, FOLD_SINGLES, NEAR_IN_FOLDS
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.diagnosis.sets.cause_sets import MOST, Members, rows_of
from tumblecal.diagnosis.sets.partial_set import partial_sets, with_each
from tumblecal.diagnosis.sets.prior import SetPriors
from tumblecal.estimation.fit import Fit
from tumblecal.ground.errors import InputError


# Least singular value of a direction of the residual space that is lost without a fold.
_TAKEN = 1e-6
# So many numbers of one array are computed at once.
_NUMBERS_AT_ONCE = 2_000_000


@dataclass(frozen=True)
class Gain:
    """The improvement of the extended model over the nominal one.

    Cross-validated numbers are root mean squares of prediction errors for held-out positions (or runs), the same positions for
    both, g; `cv_gain_sd_g` is the standard error of their difference. `cv_same_causes` is the share of folds that selected the
    same causes, or causes that the data cannot distinguish from them. If it is a number, `cv_rms_after_g` is with the causes
    selected without each fold; otherwise with fixed causes, as `cv_rms_kept_g` always is. The `fresh` ones are the expectation
    for a new measurement at the same positions.
    """

    rms_before_g: float
    rms_after_g: float
    cv_rms_before_g: float
    cv_rms_after_g: float
    cv_rms_kept_g: float
    cv_same_causes: float | None
    cv_gain_sd_g: float
    cv_kind: str
    fresh_rms_before_g: float
    fresh_rms_after_g: float
    fresh_gain_sd_g: float
    delta_bic: float
    f_statistic: float | None
    f_p_value: float | None


def gain(
    before: Fit,
    after: Fit,
    groups: Int[np.ndarray, " positions"],
    kind: str,
    nested: tuple[Float[np.ndarray, "positions 3"], Bool[np.ndarray, " folds"]] | None = None,
) -> Gain:
    """Compare two fits of the same data.

    **Arguments:**

    - `before`, `after`: nominal and extended.
    - `groups`: the fold of each position; `kind` names the folds in words.
    - `nested`: errors with the causes selected in every fold, and whether they were the same (`chosen_anew`).
    """
    both, known = before.retained & after.retained, after.problem.known
    judged = both & (groups >= 0)
    cv_before, cv_kept = (left_out(fit, groups)[judged] for fit in (before, after))
    cv_after = cv_kept if nested is None else nested[0][judged]
    cv_rms_before, cv_rms_after, cv_gain_sd = _rms_and_gain(np.mean(cv_before**2, axis=1), np.mean(cv_after**2, axis=1))
    # What new readings at the same positions would show: the residuals' mean square plus twice the noise variance times the
    # leverage (Mallows 1973); the noise is that which the extended model leaves.
    noise = (1.0 if known else after.level) * after.problem.sd
    leverages = [np.sum(fit.column_space[: noise.size] ** 2, axis=1).reshape(-1, 3) for fit in (before, after)]
    fresh = [
        np.mean(fit.residuals**2 + 2 * leverage * noise**2, axis=1)[both]
        for fit, leverage in zip((before, after), leverages, strict=True)
    ]
    fresh_before, fresh_after, fresh_gain_sd = _rms_and_gain(*fresh)
    count, more = before.residuals.size, after.parameters - before.parameters
    more += 3 * int(np.sum(before.retained & ~after.retained))
    chi2 = after.chi2 - before.chi2 if known else count * np.log(max(after.chi2, 1e-300) / before.chi2)
    statistic = p_value = None
    if more > 0 and after.dof > 0:
        statistic = float((before.chi2 - after.chi2) / more / (1.0 if known else after.chi2 / after.dof))
        p_value = float(special.chdtrc(more, statistic * more) if known else special.fdtrc(more, after.dof, statistic))
    return Gain(
        rms_before_g=before.rms,
        rms_after_g=after.rms,
        cv_rms_before_g=cv_rms_before,
        cv_rms_after_g=cv_rms_after,
        cv_rms_kept_g=float(np.sqrt(np.mean(cv_kept**2))),
        cv_same_causes=None if nested is None else float(np.mean(nested[1])),
        cv_gain_sd_g=cv_gain_sd,
        cv_kind=kind,
        fresh_rms_before_g=fresh_before,
        fresh_rms_after_g=fresh_after,
        fresh_gain_sd_g=fresh_gain_sd,
        delta_bic=float(chi2 + more * np.log(count)),
        f_statistic=statistic,
        f_p_value=p_value,
    )


def _rms_and_gain(
    before: Float[np.ndarray, " positions"], after: Float[np.ndarray, " positions"]
) -> tuple[float, float, float]:
    """Root mean squares of two models from their mean squares by position, and the standard error of the difference."""
    rms_before, rms_after = (float(np.sqrt(np.mean(squares))) for squares in (before, after))
    spread = float(np.std(before - after) / np.sqrt(len(before)))
    return rms_before, rms_after, spread / max(rms_before + rms_after, 1e-300)


def left_out(fit: Fit, groups: Int[np.ndarray, " positions"]) -> Float[np.ndarray, "positions 3"]:
    """Prediction errors of every fold from a fit to the others, g. Positions of the group -1 are in every fit: 0."""
    q, errors, of_rows = fit.column_space, np.zeros(fit.residuals.size), np.repeat(groups, 3)
    folds = [np.flatnonzero(of_rows == fold) for fold in np.unique(groups[groups >= 0])]
    # Folds of equal size together.
    for size in {len(rows) for rows in folds}:
        rows = np.array([own for own in folds if len(own) == size])
        errors[rows] = fold_errors(q[rows], fit.rows[rows])
    # With correlated noise the error is in white units; its scale is that of a reading.
    return errors.reshape(-1, 3) * fit.problem.sd


def fold_errors(
    q: Float[np.ndarray, "*folds rows parameters"], residual: Float[np.ndarray, "*folds rows"]
) -> Float[np.ndarray, "*folds rows"]:
    """Prediction errors of a fold by a linear fit to all other rows, from the fit to all: residual divided by (1 - leverage).

    Parameters that only the fold determines (the pitch error of a held-out run) are fitted to it first. The error is then that
    of the rest, scaled for the lost directions.

    **Arguments:**

    - `q`: the fold's rows of an orthonormal basis of the whole design; `residual`: of the fit to all.
    """
    size = q.shape[-2]
    values, vectors = np.linalg.eigh(np.eye(size) - q @ np.swapaxes(q, -1, -2))
    free = values > 1e-8
    along = np.einsum("...ij,...i->...j", vectors, residual)
    along = np.divide(along, values, out=np.zeros_like(along), where=free)
    scale = np.sqrt(size / np.maximum(np.sum(free, axis=-1, keepdims=True), 1))
    return np.einsum("...ij,...j->...i", vectors, along) * scale


def folds(data: PositionSet, holdout: tuple[str, str] | None) -> tuple[np.ndarray, str]:
    """The fold of each position (-1: always in the fit), and the kind of folds in words.

    **Raises:** `InputError` for a column or value that the data lack.
    """
    if holdout is not None:
        column, value = holdout
        labels = {"run": data.run, "mount": data.mount, "position": data.names}.get(column)
        if labels is None:
            raise InputError(
                f"--holdout {column}={value}: {data.source} has no column {column}; use run, mount or position"
            )
        left_out = np.array([label == value for label in labels])
        if not np.any(left_out) or np.all(left_out):
            # Of joined files the name of a position begins with the file's: m1:p0.
            known = sorted(dict.fromkeys(labels), key=lambda label: not label.endswith(f":{value}"))
            choices = ", ".join([*known[:8], *(["..."] if len(known) > 8 else [])])
            raise InputError(f"--holdout {column}={value}: {data.source} has {column} {choices}; name one of several")
        return np.where(left_out, 0, -1), f"{column} {value} left out"
    if len(data.runs) > 1 and data.run is not None:
        return np.array([data.runs.index(label) for label in data.run]), "leave one run out"
    return np.arange(len(data)), "leave one position out"


def testable_folds(
    fit: Fit, groups: Int[np.ndarray, " positions"], kind: str
) -> tuple[Int[np.ndarray, " positions"], str]:
    """The folds, or each position in turn, if the fit excludes all held-out positions or the others leave no freedom."""
    others = fit.retained & (groups != np.argmax(np.bincount(groups[groups >= 0])))
    if not np.any(fit.retained[groups >= 0]):
        reason = "the held-out positions are excluded from the fit"
    elif 3 * np.sum(others) <= np.linalg.matrix_rank(fit.column_space[: 3 * len(groups)][np.repeat(others, 3)], 1e-6):
        reason = "the positions that are not held out are too few for a fit"
    else:
        return groups, kind
    return np.arange(len(groups)), f"leave one position out, because {reason}"


def chosen_anew(
    screened: Screened, groups: Int[np.ndarray, " positions"]
) -> tuple[Float[np.ndarray, "positions 3"], Bool[np.ndarray, " folds"]]:
    """Prediction errors of every fold, with causes selected without it.

    **Arguments:**

    - `screened`: the screen of all data. `groups`: the fold of each position, -1: in every fit.

    **Returns:** measured minus predicted, g (0 for the group -1), and for each fold whether it selected the same causes, or
    causes that the data cannot distinguish from them.
    """
    equal = {frozenset(labels) for labels in (screened.best.labels, *screened.best.equivalents)}
    errors, of_rows = np.zeros(screened.problem.readings.size), np.repeat(groups, 3)
    folds = [np.flatnonzero(of_rows == fold) for fold in np.unique(groups[groups >= 0])]
    # Directions that are lost without each fold; folds that lose as many are searched together.
    asides = []
    for rows in folds:
        _, singular, directions = np.linalg.svd(screened.at.basis[rows], full_matrices=False)
        asides.append(directions[singular > _TAKEN])
    chosen: list[Members] = [()] * len(folds)
    order = sorted(range(len(folds)), key=lambda fold: len(asides[fold]))
    for _, own in groupby(order, key=lambda fold: len(asides[fold])):
        together = list(own)
        for fold, members in zip(together, _searched(screened, np.stack([asides[k] for k in together])), strict=True):
            chosen[fold] = members
    for members in set(chosen):
        q, residual = _fitted(screened, members)
        for rows in (rows for rows, causes in zip(folds, chosen, strict=True) if causes == members):
            errors[rows] = fold_errors(q[rows], residual[rows])
    same = [frozenset(screened.pool.causes[k].label for k in members) in equal for members in chosen]
    return errors.reshape(-1, 3) * screened.problem.sd, np.array(same, bool)


def _searched(screened: Screened, asides: Float[np.ndarray, "folds out nu"]) -> list[Members]:
    """The best set of causes (indices into the pool) for each of several folds that set aside as many directions: from nothing,
    the best single causes and the best sets of all data, by adding, dropping and exchanging causes until no set is better.

    Further causes are those of the sets that come near in all data, and the best single ones without each fold.
    """
    search, ranked = screened.search, screened.search.ranked()
    pool, near = search.pool, ranked.members[ranked.log_posterior > ranked.log_posterior[0] - NEAR_IN_FOLDS]
    nothing = partial_sets(pool, search.z, [()] * len(asides), asides)
    alone = with_each(pool, search.known, nothing) + SetPriors.of(pool, rows_of([()])).with_each()
    singles = np.argpartition(-alone, min(FOLD_SINGLES, pool.size - 1), axis=1)[:, :FOLD_SINGLES]
    numbers = np.unique(np.concatenate([near[near >= 0], singles.ravel()]))
    further = pool.only(numbers)
    best: list[tuple[float, Members]] = [(-np.inf, ())] * len(asides)
    starts = dict.fromkeys([(), *(ranked.set_at(rank) for rank in range(min(FOLD_SETS, len(ranked.members))))])
    todo = [(fold, members) for members in starts for fold in range(len(asides))]
    todo += [(fold, (cause,)) for fold, own in enumerate(singles.tolist()) for cause in own]
    todo, tried = [*dict.fromkeys(todo)], set[tuple[int, Members]]()
    step = max(1, _NUMBERS_AT_ONCE // (MOST * (len(search.z) + further.size)))
    for _ in range(FOLD_ROUNDS):
        tried |= {*todo}
        for first in range(0, len(todo), step):
            some = todo[first : first + step]
            folds, sets = (list(part) for part in zip(*some, strict=True))
            bases, priors = partial_sets(pool, search.z, sets, asides[folds]), SetPriors.of(pool, rows_of(sets))
            own = bases.log_evidence(pool.dof, search.known) + priors.own
            enlarged = with_each(further, search.known, bases) + priors.with_each()[:, numbers]
            full = np.all(priors.there, axis=1, keepdims=True)
            scores = np.column_stack([own, np.where(full, -np.inf, enlarged)])
            for (fold, members), row, k in zip(some, scores, scores.argmax(axis=1).tolist(), strict=True):
                with_one = members if k == 0 else tuple(sorted((*members, int(numbers[k - 1]))))
                best[fold] = max(best[fold], (float(row[k]), with_one))
        # The best set of each fold, and it without each of its causes.
        several = ((fold, own) for fold, (_, own) in enumerate(best) if own)
        nexts = [(fold, part) for fold, own in several for part in (own, *combinations(own, len(own) - 1))]
        todo = [each for each in nexts if each not in tried]
        if not todo:
            break
    return [members for _, members in best]


def _fitted(
    screened: Screened, chosen: Members
) -> tuple[Float[np.ndarray, "rows columns"], Float[np.ndarray, " rows"]]:
    """Orthonormal basis of the nominal model and the chosen causes, and the residual of their fit to all rows."""
    at = screened.at
    residual, columns = at.residual.copy(), [at.reached]
    for cause in (screened.pool.causes[k] for k in chosen):
        if cause.offset is not None:
            residual -= at.basis @ cause.offset
        elif cause.block is not None:
            # What the nominal model absorbs of a cause needs no column: only its part in the residual space counts.
            columns.append(at.basis @ cause.block)
    vectors, singular, _ = np.linalg.svd(np.hstack(columns), full_matrices=False)
    q = vectors[:, singular > _TAKEN * singular[0]]
    return q, residual - q @ (q.T @ residual)

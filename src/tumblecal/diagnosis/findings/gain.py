"""The improvement by the extended model, for held-out data.

Predictions are for data that are not used in the fit, nor in the selection of causes, if it is repeated (`chosen_anew`).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import special

from tumblecal.data import PositionSet
from tumblecal.estimation.fit import Fit
from tumblecal.ground.errors import InputError


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
    errors_before = left_out(before, groups)[judged]
    errors_kept = errors_before if after is before else left_out(after, groups)[judged]
    errors_after = errors_kept if nested is None else nested[0][judged]
    cv_before, cv_after, cv_kept = (
        float(np.sqrt(np.mean(errors**2))) for errors in (errors_before, errors_after, errors_kept)
    )
    difference = np.mean(errors_before**2 - errors_after**2, axis=1)
    spread = float(np.std(difference) / np.sqrt(len(difference)))
    fresh_before, fresh_after, fresh_spread = _fresh(before, after, both)
    more = after.parameters - before.parameters + 3 * int(np.sum(before.retained & ~after.retained))
    count = before.residuals.size
    if known:
        delta = after.chi2 - before.chi2 + more * np.log(count)
    else:
        delta = count * np.log(max(after.chi2, 1e-300) / before.chi2) + more * np.log(count)
    statistic = p_value = None
    if more > 0 and after.dof > 0:
        statistic = (before.chi2 - after.chi2) / more / (1.0 if known else after.chi2 / after.dof)
        p_value = float(special.chdtrc(more, statistic * more) if known else special.fdtrc(more, after.dof, statistic))
    return Gain(
        rms_before_g=before.rms,
        rms_after_g=after.rms,
        cv_rms_before_g=cv_before,
        cv_rms_after_g=cv_after,
        cv_rms_kept_g=cv_kept,
        cv_same_causes=None if nested is None else float(np.mean(nested[1])),
        cv_gain_sd_g=spread / max(cv_before + cv_after, 1e-300),
        cv_kind=kind,
        fresh_rms_before_g=fresh_before,
        fresh_rms_after_g=fresh_after,
        fresh_gain_sd_g=fresh_spread,
        delta_bic=float(delta),
        f_statistic=None if statistic is None else float(statistic),
        f_p_value=p_value,
    )


def _fresh(before: Fit, after: Fit, both: np.ndarray) -> tuple[float, float, float]:
    """What new readings at the same positions would show of the two fits, and the standard error of the gain, g.

    The residuals' mean square plus twice the noise variance times the leverage (Mallows 1973); the noise is that which
    the extended model leaves.
    """
    squares = []
    noise = (1.0 if after.problem.known else after.level) * after.problem.sd
    for fit in (before, after):
        leverage = np.sum(fit.column_space[: noise.size] ** 2, axis=1).reshape(-1, 3)
        squares.append(np.mean(fit.residuals**2 + 2 * leverage * noise**2, axis=1)[both])
    first, second = (float(np.sqrt(np.mean(square))) for square in squares)
    spread = float(np.std(squares[0] - squares[1]) / np.sqrt(len(squares[0])))
    return first, second, spread / max(first + second, 1e-300)


def left_out(fit: Fit, groups: Int[np.ndarray, " positions"]) -> Float[np.ndarray, "positions 3"]:
    """Prediction errors of every fold from a fit to the others, g. Positions of the group -1 are in every fit: 0."""
    q = fit.column_space
    errors = np.zeros(fit.residuals.size)
    numbers, sizes = np.unique(groups, return_counts=True)
    # Three rows a position, those of one fold together.
    order = (3 * np.argsort(groups, kind="stable")[:, None] + np.arange(3)).ravel()
    first = 3 * (np.cumsum(sizes) - sizes)
    for size in set(sizes[numbers >= 0].tolist()):
        rows = order[first[(sizes == size) & (numbers >= 0), None] + np.arange(3 * size)]
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

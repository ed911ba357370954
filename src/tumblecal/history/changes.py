"""Changes of the parameters of one kind over time: a step between two dates, a drift, or one deviating result.

The results of a parameter are a constant, changes, and deviations with the variance `between^2 + u^2`. The standard deviation
between dates is estimated from all parameters of the kind (Paule and Mandel 1982, J. Res. NBS 87, 377), so that five dates
suffice. The change that explains most of a parameter, or of all together, is compared with the residuals of all parameters of
the kind, each without the change that explains most of it. Its p-value is from simulated constant units. Changes are added
until none is significant.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq


STEP, DRIFT, RESULT = "step", "drift", "result"
# Variances of the parameters of one kind differ like chi-square of so many degrees of freedom, divided by them.
_SIMILARITY = 8.0
# Simulated units (fixed seed: the same results give the same p), fewer if there are many results.
_DRAWS, _FEWEST_DRAWS, _NUMBERS = 4000, 1000, 20_000_000
# Of a common change, a parameter has a part if it explains this multiple of the variance (three standard uncertainties).
_MOVED = 9.0
_MOST_CHANGES = 6  # of one parameter; more are not a description
# Kinds of change, and dates of a step, with a smaller posterior probability are not stated.
_POSSIBLE = 0.05
# A variance (base units) below any resolution, for equal results without a stated uncertainty.
_NO_VARIANCE = 1e-30


@dataclass(frozen=True)
class Change:
    """A change of a parameter.

    - `kind`: `STEP` between the results `first` and `last`; `DRIFT`; or `RESULT`, which is `first` and `last`.
    - `signal`: by a size of 1 (a drift: 1 a month). `alternatives`: other kinds that the results do not exclude.
    - `size`, `u`: estimate and standard uncertainty, base units (a drift: per month).
    """

    kind: str
    first: int
    last: int
    signal: Float[np.ndarray, " results"]
    alternatives: tuple[str, ...] = ()
    size: float = 0.0
    u: float = 0.0


@dataclass(frozen=True)
class KindOverTime:
    """The parameters of one kind, base units.

    - `changes`: the significant ones of each parameter; `fitted`: values by constant and changes; `p_values`: of no change.
    - `between`: standard deviation between dates in addition to the stated uncertainties; `repeatability`: including them, for
      the median uncertainty, nan for one result; `dof`: degrees of freedom of both.
    - `slopes`: drift per month and its standard uncertainty, given the other changes; nan with fewer than three dates.
    """

    changes: list[list[Change]]
    fitted: Float[np.ndarray, "parameters results"]
    p_values: Float[np.ndarray, " parameters"]
    between: float
    repeatability: float
    dof: int
    slopes: Float[np.ndarray, "parameters 2"]


def over_time(
    values: Float[np.ndarray, "parameters results"],
    u: Float[np.ndarray, "parameters results"],
    months: Float[np.ndarray, " results"],
    level: float,
) -> KindOverTime:
    """Evaluate the parameters of one kind.

    **Arguments:**

    - `u`: standard uncertainties, base units, 0 if not stated. `months`: time of each result, not decreasing.
    - `level`: significance level of a change of one parameter, or of all together; 0 to find none.
    """
    # All changes that results at these times could show.
    order = np.arange(len(months))
    steps = [k for k in order[1:].tolist() if months[k] > months[k - 1]]
    possible = [Change(STEP, k - 1, k, (order >= k).astype(float)) for k in steps]
    possible += [Change(DRIFT, 0, len(months) - 1, months)] * (len(steps) > 1)
    possible += [Change(RESULT, k, k, (order == k).astype(float)) for k in order.tolist() if len(months) > 1]
    signals = np.array([change.signal for change in possible]).reshape(-1, len(months))
    found, fitted = [list[Change]() for _ in values], np.mean(values, axis=1, keepdims=True) + 0 * values
    dof, p_values = np.full(len(values), len(months) - 1), np.ones(len(values))
    for round_ in range(_MOST_CHANGES):
        spare = np.maximum(dof - 1, 0)
        total = np.sqrt(u**2 + _variance_between(values - fitted, u, signals, spare, searched=True))
        tails, further = _search(values - fitted, u / total, total, possible, spare, level)
        p_values = p_values if round_ else tails
        for k, change in further.items():
            found[k].append(change)
            dof[k] -= 1
        fitted = np.stack([_line(*rows)[2] for rows in zip(values, total, found, strict=True)])
        if not further:
            break
    total = np.sqrt(u**2 + (variance := _variance_between(values - fitted, u, signals, dof, searched=False)))
    slopes = []
    for k, changes in enumerate(found):
        line, sd, fitted[k] = _line(values[k], total[k], changes)
        found[k] = [replace(change, size=line[j], u=sd[j]) for j, change in enumerate(changes, 1)]
        line, sd, _ = _line(
            values[k], total[k], [*(c for c in changes if c.kind != DRIFT), Change(DRIFT, 0, 0, months)]
        )
        slopes.append((line[-1], sd[-1]))
    chi2 = np.sum(((values - fitted) / total) ** 2)
    repeatability = float(np.median(total) * np.sqrt(chi2 / np.sum(dof))) if np.sum(dof) > 0 else float("nan")
    between = float(np.sqrt(variance)) if variance > _NO_VARIANCE else 0.0
    return KindOverTime(found, fitted, p_values, between, repeatability, int(np.sum(dof)), np.array(slopes))


def _search(
    residual: Float[np.ndarray, "parameters results"],
    stated: Float[np.ndarray, "parameters results"],
    total: Float[np.ndarray, "parameters results"],
    possible: Sequence[Change],
    dof: np.ndarray,
    level: float,
) -> tuple[Float[np.ndarray, " parameters"], dict[int, Change]]:
    """Search for a further change of each parameter, or a common one of all.

    **Arguments:**

    - `residual`: without the changes found. `total`: standard deviations; `stated`: their stated part.
    - `dof`: degrees of freedom of the residuals of each parameter without a further change.

    **Returns:** the p-value of no further change of each parameter (1 with too few results), and the significant changes.
    """
    signals = np.array([change.signal for change in possible]).reshape(-1, total.shape[1])
    # The residuals of the other parameters count by their similarity; the last row is of all together.
    others = np.sum(dof) - dof
    share = np.eye(len(dof)) + (1 - np.eye(len(dof))) * (_SIMILARITY / (_SIMILARITY + others))[:, None]
    pooled = np.maximum(np.r_[share @ dof, np.sum(dof)], 1e-9)
    pool = np.pad(share, (0, 1)) / pooled[:, None]
    pool[-1, -1] = 1 / pooled[-1]
    explained, best, rest = _explained((residual / total)[..., None], total, signals)
    # An estimated variance is never below the stated part.
    least = np.mean(stated**2, axis=1)
    variance = np.maximum(pool @ rest, np.r_[least, np.mean(least)][:, None] + _NO_VARIANCE)
    rng, draws = np.random.default_rng(0), int(np.clip(_NUMBERS / (signals.size + 1), _FEWEST_DRAWS, _DRAWS))
    spread = np.sqrt(_SIMILARITY / rng.chisquare(_SIMILARITY, (len(total), 1, draws)))
    _, simulated, rest = _explained(spread * rng.normal(size=(*total.shape, draws)), total, signals)
    beyond = simulated * variance >= best * (pool @ rest)
    tails = np.where(np.r_[dof, np.sum(dof)] > 0, (1 + np.sum(beyond, axis=1)) / (1 + draws), 1.0)
    misfit = (best - explained[..., 0]) / (pooled[:, None] * variance)
    likelihoods = (1 + misfit) ** (-(pooled[:, None] + 1) / 2)
    single = {k: _most_probable(likelihoods[k], possible) for k in np.flatnonzero(tails[:-1] < level).tolist()}
    if single or tails[-1] >= level:
        return tails[:-1], single
    common = _most_probable(likelihoods[-1], possible)
    part = explained[:-1, [change.signal is common.signal for change in possible], 0] > _MOVED * variance[:-1]
    return tails[:-1], dict.fromkeys(np.flatnonzero(part[:, 0] & (dof > 0)).tolist(), common)


def _explained(
    rows: Float[np.ndarray, "parameters results draws"],
    total: Float[np.ndarray, "parameters results"],
    signals: Float[np.ndarray, "changes results"],
) -> tuple[Float[np.ndarray, "rows changes draws"], Float[np.ndarray, "rows draws"], Float[np.ndarray, "rows draws"]]:
    """The sum of squares of deviations (in standard deviations) that each change explains in addition to a constant, the
    largest of them, and the rest without that. The last row is the sum over the parameters."""
    constant = 1 / total[..., None]
    constant /= np.linalg.norm(constant, axis=1, keepdims=True)

    def varying(part: np.ndarray) -> np.ndarray:
        return part - constant * np.sum(part * constant, axis=1, keepdims=True)

    units, residual = varying(signals.T / total[..., None]), varying(rows)
    units /= np.linalg.norm(units, axis=1, keepdims=True)
    explained, squares = (np.swapaxes(units, 1, 2) @ residual) ** 2, np.sum(residual**2, axis=1)
    explained, squares = (np.concatenate([part, np.sum(part, axis=0)[None]]) for part in (explained, squares))
    best = np.max(explained, axis=1, initial=0.0)
    return explained, best, squares - best


def _most_probable(likelihoods: Float[np.ndarray, " changes"], possible: Sequence[Change]) -> Change:
    """The most probable change; kinds have equal prior probabilities, and so have the dates of one kind."""
    kinds = np.array([change.kind for change in possible])
    weights = likelihoods / [np.sum(kinds == kind) for kind in kinds]
    of_kind = {kind: float(np.sum(weights[kinds == kind]) / np.sum(weights)) for kind in (STEP, DRIFT, RESULT)}
    first, *others = sorted(of_kind, key=lambda kind: -of_kind[kind])
    weights = np.where(kinds == first, weights, 0.0)
    change = possible[int(np.argmax(weights))]
    dates = np.flatnonzero(weights > _POSSIBLE * np.sum(weights)) if first == STEP else [possible.index(change)]
    return replace(
        change,
        first=possible[dates[0]].first,
        last=possible[dates[-1]].last,
        alternatives=tuple([kind for kind in others if of_kind[kind] > _POSSIBLE]),
    )


def _variance_between(
    residual: np.ndarray, u: np.ndarray, signals: np.ndarray, dof: np.ndarray, *, searched: bool
) -> float:
    """The variance between dates with which chi-square of the residuals equals its degrees of freedom, 0 if it is less.

    **Arguments:**

    - `searched`: whether the possible change of each parameter that explains most is also subtracted.
    """
    count, chosen = int(np.sum(dof)), signals if searched else signals[:0]

    def excess(variance: float) -> float:
        total = np.sqrt(u**2 + variance)
        return float(np.sum(_explained((residual / total)[..., None], total, chosen)[2][:-1])) - count

    if count == 0 or excess(_NO_VARIANCE) <= 0:
        return _NO_VARIANCE
    highest = 2 * float(np.sum(residual**2)) / count
    return brentq(excess, _NO_VARIANCE, highest, xtol=1e-9 * highest)  # pyright: ignore[reportReturnType]


def _line(
    values: np.ndarray, total: np.ndarray, changes: Sequence[Change]
) -> tuple[list[float], list[float], np.ndarray]:
    """Weighted least squares with a constant: coefficients, their standard uncertainties, and fitted values; coefficients are
    nan if the results do not determine them or leave no degree of freedom."""
    design = np.stack([np.ones(len(values)), *(change.signal for change in changes)], axis=1)
    weighted = design / total[:, None]
    if np.linalg.matrix_rank(weighted) < weighted.shape[1] or weighted.shape[1] == len(values) > 1:
        return [float("nan")], [float("nan")], np.full(len(values), np.nan)
    covariance = np.linalg.inv(weighted.T @ weighted)
    line = covariance @ weighted.T @ (values / total)
    return line.tolist(), np.sqrt(np.diag(covariance)).tolist(), design @ line

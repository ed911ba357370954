"""Parameters that the data determine: separately, only in combination, or in contradiction to their stated values."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.causes.cause import Cause
from tumblecal.diagnosis.priors import ONE_COEFFICIENT, SIZE, UNKNOWN
from tumblecal.diagnosis.refine.insert import fit_with
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.estimation.attitudes import attitude_words
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.identifiability import sparse_basis, surely_full_rank
from tumblecal.estimation.linearised import identifiability_of, linearised
from tumblecal.estimation.plausibility import Implausible, implausible
from tumblecal.estimation.problem import Problem
from tumblecal.full_model.tangent import robust_start, tangent
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import counted


LEAST_DOF = 3
# Positions of a plan that may well determine too little.
_FEW = 12
# Share of the priors' weight in the fit that judges them: parameters that the data do not determine keep their stated values.
_WEAK = 1e-3


@dataclass(frozen=True)
class Combination:
    """A combination of an effect's coefficients that the data determine; `value` and `sd` in their base unit.

    The largest weight is 1, the first positive; a coefficient that is determined by itself has the only one.
    """

    weights: dict[str, float]
    value: float
    sd: float


def combinations(fit: Fit, cause: Cause, scales: Float[np.ndarray, " full"]) -> list[Combination]:
    """As many combinations as an effect has directions that the residuals can show, each of few coefficients.

    Any other combination, and every coefficient that is not determined separately, could have any value: the nominal
    parameters absorb its signal.

    **Arguments:**

    - `fit`: with the effect in it. `cause`: the effect as it was inserted. `scales`: of the full vector.
    """
    slot = cause.slot
    if cause.directions is None:
        return []
    index = {column: fit.names.index(name) for column, name in zip(slot.all_columns, slot.names, strict=True)}
    listed = []
    for vector in (sparse_basis(cause.directions) / scales[list(slot.columns), None]).T:
        weights = np.round(vector / np.max(np.abs(vector)), 6)
        kept = [k for k in range(len(weights)) if abs(weights[k]) > ONE_COEFFICIENT]
        weights *= np.sign(weights[kept[0]])
        combination = _combination(fit, [index[slot.columns[k]] for k in kept], weights[kept])
        # The screen shows it; given the causes of the exact fit, it may be undetermined.
        if combination.sd < UNKNOWN * np.max(scales[[slot.columns[k] for k in kept]]):
            listed.append(combination)
    # A time constant that was fitted.
    shapes = [index[column] for column in slot.shape]
    return [*listed, *(_combination(fit, [k], np.ones(1)) for k in shapes if fit.noise_covariance[k, k] > 0)]


def _combination(fit: Fit, entries: list[int], weights: np.ndarray) -> Combination:
    return Combination(
        {fit.names[k]: float(weight) for k, weight in zip(entries, weights, strict=True)},
        float(weights @ fit.values[entries]),
        float(np.sqrt(weights @ fit.noise_covariance[np.ix_(entries, entries)] @ weights)),
    )


@np.errstate(invalid="ignore")
def says_something(fit: Fit, nominal: int) -> bool:
    """Whether a fit's parameters have standard deviations that say something of them; one that is lost in rounding does not.

    `nominal`: number of the nominal parameters, which are first; those of excluded positions alone need no value.
    """
    scales = dict(zip(fit.problem.chain.names, fit.problem.chain.scales.tolist(), strict=True))
    idle = {name for name, used in zip(fit.names[:nominal], fit.used.tolist(), strict=False) if not used}
    return all(
        sd < UNKNOWN * scales.get(name, 1.0)
        for name, sd in zip(fit.names, fit.sd.tolist(), strict=True)
        if name not in idle
    )


def contradicted_priors(screened: Screened) -> tuple[Implausible, ...]:
    """The parameters whose stated values the data contradict, if the nominal model explains the data without these: a head that
    was set up again after its measurement."""
    problem, model = screened.problem, screened.at.model
    if not (problem.with_prior and problem.known and screened.detection.detected):
        return ()
    weak = replace(problem, prior_weights=_WEAK * problem.prior_weights)
    fit = fit_with(tangent(model, weak, robust_start(model, weak)), ())
    if not fit.code.good or (fit.chi2_p_value or 0.0) < SIZE:
        return ()
    return tuple(unusual for unusual in implausible(replace(fit, problem=problem)) if unusual.stated is not None)


def require_enough(problem: Problem) -> None:
    """Reject a few positions that leave parameters undetermined, before the model of their plan is compiled.

    **Raises:** `InputError` as `require_determined`.
    """
    if len(problem.readings) < _FEW:
        require_determined(problem, np.asarray(linearised(problem, problem.chain.vector)[1]))


def require_determined(problem: Problem, jacobian: np.ndarray) -> None:
    """Reject designs in which nominal parameters are not determined, or no degrees of freedom remain for a test.

    **Raises:** `InputError` with the combinations that are not determined.
    """
    rows, free = jacobian.shape
    if not free:
        raise InputError(
            f"{problem.measured_data.source}: every parameter is fixed, so no model remains in which an effect can be found; "
            "leave one free, such as bias"
        )
    if rows - free >= LEAST_DOF and surely_full_rank(np.linalg.qr(jacobian, mode="r")):
        return
    chain, source = problem.chain, problem.measured_data.source
    readings = np.asarray(problem.readings)
    seen = identifiability_of(problem, jacobian)
    seen.require_full_rank(source, readings)
    dof = rows - free
    if dof < LEAST_DOF:
        following = attitude_words(readings) if seen.hand_held else ""
        raise InputError(
            f"{source}: {counted(len(readings), 'position')} and {counted(len(chain.names), 'parameter')} leave "
            f"{dof} degree{'' if dof == 1 else 's'} of freedom; a test needs at least {LEAST_DOF}: measure more positions"
            + (f". Next: {following}" if following else "")
        )

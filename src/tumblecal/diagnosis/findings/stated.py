"""Whether the data contradict only stated parameters: a head that was set up again after its measurement."""

from dataclasses import replace

from tumblecal.diagnosis.model.tangent import robust_start, tangent
from tumblecal.diagnosis.priors import SIZE
from tumblecal.diagnosis.refine.insert import fit_with
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.estimation.plausibility import Implausible, implausible


# By how much less the priors weigh where the data alone are to speak; what these do not show stays where it was stated.
_WEAK = 1e-3


def contradicted_priors(screened: Screened) -> tuple[Implausible, ...]:
    """The parameters whose stated values the data contradict, where the nominal model explains the data without these."""
    problem, model = screened.problem, screened.at.model
    if not (problem.with_prior and problem.known and screened.detection.detected):
        return ()
    weak = replace(problem, prior_weights=_WEAK * problem.prior_weights)
    fit = fit_with(tangent(model, weak, robust_start(model, weak)), ())
    if not fit.code.good or (fit.chi2_p_value or 0.0) < SIZE:
        return ()
    return tuple(unusual for unusual in implausible(replace(fit, problem=problem)) if unusual.stated is not None)

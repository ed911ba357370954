"""The live estimate of `tumblecal capture`: the parameters and their standard uncertainties after each position."""

from dataclasses import replace
from functools import cache

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.capture.run.session import Estimate


def live_estimate(plan: CapturePlan) -> Estimate:
    """The exact fit with a prior on all parameters; its modules are imported at the first accepted position."""
    problem = cache(lambda: _problem(plan))

    def estimate(measured):
        return _estimated(problem(), measured) if len(measured) >= 3 else []

    return estimate


# Prior standard deviation of each parameter (1, g, rad), and the smallest standard deviation of a reading: the nominal
# model has unknown effects.
_PRIOR_SD, _LEAST_SD_G = 0.005, 1e-4
_SHOWN = {"1": (1e3, "1e-3"), "g": (1e3, "mg"), "rad": (1e3, "mrad")}


def _problem(plan):
    """All positions of the plan with their expected readings: every estimate has its size, so all share one program."""
    import numpy as np

    from tumblecal.cli.start import start

    start()
    from tumblecal.data.positions import PositionSet
    from tumblecal.estimation.position_problem import default_chain, problem_of

    steps = plan.steps
    data = PositionSet(
        names=tuple(step.name for step in steps),
        alpha_deg=np.array([step.alpha_deg for step in steps], float),
        beta_deg=np.array([step.beta_deg for step in steps], float),
        readings=np.array([plan.expected(k) for k in range(len(steps))]),
        sd=np.full((len(steps), 3), _LEAST_SD_G),
    )
    chain = default_chain(data)
    return problem_of(data, chain, priors=dict.fromkeys(chain.names, (0.0, _PRIOR_SD)))


def _estimated(problem, measured):
    import numpy as np

    from tumblecal.estimation import exact
    from tumblecal.noise.covariance import Covariance

    readings, sd = problem.readings.copy(), problem.sd.copy()
    for position, mean, deviation in measured:
        readings[position], sd[position] = mean, np.maximum(deviation, _LEAST_SD_G)
    others = set(range(len(readings))) - {position for position, *_ in measured}
    present = replace(problem, readings=readings).with_noise(Covariance.of_sd(sd), known=True)
    fit = exact.fit(present.without(tuple(others)))
    table = []
    for name, unit, value, deviation in zip(fit.names, fit.units, fit.values.tolist(), fit.sd.tolist(), strict=True):
        if deviation > _PRIOR_SD / 2:
            continue  # not determined yet
        factor, shown = _SHOWN.get(unit, (1.0, unit))
        table.append((name, value * factor, deviation * factor, shown))
    return table

"""The live estimate of `tumblecal capture`: the parameters and their standard uncertainties after each position."""

from functools import cache

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.capture.run.estimate_worker import Estimate


def live_estimate(plan: CapturePlan) -> Estimate:
    """The iterated Kalman filter over the exact chain; its modules are imported at the first accepted position."""
    problem = cache(lambda: _problem(plan))

    def estimate(rows):
        return _filtered(problem(), plan, rows) if len(rows) >= 3 else []

    return estimate


def _problem(plan):
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
        sd=np.full((len(steps), 3), 1e-4),
    )
    return problem_of(data, default_chain(data))


# Prior standard deviation of each parameter (1, g, rad), and the smallest standard deviation of a reading: the nominal
# model has unknown effects.
_PRIOR_SD, _LEAST_SD_G = 0.005, 1e-4
_SHOWN = {"1": (1e3, "1e-3"), "g": (1e3, "mg"), "rad": (1e3, "mrad")}


def _filtered(problem, plan, rows):
    import numpy as np

    from tumblecal.estimation.iterated import Filter
    from tumblecal.estimation.kalman import Prior

    positions = {(s.alpha_deg, s.beta_deg): k for k, s in enumerate(plan.steps)}
    running = Filter(problem, Prior(sd=_PRIOR_SD))
    for alpha, beta, mean, sd in rows:
        running.take(positions[alpha, beta], mean, np.maximum(sd, _LEAST_SD_G))
    deviations = np.sqrt(np.diag(running.covariance))
    table = []
    for name, unit, value, sd in zip(problem.chain.names, problem.chain.units, running.mean, deviations, strict=True):
        if sd > _PRIOR_SD / 2:
            continue  # not determined yet
        factor, shown = _SHOWN.get(unit, (1.0, unit))
        table.append((name, float(value) * factor, float(sd) * factor, shown))
    return table

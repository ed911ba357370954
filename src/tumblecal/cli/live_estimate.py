"""The live estimate of `tumblecal capture`: the exact fit of the positions so far, with a prior on all parameters."""

from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.capture.journal import Attempt, RunState
from tumblecal.capture.run.screen import Estimate
from tumblecal.cli.start import start
from tumblecal.ground.numbers_shown import rounded_together


# Prior standard deviation of each parameter (1, g, rad), and the smallest standard deviation of a reading: the nominal
# model has unknown effects.
_PRIOR_SD, _LEAST_SD_G = 0.005, 1e-4
_HEADS = {"1": "estimate / 1e-3:", "g": "estimate / mg:", "rad": "estimate / mrad:"}
_started = cache(start)


def live_estimate(plan: CapturePlan) -> Estimate:
    """The newest estimate, which a thread computes whenever the accepted positions have changed."""
    thread, soaks = ThreadPoolExecutor(1), plan.soaks
    measured, lines, running = [], [], thread.submit(list[str])

    def newest(state: RunState) -> list[str]:
        nonlocal measured, lines, running
        if running.done():
            # Positions of the last soak: the parameters differ between temperatures.
            lines, before, last = running.result(), measured, state.last_accepted
            measured = [done for k, done in state.accepted.items() if last and soaks[k] == soaks[last.position]]
            if measured != before:
                running = thread.submit(_lines, plan, measured)
        return lines

    return newest


def _lines(plan: CapturePlan, measured: list[Attempt]) -> list[str]:
    """The parameters that at least three positions determine, by unit."""
    if len(measured) < 3:
        return []
    try:
        fit, words = estimated(plan, measured), dict(_HEADS)
        for name, unit, value, u in zip(fit.names, fit.units, fit.values, fit.sd, strict=True):
            if u <= _PRIOR_SD / 2:
                words[unit] += f"  {name} {rounded_together(1e3 * value, 1e3 * u)}"
        return [line for unit, line in words.items() if line != _HEADS[unit]]
    except Exception as error:  # of any kind: the capture continues
        return [f"no estimate: {error!r}"]


def estimated(plan: CapturePlan, measured: list[Attempt]):
    """The fit of these positions; the others of the plan are in it, but excluded, so that all fits share one program."""
    _started()
    from tumblecal.data import PositionSet
    from tumblecal.estimation import default_chain, exact, problem_of

    readings, others = plan.directions.copy(), set(range(len(plan.soaks)))
    sd = np.zeros_like(readings)
    for attempt in measured:
        k, summary = attempt.position, attempt.summary
        readings[k], sd[k] = summary["mean_g"], np.divide(summary["sd_g"], summary["n"] ** 0.5)
        others.remove(k)
    names, alpha, beta = zip(*((step.name, step.alpha_deg, step.beta_deg) for step in plan.steps), strict=True)
    data = PositionSet(names, np.array(alpha), np.array(beta), readings, np.maximum(sd, _LEAST_SD_G))
    chain = default_chain(data)
    problem = problem_of(data, chain, priors=dict.fromkeys(chain.names, (0.0, _PRIOR_SD)))
    return exact.fit(problem.without(tuple(others)))

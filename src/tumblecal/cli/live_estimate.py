"""The live estimate of `tumblecal capture`: the exact fit of the positions so far, with a prior on all parameters."""

from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.capture.journal import Attempt, RunState
from tumblecal.cli.start import start
from tumblecal.ground.numbers_shown import rounded_together


# Prior standard deviation of each parameter (1, g, rad), and the smallest standard deviation of a reading: the nominal
# model has unknown effects.
_PRIOR_SD, _LEAST_SD_G = 0.005, 1e-4
_UNITS = {"1": "1e-3", "g": "mg", "rad": "mrad"}
_started = cache(start)


def estimated(plan: CapturePlan, measured: list[Attempt]) -> list[tuple[str, float, float, str]]:
    """Name, value, standard uncertainty and unit of the parameters that these positions determine; none for fewer than three."""
    if len(measured) < 3:
        return []
    _started()
    from tumblecal.data import PositionSet
    from tumblecal.estimation import default_chain, exact, problem_of

    # All positions of the plan, the others with their expected readings and excluded, so that all estimates share one program.
    names, angles_deg = zip(*((step.name, (step.alpha_deg, step.beta_deg)) for step in plan.steps), strict=True)
    readings = np.array([plan.expected(k) for k in range(len(names))])
    sd, others = np.full_like(readings, _LEAST_SD_G), set(range(len(names)))
    for attempt in measured:
        k, summary = attempt.position, attempt.summary
        readings[k], sd[k] = summary["mean_g"], np.divide(summary["sd_g"], summary["n"] ** 0.5)
        others.remove(k)
    data = PositionSet(names, *np.array(angles_deg, float).T, readings, np.maximum(sd, _LEAST_SD_G))
    chain = default_chain(data)
    problem = problem_of(data, chain, priors=dict.fromkeys(chain.names, (0.0, _PRIOR_SD)))
    fit = exact.fit(problem.without(tuple(others)))
    found = zip(fit.names, fit.values, fit.sd, fit.units, strict=True)
    return [(name, 1e3 * value, 1e3 * u, _UNITS[unit]) for name, value, u, unit in found if u <= _PRIOR_SD / 2]


class LiveEstimate:
    """The lines of the screen about the parameters so far; a thread computes, so that a call returns at once and never fails."""

    def __init__(self, plan: CapturePlan):
        self._plan, self._thread = plan, ThreadPoolExecutor(1)
        self._measured, self._lines, self._next = list[Attempt](), list[str](), self._thread.submit(list[str])

    def __call__(self, state: RunState) -> list[str]:
        """The last finished estimate; another begins if the accepted positions of the last soak have changed."""
        if self._next.done():
            self._lines = self._next.result()
            # The parameters differ between temperatures.
            soaks, last = self._plan.soaks, state.last_accepted
            measured = [done for k, done in state.accepted.items() if last and soaks[k] == soaks[last.position]]
            if measured != self._measured:
                self._measured, self._next = measured, self._thread.submit(self._estimate, measured)
        return self._lines

    def _estimate(self, measured: list[Attempt]) -> list[str]:
        try:
            rows = estimated(self._plan, measured)
        except Exception as error:  # of any kind: the capture continues
            return [f"no estimate: {type(error).__name__}: {error}".split("\n")[0]]
        title = f"estimate of {len(measured)} positions, with standard uncertainties:"
        return [title, *(f"{name} {rounded_together(value, u)} {unit}" for name, value, u, unit in rows)] if rows else []

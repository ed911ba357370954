"""All estimators on one position set: what `tumblecal calibrate` runs."""

from collections.abc import Mapping
from dataclasses import dataclass

from tumblecal.chain import Chain
from tumblecal.data import PositionSet
from tumblecal.errors import InputError
from tumblecal.estimation import exact, harmonic, iterated, kalman
from tumblecal.estimation.kalman import Prior
from tumblecal.estimation.problem import Problem, problem_of
from tumblecal.estimation.result import Result


@dataclass(frozen=True)
class Calibrated:
    """Results by method (`exact` first), and the methods that do not apply with the reason."""

    results: dict[str, Result]
    skipped: dict[str, str]
    problem: Problem

    @property
    def exact(self) -> Result:
        """The exact fit."""
        return self.results["exact"]


def all_methods(
    data: PositionSet,
    chain: Chain | None = None,
    *,
    noise_sd: float | None = None,
    priors: Mapping[str, tuple[float, float]] | None = None,
    kalman_prior: Prior | None = None,
) -> Calibrated:
    """Exact fit, harmonic least squares, Kalman filter and iterated Kalman filter of one position set.

    The filters need the noise: stated, or else as the exact fit found it.

    **Arguments:**

    - `data`, `chain`, `noise_sd`, `priors`: as for `problem_of`.
    - `kalman_prior`: what both filters start from.

    **Raises:** `InputError` when the design cannot determine the chain's parameters.
    """
    problem = problem_of(data, chain, noise_sd=noise_sd, priors=priors)
    fitted = exact.fit(problem, data)
    results, skipped = {"exact": fitted}, {}
    sigma = noise_sd or fitted.sigma
    if not sigma > 0 and data.sd is None:
        reason = "as many readings as parameters: nothing is left to estimate the noise from; give --noise-sd"
        skipped |= {"kalman": reason, "iterated": reason}
    try:
        results["harmonic"] = harmonic.fit(data, noise_sd=noise_sd, names=fitted.names)
        if "kalman" not in skipped:
            results["kalman"] = kalman.fit(data, sigma=sigma, prior=kalman_prior, names=fitted.names)
    except InputError as error:
        skipped |= dict.fromkeys(("harmonic", "kalman"), str(error))
    if "iterated" not in skipped:
        results["iterated"] = iterated.fit(problem.independent, data, sigma=sigma, prior=kalman_prior)
    order = ("exact", "harmonic", "kalman", "iterated")
    return Calibrated({name: results[name] for name in order if name in results}, skipped, problem)

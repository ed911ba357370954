"""All estimators on one problem: what `tumblecal calibrate` runs."""

from collections.abc import Mapping
from dataclasses import dataclass

from tumblecal.estimation import exact, harmonic, iterated, kalman
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.kalman import Prior
from tumblecal.estimation.mixups import MixUp
from tumblecal.estimation.plausibility import Implausible, implausible
from tumblecal.estimation.problem import Problem
from tumblecal.estimation.scatter_floor import ScatterFloor, scatter_floor
from tumblecal.ground.errors import InputError


@dataclass(frozen=True)
class Calibrated:
    """Fits by method (`exact` first), and the methods that do not apply with the reason.

    `implausible`: parameters of the exact fit that no instrument has. `mix_ups`: what was put right before. `floor`: what
    the positions scatter beside their sd columns, where they do.
    """

    fits: dict[str, Fit]
    skipped: dict[str, str]
    implausible: tuple[Implausible, ...] = ()
    mix_ups: tuple[MixUp, ...] = ()
    floor: ScatterFloor | None = None

    @property
    def exact(self) -> Fit:
        """The exact fit."""
        return self.fits["exact"]


def all_methods(
    problem: Problem,
    *,
    kalman_prior: Prior | None = None,
    usual: Mapping[str, float] | None = None,
    by_columns: bool = False,
) -> Calibrated:
    """Exact fit, harmonic least squares, Kalman filter and iterated Kalman filter of one problem.

    The filters need the noise: stated, or else as the exact fit finds it.

    **Arguments:**

    - `problem`: from `problem_of`.
    - `kalman_prior`: what both filters start from. `usual`: as of `plausibility.implausible`.
    - `by_columns`: whether the noise is that of sd columns, a lower bound: a floor may be added to it.

    **Raises:** `InputError` when the design cannot determine the chain's parameters.
    """
    fitted = exact.fit(problem)
    floor = scatter_floor(fitted) if by_columns else None
    if floor is not None:
        problem = floor.applied(problem)
        fitted = exact.fit(problem)
    fits, skipped = {"exact": fitted}, {}
    if not problem.known and not fitted.sigma > 0:
        reason = "as many readings as parameters: nothing is left to estimate the noise from; give --noise-sd"
        skipped |= {"kalman": reason, "iterated": reason}
    try:
        fits["harmonic"] = harmonic.fit(problem.independent)
        if "kalman" not in skipped:
            fits["kalman"] = kalman.fit(problem.independent, sigma=fitted.sigma, prior=kalman_prior)
    except InputError as error:
        skipped |= dict.fromkeys(("harmonic", "kalman"), str(error))
    if "iterated" not in skipped:
        fits["iterated"] = iterated.fit(problem.independent, sigma=fitted.sigma, prior=kalman_prior)
    order = ("exact", "harmonic", "kalman", "iterated")
    fits = {name: fits[name] for name in order if name in fits}
    return Calibrated(fits, skipped, implausible(fitted, usual), floor=floor)

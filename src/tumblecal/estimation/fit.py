"""The result of an estimator: named values with their covariance, residuals, and convergence."""

import enum
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import gammaincc, stdtrit

from tumblecal.chain import Chain
from tumblecal.chain.where import register_unchecked
from tumblecal.data import PositionSet
from tumblecal.estimation.identifiability import Identifiability
from tumblecal.estimation.problem import Problem
from tumblecal.ground.pickled import Pickled
from tumblecal.ground.showing import Screen, Shown, function_named
from tumblecal.ground.units import shown
from tumblecal.words import sentence


if TYPE_CHECKING:
    import polars as pl
    from matplotlib.figure import Figure


# Residuals below this, g, are rounding of float64, not noise of a measurement.
_ROUNDING_G = 1e-12


class Code(enum.Enum):
    """How an estimation ended; the value is the message.

    Examples:
        >>> from tumblecal.estimation import Code
        >>> Code.CONVERGED.good, Code.NON_FINITE.value
        (True, 'not converged: the residuals became infinite or not a number')
    """

    CONVERGED = "converged"
    CONVERGED_BY_FALLBACK = "Gauss-Newton failed; Levenberg-Marquardt converged"
    CONVERGED_FROM_CLOSED_FORM = "failed from the nominal start; converged from the closed-form start"
    LINEAR = "linear: solved in one step"
    NOT_CONVERGED = "not converged: the last step was still larger than 1e-4 of the standard uncertainties"
    NON_FINITE = "not converged: the residuals became infinite or not a number"

    @property
    def good(self) -> bool:
        """Whether the estimate may be used."""
        return self not in (Code.NOT_CONVERGED, Code.NON_FINITE)


@dataclass(frozen=True)
class History:
    """Estimates after each step of a recursive estimator: values, standard deviations, and the innovations' NIS.

    `nis` is the normalised innovation squared of each step, chi-square distributed with `nis_dof` when the filter is
    consistent (Bar-Shalom, Li and Kirubarajan 2001, section 5.4).
    """

    values: Float[np.ndarray, "steps free"]
    sd: Float[np.ndarray, "steps free"]
    nis: Float[np.ndarray, " steps"]
    nis_dof: int


@dataclass(frozen=True, repr=False)
class Fit(Pickled, Shown):
    """An estimate.

    - `problem`: the fitted problem.
    - `values`, `covariance`: in base units (rad, g, 1), in the order of `names`.
    - `residuals`: measured minus predicted, g. `chi2`: the sum of their squares made white, `dof` its degrees of freedom.
    - `rows`, `jacobian`: white residual and its derivative by the scaled parameters (zero for excluded positions),
      for fits of the chain; otherwise empty. `vector`: the point of evaluation, in the coordinates of the estimator.
    - `code`: convergence. `history`: of a recursive estimator.
    - `unidentifiable` (free, directions): shifts of the values by one standard deviation each, along directions that the
      data do not determine and for which a distribution is assumed; empty if there are none. The covariance includes them.

    Examples:
        >>> import tumblecal
        >>> data = tumblecal.simulate(tumblecal.read_rig("paper24"), seed=1)
        >>> fit = tumblecal.calibrate(data, noise_sd=0.15e-3).exact
        >>> fit.covariance.shape, fit.residuals.shape, fit.dof, fit.message
        ((15, 15), (24, 3), 57, 'converged')
        >>> low, high = fit.interval(0.95)[fit.names.index("bias_z")]
        >>> bool(low < 0.8e-3 < high)  # the true bias of the simulation, g
        True
    """

    method: str
    problem: Problem
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Float[np.ndarray, " free"]
    covariance: Float[np.ndarray, "free free"]
    residuals: Float[np.ndarray, "positions 3"]
    chi2: float
    dof: int
    code: Code
    rows: Float[np.ndarray, " rows"] = field(default_factory=lambda: np.zeros(0))
    jacobian: Float[np.ndarray, "rows parameters"] = field(default_factory=lambda: np.zeros((0, 0)))
    vector: Float[np.ndarray, " full"] = field(default_factory=lambda: np.zeros(0))
    statistics: dict[str, float] = field(default_factory=dict)
    identifiability: Identifiability | None = None
    history: History | None = None
    unidentifiable: Float[np.ndarray, "_ directions"] = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def no_freedom_words(self) -> str:
        """Why residuals without degrees of freedom contain no information."""
        return sentence("noise/no_freedom", n=self)

    @property
    def data(self) -> PositionSet:
        """The position set."""
        return self.problem.measured_data

    @cached_property
    def chain(self) -> Chain:
        """The chain with its fitted values."""
        return self.problem.chain.named(dict(zip(self.names, self.values.tolist(), strict=True)))

    @property
    def stated_values(self) -> dict[str, float]:
        """Values of all parameters of the chain by name, fixed ones included, and those fitted without a chain."""
        leaves = self.problem.chain.parameters
        fixed = {
            name: float(value) for leaf in leaves for name, value in zip(leaf.names, leaf.value.ravel(), strict=True)
        }
        return fixed | dict(zip(self.names, self.values.tolist(), strict=True))

    @property
    def retained(self) -> Bool[np.ndarray, " positions"]:
        """Mask of the positions in the fit."""
        return self.problem.takes_part

    @property
    def noise(self) -> str:
        """`"stated"`, or `"estimated"`: intervals then use Student's t with `dof`."""
        return "stated" if self.problem.known else "estimated"

    @property
    def stated_chi2(self) -> float | None:
        """Chi-square of the readings; None if the noise is estimated from them."""
        return self.chi2 if self.noise == "stated" else None

    @property
    def level(self) -> float:
        """Standard deviation of the white rows; its expectation is 1 if the stated noise is correct."""
        return float(np.sqrt(self.chi2 / self.dof)) if self.dof > 0 else float("nan")

    @property
    def sigma(self) -> float:
        """Standard deviation of the residuals, g; the priors have a part of the degrees of freedom."""
        dof, count = self.dof, self.problem.readings.size
        if self.problem.with_prior and self.jacobian.size:
            dof = 3 * int(np.sum(self.retained)) - float(np.sum(self.column_space[:count] ** 2))
        return float(np.sqrt(np.sum(self.residuals[self.retained] ** 2) / dof)) if self.dof > 0 else float("nan")

    @property
    def used(self) -> Bool[np.ndarray, " columns"]:
        """Mask of the columns of the Jacobian on which the fit depends: not, for example, the tilts of an excluded position."""
        return np.any(self.jacobian, axis=0)

    @property
    def parameters(self) -> int:
        """Number of fitted parameters, those without a name (generic terms) included."""
        return int(np.sum(self.used)) or len(self.names)

    @cached_property
    def column_space(self) -> Float[np.ndarray, "rows parameters"]:
        """Orthonormal basis of the column space of the Jacobian."""
        return np.linalg.qr(self.jacobian[:, self.used])[0]

    @property
    def rms(self) -> float:
        """Root mean square of the residuals of the positions in the fit, g."""
        return float(np.sqrt(np.mean(self.residuals[self.retained] ** 2)))

    @property
    def computed(self) -> bool:
        """Whether the readings follow the model to rounding: they were computed, not measured."""
        return self.dof > 0 and self.rms < _ROUNDING_G

    @property
    def sd(self) -> Float[np.ndarray, " free"]:
        """Standard deviations of the values."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def noise_covariance(self) -> Float[np.ndarray, "free free"]:
        """Covariance from the noise alone, without the unidentifiable directions."""
        return (
            self.covariance - self.unidentifiable @ self.unidentifiable.T
            if self.unidentifiable.size
            else self.covariance
        )

    @property
    def undetermined(self) -> tuple[str, ...]:
        """The parameters whose variance is mostly assumed, not determined by the data."""
        if not self.unidentifiable.size:
            return ()
        assumed = np.sum(self.unidentifiable**2, axis=1)
        listed = zip(self.names, assumed > 0.5 * np.diag(self.covariance), strict=True)
        return tuple([name for name, more in listed if more])

    @property
    def shared(self) -> list[int]:
        """Indices of the parameters that do not belong to a single position."""
        single = self.chain.of_positions
        return [k for k, name in enumerate(self.names) if name not in single]

    @property
    def correlation(self) -> Float[np.ndarray, "free free"]:
        """Correlation matrix of the values."""
        return self.covariance / np.outer(self.sd, self.sd)

    @property
    def message(self) -> str:
        """Convergence in words."""
        constants = [name for name, unit in zip(self.names, self.units, strict=True) if unit == "s"]
        if self.code.good or not constants:
            return self.code.value
        return (
            f"{self.code.value}. The data may not determine {', '.join(constants)}: the change may be linear in time; if so, "
            "replace the effect by bias_drift"
        )

    def value(self, name: str) -> float:
        """One value by its name.

        **Raises:** `KeyError` with the available parameters.
        """
        if name not in self.names:
            raise KeyError(f"no parameter {name!r}; there are {', '.join(self.names)}")
        return float(self.values[self.names.index(name)])

    def coverage_factor(self, level: float = 0.95) -> float:
        """Expanded over standard uncertainty: normal distribution for stated noise, Student's t for estimated noise.

        **Raises:** `ValueError` for a level that is not between 0 and 1.
        """
        if not 0 < level < 1:
            raise ValueError(f"level {level:g}: must be between 0 and 1, such as 0.95")
        dof = self.dof if self.noise == "estimated" else np.inf
        return float(stdtrit(min(dof, 1e9), 0.5 + level / 2))

    def interval(self, level: float = 0.95) -> Float[np.ndarray, "free 2"]:
        """Confidence intervals of all values, by the coverage factor.

        **Raises:** `ValueError` for a level that is not between 0 and 1.
        """
        half = self.coverage_factor(level) * self.sd
        return np.stack([self.values - half, self.values + half], axis=-1)

    @property
    def chi2_p_value(self) -> float | None:
        """Probability of a chi2 at least this large under the stated noise; None if the noise was estimated."""
        return float(gammaincc(self.dof / 2, self.chi2 / 2)) if self.noise == "stated" and self.dof > 0 else None

    def table(self) -> "pl.DataFrame":
        """All parameters as printed: `parameter`, `value`, `sd` and their `unit` (1e-3, mg, mrad)."""
        import polars as pl

        return pl.DataFrame(self._listed(), schema=["parameter", "value", "sd", "unit"], orient="row")

    def plot_residuals(self) -> "Figure":
        """Residuals against the spindle angle: one row for each axis, one column for each pitch setting."""
        return function_named("show.figures.calibration.residuals_figure")(self)

    def save(self, path: Path | str) -> None:
        """Write `calibration.json`, which `tumblecal.load` and `tumblecal apply` read.

        **Raises:** `InputError` for a fit that did not converge, or that does not estimate one sensor for all data.
        """
        function_named("lab.record.save_fit")(Path(path), self)

    def screen(self) -> Screen:
        """Parameters and quality of the fit."""
        rows = [
            (name, f"{value:.4f}", f"{sd:.4f}" if np.isfinite(sd) else "?", unit)
            for name, value, sd, unit in self._listed()
        ]
        quality = f"residuals {1e3 * self.rms:.4g} mg rms, {self.dof} degrees of freedom, noise {self.noise}"
        return Screen(
            f"{self.method} fit of {self.data.source}: {self.message}",
            ("parameter", "value", "sd", "unit"),
            rows,
            [quality],
        )

    def _listed(self) -> list[tuple[str, float, float, str]]:
        display = [shown(unit) for unit in self.units]
        return [
            (name, float(value) * factor, float(sd) * factor, unit)
            for name, value, sd, (unit, factor) in zip(self.names, self.values, self.sd, display, strict=True)
        ]


register_unchecked(
    Fit,
    ("problem", "values", "covariance", "residuals", "chi2", "rows", "jacobian", "vector", "unidentifiable"),
    ("method", "names", "units", "dof", "code"),
    carried=("statistics", "identifiability", "history"),
)

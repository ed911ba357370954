"""What every estimator returns: named values with their covariance, residuals, and how it went."""

import enum
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float
from scipy.special import gammaincc, stdtrit

from tumblecal.chain import Chain
from tumblecal.data import PositionSet
from tumblecal.estimation.identifiability import Identifiability


class Code(enum.Enum):
    """How an estimation ended; the value is the message."""

    CONVERGED = "converged"
    CONVERGED_BY_FALLBACK = "Gauss-Newton failed; Levenberg-Marquardt converged"
    CONVERGED_FROM_CLOSED_FORM = "failed from the nominal start; converged from the closed-form start"
    LINEAR = "linear: solved in one step"
    NOT_CONVERGED = "not converged: the last step was still larger than 1e-6 of the standard deviations"
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


@dataclass(frozen=True)
class Result:
    """An estimate.

    `values` and `covariance` are in base units (rad, g, 1), in the order of `names`. `residuals` are measured minus
    predicted, g. `sigma` is the residuals' standard deviation, g; `chi2` the weighted sum of squares, meaningful as
    such where the noise is `"stated"`. With `"estimated"` noise intervals use Student's t with `dof`.
    """

    method: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Float[np.ndarray, " free"]
    covariance: Float[np.ndarray, "free free"]
    residuals: Float[np.ndarray, "positions 3"]
    sigma: float
    dof: int
    chi2: float
    noise: str
    code: Code
    data: PositionSet
    chain: Chain | None = None
    statistics: dict[str, float] = field(default_factory=dict)
    identifiability: Identifiability | None = None
    history: History | None = None

    @property
    def sd(self) -> Float[np.ndarray, " free"]:
        """Standard deviations of the values."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> Float[np.ndarray, "free free"]:
        """Correlation matrix of the values."""
        return self.covariance / np.outer(self.sd, self.sd)

    @property
    def message(self) -> str:
        """How it went, in words."""
        return self.code.value

    def value(self, name: str) -> float:
        """One value by its name.

        **Raises:** `KeyError` naming the parameters there are.
        """
        if name not in self.names:
            raise KeyError(f"no parameter {name!r}; there are {', '.join(self.names)}")
        return float(self.values[self.names.index(name)])

    def interval(self, level: float = 0.95) -> Float[np.ndarray, "free 2"]:
        """Confidence intervals of all values: normal for stated noise, Student's t for estimated noise."""
        dof = self.dof if self.noise == "estimated" else np.inf
        half = stdtrit(min(dof, 1e9), 0.5 + level / 2) * self.sd
        return np.stack([self.values - half, self.values + half], axis=-1)

    @property
    def chi2_p_value(self) -> float | None:
        """Probability of a chi2 this large under the stated noise; None where the noise was estimated."""
        return float(gammaincc(self.dof / 2, self.chi2 / 2)) if self.noise == "stated" and self.dof > 0 else None

"""Criteria of a plan: numbers that are to be small, like standard deviations, from the covariance of the shared parameters.

Parameters are in thousandths of their base unit (mg, mrad, 1e-3), forces in mg. The logarithm of every criterion is convex in
the information of a plan, as bounds of it need; so is that of a sum of criteria (Boyd and Vandenberghe 2004, section 3.5).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np
from jaxtyping import Float

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.design.model.cells import Cells
from tumblecal.design.model.one_visit import OneVisit, one_visit
from tumblecal.design.model.responses import Responses
from tumblecal.ground.errors import InputError


SENSOR = ("dK", "bias", "gamma")


class OfRows(Protocol):
    """A number, to be small, of the covariance of some functionals of the shared parameters."""

    @property
    def rows(self) -> Float[np.ndarray, "k shared"]:
        """Functionals of the shared parameters."""
        ...

    def changed(
        self, covariance: Float[np.ndarray, "k k"], parts: Float[np.ndarray, "3 k cells"], sign: int
    ) -> Float[np.ndarray, " cells"]:
        """Values after the change of the covariance by `sign` times the sum of the outer products of the parts."""
        ...

    def of_rows(self, covariance: Float[np.ndarray, "*n k k"]) -> Float[np.ndarray, "*n"]:
        """The value for a covariance of the functionals, or for each of several."""
        ...


class CriterionOfCovariance(OfRows, Protocol):
    """A criterion with bounds."""

    @property
    def name(self) -> str:
        """What it is called."""
        ...

    def smooth(self, power: float) -> "CriterionOfCovariance":
        """The same with a power mean of variances in place of the largest one."""
        ...

    def support(self, covariance: Float[np.ndarray, "k k"]) -> tuple[float, Float[np.ndarray, "k r"]]:
        """The value at a covariance of a function that is nowhere above the criterion and whose logarithm is convex in the
        information, and R: the derivative of that logarithm by the covariance is R R'."""
        ...

    def curvature(
        self, covariance: Float[np.ndarray, "k k"], first: Float[np.ndarray, "p k"], then: Float[np.ndarray, "n p k"]
    ) -> Float[np.ndarray, "n n"]:
        """Second derivatives of the logarithm by the covariance, along its changes first' then."""
        ...


@dataclass(frozen=True)
class Criterion:
    """One criterion.

    - `functionals` (k, shared): rows on the scaled shared parameters, each in mg, mrad or 1e-3.
    - `combine`: "largest" standard deviation of a functional, root "mean" square of these, or "volume": the 2k-th root of the
      determinant of their covariance (D). `power`: a power mean of the variances takes the place of the largest one.
    - `ignored`: parameters that no plan determines and that the criterion leaves out.
    """

    name: str
    functionals: Float[np.ndarray, "k shared"]
    combine: Literal["largest", "mean", "volume"]
    power: float | None = None
    ignored: tuple[str, ...] = ()

    @property
    def rows(self) -> Float[np.ndarray, "k shared"]:
        """The functionals."""
        return self.functionals

    def of(self, covariance: Float[np.ndarray, "*n shared shared"]) -> Float[np.ndarray, "*n"]:
        """The value for a covariance of the scaled shared parameters, or for each of several."""
        return self.of_rows(self.functionals @ covariance @ self.functionals.T)

    def of_rows(self, covariance: Float[np.ndarray, "*n k k"]) -> Float[np.ndarray, "*n"]:
        """The value for a covariance of the functionals, or for each of several."""
        if self.combine == "volume":
            return np.exp(np.linalg.slogdet(covariance)[1] / (2 * len(self.functionals)))
        return self._of_variances(np.diagonal(covariance, axis1=-2, axis2=-1))

    def _of_variances(self, variances: Float[np.ndarray, "*n k"]) -> Float[np.ndarray, "*n"]:
        if self.combine == "mean":
            return np.sqrt(np.mean(variances, axis=-1))
        largest = np.max(variances, axis=-1)
        if self.power is None:
            return np.sqrt(largest)
        share = np.mean((variances / largest[..., None]) ** self.power, axis=-1)
        return np.sqrt(largest) * share ** (0.5 / self.power)

    def smooth(self, power: float) -> "Criterion":
        """This criterion with a power mean of the variances in place of the largest one."""
        return replace(self, power=power) if self.combine == "largest" else self

    def changed(
        self, covariance: Float[np.ndarray, "k k"], parts: Float[np.ndarray, "3 k cells"], sign: int
    ) -> Float[np.ndarray, " cells"]:
        """Values after the change of the covariance by `sign` times the sum of the outer products of the parts."""
        if self.combine == "volume":
            k = len(covariance)
            log = np.linalg.slogdet(covariance)[1]
            inner = np.einsum("ikc,kl,jlc->cij", parts, np.linalg.inv(covariance), parts, optimize=True)
            return np.exp((log + np.log(np.maximum(np.linalg.det(np.eye(3) + sign * inner), 1e-300))) / (2 * k))
        variances = np.diag(covariance)[:, None] + sign * (parts[0] ** 2 + parts[1] ** 2 + parts[2] ** 2)
        return self._of_variances(variances.T)

    def support(self, covariance: Float[np.ndarray, "k k"]) -> tuple[float, Float[np.ndarray, "k r"]]:
        """The value of a log-convex function that is nowhere above the criterion, and R: the derivative of its logarithm by the
        covariance is R R'. For the largest of several functionals: their mean with fixed weights."""
        k = len(covariance)
        if self.combine == "volume":
            return float(self.of_rows(covariance)), np.linalg.inv(np.linalg.cholesky(covariance)).T / np.sqrt(2 * k)
        variances = np.diag(covariance)
        weights = self._weights(variances)
        total = float(weights @ variances)
        return np.sqrt(total / weights.sum()), np.diag(np.sqrt(weights / (2 * total)))

    def _weights(self, variances: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Proportional to the derivative by each variance."""
        if self.combine == "mean":
            return np.ones(len(variances))
        share = variances / variances.max()
        return share ** (self.power - 1) if self.power else (share == 1.0) * 1.0

    def curvature(
        self, covariance: Float[np.ndarray, "k k"], first: Float[np.ndarray, "p k"], then: Float[np.ndarray, "n p k"]
    ) -> Float[np.ndarray, "n n"]:
        """Second derivatives of the logarithm by the covariance, along its changes first' then."""
        k = len(covariance)
        if self.combine == "volume":
            relative = np.linalg.inv(covariance) @ np.einsum("pk,npl->nkl", first, then, optimize=True)
            return -np.einsum("nab,mba->nm", relative, relative, optimize=True) / (2 * k)
        variances, power = np.diag(covariance), 1.0 if self.combine == "mean" else self.power or 1.0
        relative = np.einsum("pk,npk->nk", first, then) / variances
        share = self._weights(variances) * variances
        share = share / share.sum()
        slope = relative @ share
        return ((power - 1) * (relative * share) @ relative.T - power * np.outer(slope, slope)) / 2


def worst(responses: Responses, parameters: Sequence[str] | None = None) -> Criterion:
    """The largest standard uncertainty of some parameters, in mg, mrad or 1e-3 (default: bias, scale, non-orthogonality, and
    their coefficients of temperature: root mean square changes over the range).

    **Raises:** `InputError` for an unknown parameter, or if no plan determines any of them.
    """
    return _of_parameters("worst", "largest", responses, parameters)


def mean(responses: Responses, parameters: Sequence[str] | None = None) -> Criterion:
    """The root mean square of their standard uncertainties.

    **Raises:** as `worst`.
    """
    return _of_parameters("mean", "mean", responses, parameters)


def volume(responses: Responses, parameters: Sequence[str] | None = None) -> Criterion:
    """The geometric mean of the half-axes of their uncertainty ellipsoid (D).

    **Raises:** as `worst`.
    """
    return _of_parameters("volume", "volume", responses, parameters)


def in_use(use: Responses, kind: Literal["average", "largest"] = "average") -> Criterion:
    """Standard uncertainty of an axis of the corrected force over the attitudes and temperatures of use, mg: root mean square
    (I) or largest (G). Directions of the parameters that no plan determines are left out.

    **Arguments:** `use`: responses of the rig at `attitudes_in_use`, not at the candidates.
    """
    rows = 1e3 * use.columns.reshape(-1, len(use.names))
    if kind == "average":
        values, vectors = np.linalg.eigh(rows.T @ rows / len(rows))
        live = values > 1e-12 * values[-1]
        rows = np.sqrt(values[live] * np.sum(live))[:, None] * vectors[:, live].T
    return Criterion(f"in use, {kind}", rows, "mean" if kind == "average" else "largest")


def attitudes_in_use(ability: HeadAbility, temperatures_degc: Sequence[float] = ()) -> Cells:
    """Attitudes distributed over the sphere (rings of 30 deg), at each temperature of use (default: those of the chamber)."""
    degc = tuple(temperatures_degc) or ability.temperatures_degc
    rings = [(-90.0, 1), (-60.0, 6), (-30.0, 10), (0.0, 12), (30.0, 10), (60.0, 6), (90.0, 1)]
    attitudes = [(360.0 * k / count, beta, t) for t in degc or (0.0,) for beta, count in rings for k in range(count)]
    alpha, beta, temperature = (np.array(column) for column in zip(*attitudes, strict=True))
    return Cells(alpha, beta, (ability.mounts[0],) * len(alpha), temperature if degc else None)


def determined(criterion: Criterion, model: OneVisit) -> Criterion:
    """The criterion without the directions that no plan determines: single parameters are left out, others are projected.

    **Raises:** `InputError` if nothing remains.
    """
    covariance = model.covariance(np.arange(len(model.columns)))
    size = np.sqrt(model.free)
    hidden = model.free_directions(covariance)
    if not hidden.shape[1]:
        return criterion
    scaled = criterion.functionals * size
    rest = scaled - (scaled @ hidden) @ hidden.T
    seen = np.linalg.norm(rest, axis=1) > 0.99 * np.linalg.norm(scaled, axis=1)
    names = model.undetermined()
    if not np.any(seen):
        raise InputError(f"no plan on this head determines {', '.join(names)}; allow another mounting or state a prior")
    kept = rest[seen] / size
    return replace(criterion, functionals=kept, ignored=names)


def _of_parameters(
    name: str,
    combine: Literal["largest", "mean", "volume"],
    responses: Responses,
    parameters: Sequence[str] | None,
) -> Criterion:
    if parameters is None:
        parameters = [one for one in responses.names if one.split("_")[0] in SENSOR]
    at = responses.indices(parameters)
    rows = np.zeros((len(at), len(responses.names)))
    rows[np.arange(len(at)), at] = 1e3 * responses.scales[at]
    return determined(Criterion(name, rows, combine), one_visit(responses))

"""Criteria of a plan: numbers that are to be small, like standard deviations, from the covariance of the shared parameters.

Parameters are in thousandths of their base unit (mg, mrad, 1e-3), forces in mg. The logarithm of every criterion is convex in
the information of a plan, as bounds of it need; so is that of a sum of criteria (Boyd and Vandenberghe 2004, section 3.5).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.ground.errors import InputError
from tumblecal.plan.cells import Cells
from tumblecal.plan.linear_model import LinearModel, one_visit
from tumblecal.plan.responses import Responses


SENSOR = ("dK", "bias", "gamma")
Combine = Literal["largest", "mean", "volume", "alias"]


class Part(NamedTuple):
    """One number of some functionals of the shared parameters.

    - `rows` (k, shared): functionals of the scaled shared parameters, each in mg, mrad or 1e-3.
    - `combine`: "largest" standard deviation of a functional, root "mean" square of these, "volume": the 2k-th root of the
      determinant of their covariance (D), or "alias": the largest part of a functional that the last one, an effect of one
      standard deviation, adds.
    """

    rows: Float[np.ndarray, "k shared"]
    combine: Combine
    weight: float = 1.0


@dataclass(frozen=True)
class Criterion:
    """A weighted sum of numbers. `power`: a power mean of the variances takes the place of the largest one. `ignored`:
    parameters that no plan determines and that the criterion leaves out."""

    name: str
    parts: tuple[Part, ...]
    power: float | None = None
    ignored: tuple[str, ...] = ()

    @property
    def rows(self) -> Float[np.ndarray, "k shared"]:
        """The functionals of all parts."""
        return np.concatenate([part.rows for part in self.parts])

    def smooth(self, power: float) -> "Criterion":
        """This criterion with a power mean of the variances in place of the largest one."""
        return replace(self, power=power)

    def of(self, covariance: Float[np.ndarray, "*n shared shared"]) -> Float[np.ndarray, "*n"]:
        """The value for a covariance of the scaled shared parameters, or for each of several."""
        total = np.zeros(covariance.shape[:-2])
        for rows, combine, weight in self.parts:
            if combine == "volume":
                total += weight * np.exp(np.linalg.slogdet(rows @ covariance @ rows.T)[1] / (2 * len(rows)))
            else:
                across = rows @ covariance
                variances = np.vecdot(across, rows)
                last = np.vecdot(across, rows[-1]) if combine == "alias" else variances
                total += weight * self._combined(combine, variances, last)
        return total

    def _combined(
        self, combine: Combine, variances: Float[np.ndarray, "*n k"], last: Float[np.ndarray, "*n k"]
    ) -> Float[np.ndarray, "*n"]:
        """A number from the variances of the functionals; "alias" from their covariances with the last one (`last`)."""
        if combine == "mean":
            return np.sqrt(np.mean(variances, axis=-1))
        if combine == "alias":
            return np.max(np.abs(last[..., :-1]), axis=-1) / np.sqrt(np.maximum(last[..., -1], 1e-300))
        largest = np.max(variances, axis=-1)
        if self.power is None:
            return np.sqrt(largest)
        return np.sqrt(largest) * np.mean((variances / largest[..., None]) ** self.power, axis=-1) ** (0.5 / self.power)

    def changed(
        self,
        covariance: Float[np.ndarray, "shared shared"],
        change: Float[np.ndarray, "positions 3 shared"],
        sign: int,
    ) -> Float[np.ndarray, " positions"]:
        """Values for the covariance plus `sign` times the change of each position, the sum of three outer products."""
        total = np.zeros(len(change))
        for rows, combine, weight in self.parts:
            now, parts = rows @ covariance @ rows.T, change @ rows.T
            if combine == "volume":
                inner = np.eye(3) + sign * parts @ np.linalg.inv(now) @ parts.swapaxes(1, 2)
                log = np.linalg.slogdet(now)[1] + np.log(np.maximum(np.linalg.det(inner), 1e-300))
                total += weight * np.exp(log / (2 * len(rows)))
            else:
                variances = np.diag(now) + sign * np.sum(parts**2, axis=1)
                last = now[-1] + sign * np.sum(parts * parts[:, :, -1:], axis=1) if combine == "alias" else variances
                total += weight * self._combined(combine, variances, last)
        return total

    def support(self, covariance: Float[np.ndarray, "shared shared"]) -> tuple[float, Float[np.ndarray, "shared r"]]:
        """The value of a log-convex function that is nowhere above the criterion, and R: the derivative of its logarithm by the
        covariance is R R'. For the largest of several functionals: their mean with fixed weights."""
        values, roots = list[float](), list[np.ndarray]()
        for rows, combine, weight in self.parts:
            now, count = rows @ covariance @ rows.T, len(rows)
            if combine == "volume":
                values.append(weight * float(np.exp(np.linalg.slogdet(now)[1] / (2 * count))))
                roots.append(rows.T @ np.linalg.inv(np.linalg.cholesky(now)).T / np.sqrt(2 * count))
                continue
            variances = np.diag(now)
            share = np.ones(count)
            if combine == "largest":
                share = variances / variances.max()
                share = share ** (self.power - 1) if self.power else (share == 1.0) * 1.0
            total = float(share @ variances)
            values.append(weight * np.sqrt(total / share.sum()))
            roots.append(rows.T * np.sqrt(share / (2 * total)))
        value = sum(values)
        return value, np.concatenate([np.sqrt(v / value) * root for v, root in zip(values, roots, strict=True)], axis=1)


def of_parameters(combine: Combine, responses: Responses, parameters: Sequence[str] | None = None) -> Criterion:
    """A number of the standard uncertainties of some parameters, in mg, mrad or 1e-3 (default: bias, scale, non-orthogonality,
    and their coefficients of temperature: root mean square changes over the range).

    **Raises:** `InputError` for an unknown parameter, or if no plan determines any of them.
    """
    if parameters is None:
        parameters = [one for one in responses.names if one.split("_")[0] in SENSOR]
    rows = np.eye(len(responses.names))[responses.indices(parameters)] * 1e3 * responses.scales
    return determined(
        Criterion({"largest": "worst"}.get(combine, combine), (Part(rows, combine),)), one_visit(responses)
    )


def in_use(use: Responses, combine: Literal["mean", "largest"] = "mean") -> Criterion:
    """Standard uncertainty of an axis of the corrected force over the attitudes and temperatures of use, mg: root mean square
    (I) or largest (G). Directions of the parameters that no plan determines are left out.

    **Arguments:** `use`: responses of the rig at `attitudes_in_use`, not at the candidates.
    """
    rows = 1e3 * use.columns.reshape(-1, len(use.names))
    if combine == "mean":
        values, vectors = np.linalg.eigh(rows.T @ rows / len(rows))
        live = values > 1e-12 * values[-1]
        rows = np.sqrt(values[live] * np.sum(live))[:, None] * vectors[:, live].T
    return Criterion(f"in use, {'average' if combine == 'mean' else combine}", (Part(rows, combine),))


def weighted(criteria: Sequence[Criterion], weights: Sequence[float]) -> Criterion:
    """The weighted sum of several criteria."""
    parts = [
        part._replace(weight=weight * part.weight)
        for criterion, weight in zip(criteria, weights, strict=True)
        for part in criterion.parts
    ]
    return Criterion("weighted", tuple(parts))


def attitudes_in_use(ability: HeadAbility) -> Cells:
    """Attitudes distributed over the sphere (rings of 30 deg), at each temperature of the chamber."""
    degc = ability.temperatures_degc
    rings = [(-90.0, 1), (-60.0, 6), (-30.0, 10), (0.0, 12), (30.0, 10), (60.0, 6), (90.0, 1)]
    attitudes = [(360.0 * k / count, beta, t) for t in degc or (0.0,) for beta, count in rings for k in range(count)]
    alpha, beta, temperature = (np.array(column) for column in zip(*attitudes, strict=True))
    return Cells(alpha, beta, (ability.mounts[0],) * len(alpha), temperature if degc else None)


def determined(criterion: Criterion, model: LinearModel) -> Criterion:
    """The criterion without the directions that no plan determines: single parameters are left out, others are projected.

    **Raises:** `InputError` if nothing remains.
    """
    size, names = np.sqrt(model.free[: len(model.names)]), model.undetermined()
    hidden = model.free_directions(model.covariance(np.arange(len(model.columns))))
    if not hidden.shape[1]:
        return criterion
    (part,) = criterion.parts
    scaled = part.rows * size
    rest = scaled - (scaled @ hidden) @ hidden.T
    seen = np.linalg.norm(rest, axis=1) > 0.99 * np.linalg.norm(scaled, axis=1)
    if not np.any(seen):
        raise InputError(f"no plan on this head determines {', '.join(names)}; allow another mounting or state a prior")
    return replace(criterion, parts=(part._replace(rows=rest[seen] / size),), ignored=names)

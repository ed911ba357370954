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
from tumblecal.plan.information import LinearModel, one_visit
from tumblecal.plan.responses import Responses


SENSOR = ("dK", "bias", "gamma")
Combine = Literal["largest", "mean", "volume", "alias"]
# Power of the mean that takes the place of the largest variance in a support.
_POWER = 64.0


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


class Support(NamedTuple):
    """A tangent of the logarithm of a criterion, which is nowhere above it.

    - `smooth`: the criterion with a power mean in place of the largest variance. `value`: of the tangent, a mean of the
      variances with fixed weights. `root`: R; the derivative of its logarithm by the covariance is R R'.
    """

    smooth: float
    value: float
    root: Float[np.ndarray, "shared r"]


@dataclass(frozen=True)
class Criterion:
    """A weighted sum of numbers."""

    name: str
    parts: tuple[Part, ...]

    def of(self, covariance: Float[np.ndarray, "*n shared shared"]) -> Float[np.ndarray, "*n"]:
        """The value for a covariance of the scaled shared parameters, or for each of several."""
        total = np.zeros(covariance.shape[:-2])
        for rows, combine, weight in self.parts:
            across = rows @ covariance
            variances = np.vecdot(across, rows)
            if combine == "volume":
                number = np.exp(np.linalg.slogdet(across @ rows.T)[1] / (2 * len(rows)))
            elif combine == "alias":
                size = np.sqrt(np.maximum(variances[..., -1], 1e-300))
                number = np.max(np.abs(np.vecdot(across, rows[-1])[..., :-1]), axis=-1) / size
            else:
                number = np.sqrt(np.max(variances, axis=-1) if combine == "largest" else np.mean(variances, axis=-1))
            total += weight * number
        return total

    def support(self, covariance: Float[np.ndarray, "shared shared"]) -> Support:
        """The tangent at a covariance; not for "alias"."""
        smooth, values, roots = 0.0, list[float](), list[np.ndarray]()
        for rows, combine, weight in self.parts:
            now, count = rows @ covariance @ rows.T, len(rows)
            if combine == "volume":
                value = mean = float(np.exp(np.linalg.slogdet(now)[1] / (2 * count)))
                root = rows.T @ np.linalg.inv(np.linalg.cholesky(now)).T / np.sqrt(2 * count)
            else:
                power = _POWER if combine == "largest" else 1.0
                variances = np.diag(now)
                relative = variances / variances.max()
                share = relative ** (power - 1)
                total = share @ variances
                value, root = np.sqrt(total / share.sum()), rows.T * np.sqrt(share / (2 * total))
                mean = np.sqrt(variances.max()) * np.mean(relative**power) ** (0.5 / power)
            smooth += weight * mean
            values.append(weight * value)
            roots.append(root)
        whole = sum(values)
        shares = np.sqrt(np.array(values) / whole)
        return Support(smooth, whole, np.concatenate([s * root for s, root in zip(shares, roots, strict=True)], axis=1))


def of_parameters(combine: Combine, responses: Responses, parameters: Sequence[str] | None = None) -> Criterion:
    """A number of the standard uncertainties of some parameters, in mg, mrad or 1e-3 (default: bias, scale, non-orthogonality,
    and their coefficients of temperature: root mean square changes over the range).

    **Raises:** `InputError` if no plan determines any of them.
    """
    if parameters is None:
        parameters = [one for one in responses.names if one.split("_")[0] in SENSOR]
    rows = np.eye(len(responses.names))[np.isin(responses.names, parameters)] * 1e3 * responses.scales
    name = "worst" if combine == "largest" else combine
    return determined(Criterion(name, (Part(rows, combine),)), one_visit(responses))


def in_use(use: Responses, combine: Literal["mean", "largest"] = "mean") -> Criterion:
    """Standard uncertainty of an axis of the corrected force over the attitudes and temperatures of use, mg: root mean square
    (I) or largest (G). Directions of the parameters that no plan determines are left out.

    **Arguments:** `use`: responses of the rig at `attitudes_in_use`, not at the candidates.
    """
    rows = 1e3 * use.columns.reshape(-1, len(use.names))
    if combine == "mean":
        # As many rows as parameters, with the same mean square.
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
    rings = [(-90.0, 1), (-60.0, 6), (-30.0, 10), (0.0, 12), (30.0, 10), (60.0, 6), (90.0, 1)]
    rows = [(360.0 * k / count, beta, ability.mounts[0]) for beta, count in rings for k in range(count)]
    degc = ability.temperatures_degc
    return Cells.listed(rows * max(1, len(degc)), np.repeat(degc, len(rows)) if degc else None)


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
    return replace(criterion, parts=(part._replace(rows=rest[seen] / size),))

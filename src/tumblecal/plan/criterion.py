"""Criteria of a plan: numbers that are to be small, like standard deviations, from the covariance of the shared parameters.

Parameters are in thousandths of their base unit (mg, mrad, 1e-3), forces in mg. The logarithm of every criterion is convex in
the information of a plan, as bounds of it need; so is that of a sum of criteria (Boyd and Vandenberghe 2004, section 3.5).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.ground.errors import InputError
from tumblecal.plan.cells import Cells
from tumblecal.plan.information import Covariance, LinearModel, one_visit
from tumblecal.plan.responses import Responses


SENSOR = ("dK", "bias", "gamma")
Combine = Literal["largest", "mean", "volume", "alias"]
# Power of the mean that takes the place of the largest variance in a support.
_POWER = 64.0
# Rings of attitudes in use: pitch angle, deg, and number of attitudes.
_RINGS = ((-90.0, 1), (-60.0, 6), (-30.0, 10), (0.0, 12), (30.0, 10), (60.0, 6), (90.0, 1))


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

    def of(self, covariance: Covariance) -> Float[np.ndarray, "*n"]:
        """The number for a covariance, or for each of several."""
        across = self.rows @ covariance
        variances = np.vecdot(across, self.rows)
        match self.combine:
            case "volume":
                return np.exp(np.linalg.slogdet(across @ self.rows.T)[1] / (2 * len(self.rows)))
            case "alias":
                size = np.sqrt(np.maximum(variances[..., -1], 1e-300))
                return np.max(np.abs(np.vecdot(across, self.rows[-1])[..., :-1]), axis=-1) / size
            case "largest":
                return np.sqrt(np.max(variances, axis=-1))
        return np.sqrt(np.mean(variances, axis=-1))

    def support(self, covariance: Covariance) -> tuple[float, float, Float[np.ndarray, "shared r"]]:
        """The number with a power mean in place of the largest variance, its tangent at a covariance, and the root R of the
        derivative R R' of the tangent's logarithm by the covariance; not for "alias"."""
        now, count = self.rows @ covariance @ self.rows.T, len(self.rows)
        if self.combine == "volume":
            value = float(self.of(covariance))
            return value, value, self.rows.T @ np.linalg.inv(np.linalg.cholesky(now)).T / np.sqrt(2 * count)
        power, variances = _POWER if self.combine == "largest" else 1.0, np.diag(now)
        relative = variances / variances.max()
        share = relative ** (power - 1)
        total = share @ variances
        smooth = np.sqrt(variances.max()) * np.mean(relative**power) ** (0.5 / power)
        return smooth, float(np.sqrt(total / share.sum())), self.rows.T * np.sqrt(share / (2 * total))


@dataclass(frozen=True)
class Criterion:
    """A weighted sum of numbers."""

    name: str
    parts: tuple[Part, ...]

    def of(self, covariance: Covariance) -> Float[np.ndarray, "*n"]:
        """The value for a covariance of the scaled shared parameters, or for each of several."""
        return np.sum([part.weight * part.of(covariance) for part in self.parts], axis=0)

    def support(self, covariance: Covariance) -> tuple[float, float, Float[np.ndarray, "shared r"]]:
        """`Part.support` of the sum: a tangent of the logarithm of the criterion, which is nowhere above it."""
        smooth, values, roots = zip(*(part.support(covariance) for part in self.parts), strict=True)
        weights = np.array([part.weight for part in self.parts])
        value = float(weights @ values)
        shares = np.sqrt(weights * values / value)
        root = np.concatenate([share * root for share, root in zip(shares, roots, strict=True)], axis=1)
        return float(weights @ smooth), value, root


def of_parameters(combine: Combine, responses: Responses, parameters: Sequence[str] | None = None) -> Criterion:
    """A number of the standard uncertainties of some parameters, in mg, mrad or 1e-3 (default: bias, scale, non-orthogonality,
    and their coefficients of temperature: root mean square changes over the range).

    **Raises:** `InputError` if no plan determines any of them.
    """
    if parameters is None:
        parameters = [one for one in responses.names if one.split("_")[0] in SENSOR]
    rows = np.eye(len(responses.names))[np.isin(responses.names, parameters)] * 1e3 * responses.scales
    name = "worst" if combine == "largest" else combine
    return Criterion(name, (Part(determined(rows, one_visit(responses)), combine),))


def in_use(use: Responses, combine: Literal["mean", "largest"] = "mean") -> Criterion:
    """Standard uncertainty of an axis of the corrected force over the attitudes and temperatures of use, mg: root mean square
    (I) or largest (G).

    **Arguments:** `use`: responses of the rig at `attitudes_in_use`, not at the candidates.
    """
    rows = 1e3 * use.columns.reshape(-1, len(use.names))
    if combine == "mean":
        # As many rows as parameters, with the same mean square; those of parameters that nothing shows have none.
        values, vectors = np.linalg.eigh(rows.T @ rows / len(rows))
        seen = values > 1e-12 * values[-1]
        rows = np.sqrt(values[seen] * np.sum(seen))[:, None] * vectors[:, seen].T
    return Criterion(f"in use, {'average' if combine == 'mean' else combine}", (Part(rows, combine),))


def weighted(criteria: Sequence[Criterion], weights: Sequence[float]) -> Criterion:
    """The weighted sum of several criteria."""
    pairs = zip(criteria, weights, strict=True)
    parts = [part._replace(weight=weight * part.weight) for each, weight in pairs for part in each.parts]
    return Criterion("weighted", tuple(parts))


def attitudes_in_use(ability: HeadAbility) -> Cells:
    """Attitudes distributed over the sphere (rings of 30 deg), at each temperature of the chamber."""
    rows = [(360.0 * k / count, beta, ability.mounts[0]) for beta, count in _RINGS for k in range(count)]
    degc = ability.temperatures_degc
    return Cells.listed(rows * max(1, len(degc)), np.repeat(degc, len(rows)) if degc else None)


def determined(rows: Float[np.ndarray, "k shared"], model: LinearModel) -> Float[np.ndarray, "k shared"]:
    """Functionals without the directions that no plan determines: single parameters are left out, others are projected.

    **Raises:** `InputError` if nothing remains.
    """
    size, names = np.sqrt(model.free[: len(model.names)]), model.undetermined()
    hidden = model.free_directions(model.covariance(np.arange(len(model.columns))))
    scaled = rows * size
    rest = scaled - (scaled @ hidden) @ hidden.T
    seen = np.linalg.norm(rest, axis=1) > 0.99 * np.linalg.norm(scaled, axis=1)
    if not np.any(seen):
        raise InputError(f"no plan on this head determines {', '.join(names)}; allow another mounting or state a prior")
    return rest[seen] / size

"""A weighted set of criteria."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from tumblecal.design.criteria.criterion import Criterion
from tumblecal.ground.errors import InputError


@dataclass(frozen=True)
class Weighted:
    """A weighted sum of criteria, each divided by its reference value."""

    criteria: tuple[Criterion, ...]
    weights: tuple[float, ...]
    references: tuple[float, ...]
    name: str = "weighted"

    def __post_init__(self) -> None:
        if not len(self.criteria) == len(self.weights) == len(self.references) > 0:
            raise InputError("a weighted set of criteria needs one weight and one reference for each criterion")
        if min(self.weights) <= 0 or min(self.references) <= 0:
            raise InputError("the weights and the reference values of criteria must be above 0")

    @property
    def rows(self) -> Float[np.ndarray, "k shared"]:
        """The functionals of all criteria."""
        return np.concatenate([criterion.rows for criterion in self.criteria])

    @cached_property
    def parts(self) -> list[tuple[Criterion, slice, float]]:
        """Each criterion, its rows, and its factor."""
        ends = np.cumsum([len(criterion.rows) for criterion in self.criteria])
        total = sum(self.weights)
        return [
            (one, slice(end - len(one.rows), end), weight / total / size)
            for one, end, weight, size in zip(self.criteria, ends, self.weights, self.references, strict=True)
        ]

    def of(self, covariance: Float[np.ndarray, "*n shared shared"]) -> Float[np.ndarray, "*n"]:
        """The value for a covariance of the scaled shared parameters, or for each of several."""
        return np.sum([share * one.of(covariance) for one, _, share in self.parts], axis=0)

    def smooth(self, power: float) -> "Weighted":
        """The same with smooth criteria."""
        return replace(self, criteria=tuple(one.smooth(power) for one in self.criteria))

    def changed(
        self, covariance: Float[np.ndarray, "k k"], parts: Float[np.ndarray, "3 k cells"], sign: int
    ) -> Float[np.ndarray, " cells"]:
        """Values after the change of the covariance by `sign` times the sum of the outer products of the parts."""
        total = np.zeros(parts.shape[2])
        for one, at, share in self.parts:
            total += share * one.changed(covariance[at, at], parts[:, at], sign)
        return total

    def of_rows(self, covariance: Float[np.ndarray, "*n k k"]) -> Float[np.ndarray, "*n"]:
        """The value for a covariance of the functionals, or for each of several."""
        return np.sum([share * one.of_rows(covariance[..., at, at]) for one, at, share in self.parts], axis=0)

    def support(self, covariance: Float[np.ndarray, "k k"]) -> tuple[float, Float[np.ndarray, "k r"]]:
        """The value of a log-convex function that is nowhere above the sum, and R: the derivative of its logarithm by the
        covariance is R R'."""
        parts = [(at, share, *one.support(covariance[at, at])) for one, at, share in self.parts]
        value = sum(share * size for _, share, size, _ in parts)
        root = [np.sqrt(share * size / value) * slope for _, share, size, slope in parts]
        return value, np.asarray(block_diag(*root))

    def curvature(
        self, covariance: Float[np.ndarray, "k k"], first: Float[np.ndarray, "p k"], then: Float[np.ndarray, "n p k"]
    ) -> Float[np.ndarray, "n n"]:
        """Second derivatives of the logarithm by the covariance, along its changes first' then."""
        value, total, mean_slope = float(self.of_rows(covariance)), 0.0, 0.0
        for one, at, share in self.parts:
            weight = share * float(one.of_rows(covariance[at, at])) / value
            root = one.support(covariance[at, at])[1]
            slope = np.einsum("pk,npl,kr,lr->n", first[:, at], then[:, :, at], root, root, optimize=True)
            curve = one.curvature(covariance[at, at], first[:, at], then[:, :, at])
            total, mean_slope = total + weight * (curve + np.outer(slope, slope)), mean_slope + weight * slope
        return total - np.outer(mean_slope, mean_slope)

"""Positions that repeat an attitude: means, and differences (pure error) that no model of the attitude has a part in.

Differences of repeats show the noise for any model of the attitude. Additional dispersion of the means of repeats is lack of
fit (Draper and Smith 1998, section 2.1). So every noise model that makes readings noisier has a twin that is no noise and no
named cause: the means follow that model, the differences the noise as assumed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.causes.cause import UNEXPLAINED
from tumblecal.diagnosis.noise.models import NoiseModel, noisier_readings
from tumblecal.diagnosis.priors import ATTITUDE_ERRORS, GENERIC_WEIGHT, NOISE_WEIGHT
from tumblecal.full_model.tangent import Tangent
from tumblecal.ground.showing import brief
from tumblecal.noise.covariance import Covariance


_WORDS = "the attitude (repeats of an attitude agree, so this is not noise)"


@dataclass(frozen=True)
class Repeats:
    """Which positions of a problem repeat an attitude.

    - `attitude`: a number for each position, the same for repeats; `weights`: of each position's reading in their mean.
    """

    __repr__ = brief

    attitude: Int[np.ndarray, " positions"]
    weights: Float[np.ndarray, " positions"]

    @classmethod
    def of(cls, at: Tangent) -> "Repeats":
        """The repeated attitudes of a problem; free attitudes are never repeated."""
        problem, attitude = at.problem, np.asarray(at.problem.where.attitude)
        # The same to the last digit is one reading written twice, or rounded: it shows no noise.
        _, first, same = np.unique(
            np.column_stack([attitude, problem.readings]), axis=0, return_index=True, return_inverse=True
        )
        copied = first[same.ravel()] != np.arange(len(attitude))
        alone = np.ones(len(attitude), bool) if at.model.hand_held else copied
        attitude = np.where(alone, len(attitude) + np.arange(len(attitude)), attitude)
        return cls(np.unique(attitude, return_inverse=True)[1].ravel(), 1.0 / np.mean(problem.sd, axis=1))

    @cached_property
    def share(self) -> float:
        """How far the differences show the noise: 1 where there are as many as attitudes, 0 without any."""
        attitudes = int(self.attitude.max()) + 1
        return min(1.0, (len(self.attitude) - attitudes) / attitudes)

    @cached_property
    def is_mean(self) -> Bool[np.ndarray, " positions"]:
        """Which rows of `turn` make means: the first position of each attitude."""
        first = np.zeros(len(self.attitude), bool)
        first[np.unique(self.attitude, return_index=True)[1]] = True
        return first

    @cached_property
    def turn(self) -> Float[np.ndarray, "positions positions"]:
        """Orthonormal: makes means of repeats (with the noise of a single reading) and differences of white readings."""
        turn = np.eye(len(self.attitude))
        for number in np.flatnonzero(np.bincount(self.attitude) > 1).tolist():
            own = np.flatnonzero(self.attitude == number)
            q, _ = np.linalg.qr(np.column_stack([self.weights[own], np.eye(len(own))[:, 1:]]))
            turn[np.ix_(own, own)] = q.T
        return turn

    def turned(self, rows: Float[np.ndarray, "rows columns"]) -> Float[np.ndarray, "rows columns"]:
        """Rows as means and differences; those of priors, behind the readings, as they are."""
        count = len(self.attitude)
        made = (self.turn @ rows[: 3 * count].reshape(count, -1)).reshape(3 * count, -1)
        return np.concatenate([made, rows[3 * count :]])

    def twins(self, models: Sequence[NoiseModel]) -> list[NoiseModel]:
        """Twins of noise models as errors of the attitude, and errors of the attitude of all three axes of several sizes, with
        covariances of means and differences; none without repeats."""
        if not self.share:
            return []
        share = float(np.log(self.share * GENERIC_WEIGHT))
        weights = self.weights / np.median(self.weights)
        sizes = np.bincount(self.attitude, weights**2)[self.attitude]
        made = [
            self._twin(share - float(np.log(len(ATTITUDE_ERRORS))), np.repeat(1.0 + size**2 * sizes, 3), "rows")
            for size in ATTITUDE_ERRORS
        ]
        for model in noisier_readings(models):
            weight = model.log_weight + share - float(np.log(NOISE_WEIGHT))
            made.append(self._twin(weight, model.covariance.values, model.covariance.form, model.tail))
        return made

    def _twin(self, log_weight: float, values: np.ndarray, form: str, tail: float | None = None) -> NoiseModel:
        """The model whose means have a covariance."""
        if form == "blocks":
            values = np.where(self.is_mean[:, None, None], values, np.eye(3))
        else:
            values = np.where(np.repeat(self.is_mean, 3), values, 1.0)
        return NoiseModel(UNEXPLAINED, _WORDS, log_weight, Covariance(values, form), tail=tail, of_means=True)

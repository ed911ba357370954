"""Which parameter changed: Bayes factors of one changed parameter, several, or an attitude that was not at rest.

Each explanation adds a change with a Gaussian prior to the parameters (or to a reading), whose standard deviation is the usual
size times a factor of `FACTORS`, all equally probable. The evidence is that of the innovation. Prior probabilities put a bias
before a scale factor. An explanation is named if its posterior probability is above 0.95, given that there is a change.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from tumblecal.check import usual_changes as usual
from tumblecal.check.consistency import Consistency
from tumblecal.data.sensor_parameters import SENSOR, leaf_of
from tumblecal.estimation.attitudes import Attitude, attitudes, slopes


NAMED = 0.95
_MOST_ATTITUDES = 3
# Separation in standard deviations below which a further attitude is not proposed.
_LEAST_SEPARATION = 2.0
_DIRECTIONS = np.array([each.up for each in attitudes()])
_KINDS = {"dK": "scale", "bias": "bias", "gamma": "angle"}


@dataclass(frozen=True)
class Explanation:
    """One explanation of a rejected calibration.

    - `kind`: bias, biases, scale, scales (all by the same share), angle, several, or attitude. `parameters`: those that
      changed, none for an attitude. `attitude`: the name of the position.
    - `probability`: posterior probability. `change` (9), `covariance` (9, 9): of the parameters, base units.
    """

    kind: str
    parameters: tuple[str, ...]
    probability: float
    change: Float[np.ndarray, "9"]
    covariance: Float[np.ndarray, "9 9"]
    attitude: str = ""

    @property
    def sd(self) -> Float[np.ndarray, "9"]:
        """Standard uncertainty of the change."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True)
class Moved:
    """Explanations by probability, and the attitudes that would separate the likeliest ones."""

    explanations: tuple[Explanation, ...]
    separating: tuple[Attitude, ...]

    @property
    def named(self) -> Explanation | None:
        """The explanation with a probability above 0.95; None if none has."""
        best = self.explanations[0]
        return best if best.probability > NAMED else None

    @property
    def biases(self) -> float:
        """Probability that only biases changed."""
        return sum(each.probability for each in self.explanations if each.kind in ("bias", "biases"))

    @property
    def possible(self) -> tuple[Explanation, ...]:
        """The explanations that together have a probability of 0.95, the likeliest first."""
        total, listed = 0.0, []
        for each in self.explanations:
            if total > NAMED:
                break
            listed.append(each)
            total += each.probability
        return tuple(listed)

    @property
    def attitudes_that_separate(self) -> list[str]:
        """Those attitudes in words."""
        return [attitude.words for attitude in self.separating]

    @property
    def average(self) -> tuple[Float[np.ndarray, "9"], Float[np.ndarray, "9 9"]]:
        """Mean and covariance of the change over all explanations."""
        mean = sum((each.probability * each.change for each in self.explanations), np.zeros(9))
        spread = np.zeros((9, 9))
        for each in self.explanations:
            away = each.change - mean
            spread += each.probability * (each.covariance + np.outer(away, away))
        return mean, spread

    @cached_property
    def change_g(self) -> tuple[float, float] | None:
        """The largest change of a corrected force over attitudes, and its expanded uncertainty there (k = 2), g; None if the
        attitudes do not determine it."""
        named = self.named
        mean, covariance = self.average if named is None else (named.change, named.covariance)
        x, y, z = _DIRECTIONS.T
        columns = np.zeros((len(_DIRECTIONS), 3, 9))
        columns[:, 0, 0], columns[:, 1, 1], columns[:, 2, 2] = x, y, z
        columns[:, range(3), range(3, 6)] = 1.0
        columns[:, 1, 6], columns[:, 2, 7], columns[:, 2, 8] = x, x, y
        change = np.linalg.norm(columns @ mean, axis=1)
        spread = np.linalg.eigvalsh(columns @ covariance @ columns.swapaxes(1, 2))[:, -1]
        worst = int(np.argmax(change))
        size, expanded = float(change[worst]), float(2 * np.sqrt(spread[worst]))
        return (size, expanded) if expanded < size else None


def moved(test: Consistency, noise_g: float) -> Moved:
    """The explanations of a rejected calibration.

    **Arguments:**

    - `noise_g`: standard deviation of a position, g, for the choice of further attitudes.
    """
    rows, prior = test.observation, test.expected.of_parameters + test.expected.common
    by_state = rows.by_state(test.expected.slope)
    whole = np.eye(len(rows.innovation)) + by_state @ test.expected.covariance @ by_state.T
    whole += rows.slopes @ test.expected.common @ rows.slopes.T
    root = np.linalg.cholesky(whole)
    white, slopes_white = np.linalg.solve(root, rows.innovation), np.linalg.solve(root, rows.slopes)
    log_weights, found = [], []
    for kind, parameters, log_prior, sizes, attitude in _hypotheses(rows.names):
        if attitude is None:
            columns = slopes_white @ sizes
        else:
            columns = usual.DISTURBED_G * np.linalg.solve(root, rows.of_attitude[attitude])
            sizes = np.zeros((9, 3))
        log_evidence, means, variances = _evidence(white, columns)
        share = np.exp(log_evidence - log_evidence.max())
        log_weights.append(log_prior + log_evidence.max() + np.log(np.mean(share)))
        share /= share.sum()
        mean = share @ means
        away = means - mean
        covariance = np.einsum("f,fij->ij", share, variances + away[:, :, None] * away[:, None, :])
        label = "" if attitude is None else rows.names[attitude]
        found.append(Explanation(kind, parameters, 0.0, sizes @ mean, sizes @ covariance @ sizes.T, label))
    weights = np.exp(np.array(log_weights) - np.max(log_weights))
    weights /= weights.sum()
    listed = [replace(one, probability=float(weight)) for one, weight in zip(found, weights, strict=True)]
    ordered = tuple(sorted(listed, key=lambda each: -each.probability))
    return Moved(ordered, _separating(ordered, prior, noise_g))


def _hypotheses(
    names: Sequence[str],
) -> Iterator[tuple[str, tuple[str, ...], float, Float[np.ndarray, "9 columns"], int | None]]:
    """Kind, parameters, logarithm of the prior, columns of unit changes, and the number of the attitude."""
    single = {"bias": usual.BIAS, "scale": usual.SCALE, "angle": usual.ANGLE}
    every = np.diag(usual.USUAL)
    for number, name in enumerate(SENSOR):
        kind = _KINDS[leaf_of(name)]
        yield kind, (name,), np.log(single[kind] / 3), every[:, [number]], None
    yield "biases", SENSOR[3:6], np.log(usual.BIASES), every[:, 3:6], None
    yield "scales", SENSOR[:3], np.log(usual.SCALES), every[:, :3].sum(axis=1, keepdims=True), None
    yield "several", SENSOR, np.log(usual.SEVERAL), every, None
    for number in range(len(names)):
        yield "attitude", (), np.log(usual.ATTITUDE / len(names)), np.zeros((9, 0)), number


def _evidence(
    white: Float[np.ndarray, " rows"], columns: Float[np.ndarray, "rows columns"]
) -> tuple[
    Float[np.ndarray, " factors"], Float[np.ndarray, "factors columns"], Float[np.ndarray, "factors columns columns"]
]:
    """Log evidence relative to no change, and posterior of the coefficients, for each factor of the prior sd."""
    across, sizes, right = np.linalg.svd(columns, full_matrices=False)
    along = across.T @ white
    logs, means, variances = [], [], []
    for factor in usual.FACTORS:
        total = 1 + (factor * sizes) ** 2
        logs.append(0.5 * np.sum((1 - 1 / total) * along**2 - np.log(total)))
        means.append(right.T @ (factor**2 * sizes / total * along))
        spread = factor**2 * np.eye(columns.shape[1]) - right.T @ np.diag(factor**4 * sizes**2 / total) @ right
        variances.append(spread)
    return np.array(logs), np.array(means), np.array(variances)


def _separating(
    ordered: Sequence[Explanation], prior: Float[np.ndarray, "9 9"], noise_g: float
) -> tuple[Attitude, ...]:
    """Attitudes whose size of gravity differs most between the likeliest explanations."""
    likeliest = [each for each in ordered[:5] if each.parameters]
    if len(likeliest) < 2 or ordered[0].probability > NAMED:
        return ()
    candidates = attitudes()
    rows = slopes(np.array([each.up for each in candidates]))
    best = likeliest[0]
    chosen: list[Attitude] = []
    for other in likeliest[1:]:
        spread = prior + best.covariance + other.covariance
        separation = np.abs(rows @ (best.change - other.change)) / np.sqrt(
            noise_g**2 + np.einsum("ri,ij,rj->r", rows, spread, rows)
        )
        here = candidates[int(np.argmax(separation))]
        if separation.max() > _LEAST_SEPARATION and here not in chosen:
            chosen.append(here)
    return tuple(chosen[:_MOST_ATTITUDES])

"""The noise of position means estimated from their recording: standard deviation, and correlation between positions.

The noise model of the recording (noise.dwell_fit), from the raw samples or as stated in the file of the means, gives the exact
covariance of dwell means at the times of the positions. White noise alone is independent between positions, with sd / sqrt(n);
flicker, random walk and slow Gauss-Markov noise are not. A dwell does not show how its slow noise continues until the next one.
Noise of the instrument continues; noise of the fixture (settling, a hand) restarts. The dispersion between positions separates
these cases: the candidates here compete in the diagnosis.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

import numpy as np
from jaxtyping import Float
from pydantic import BeforeValidator
from scipy.special import softmax

from tumblecal.data import PositionSet
from tumblecal.effects import AXES
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.linearised import linearised
from tumblecal.estimation.problem import Problem
from tumblecal.ground.errors import InputError
from tumblecal.ground.record import ResultRecord, at, by_name
from tumblecal.noise import Covariance, Flicker, GaussMarkov, Noise, RandomWalk, White
from tumblecal.noise.dwell_fit import LEAST_G
from tumblecal.noise.dwell_sd import sd_of_means, white_sd
from tumblecal.noise.recorded import RecordedNoise, against_neighbours, recorded_covariance, recordings
from tumblecal.recordings.dwells.samples_of_means import samples_of
from tumblecal.words import sentence


if TYPE_CHECKING:
    from tumblecal.recordings.dwells.dwell_samples import DwellSamples

# A mean this much (sd) noisier than white noise is mostly slow noise.
_MOSTLY_SLOW = 1.5
_SLOW = {"flicker": Flicker, "walk": RandomWalk, "markov": GaussMarkov}
_PRIOR = {"apart": 0.3, "white": 0.1}
# Slow noise that continues: its variance over that estimated from the dwells, which is uncertain, and the prior of each ratio.
_LEVELS = {0.25: 0.06, 1.0: 0.24, 4.0: 0.15, 16.0: 0.1, 64.0: 0.05}


Median = Annotated[list[float], BeforeValidator(lambda sd: np.median(sd, axis=0))]
Coefficients = Annotated[dict[str, dict[str, float]], by_name(AXES), BeforeValidator(Noise.coefficients)]


class MeanNoiseRecord(ResultRecord):
    """`MeanNoise` in JSON files, by axis."""

    source: str
    dwell_s: float
    slow_noise: str = at("lasts")
    level_known: bool
    sd_of_mean_g: Median = at("sd")
    white_sd_of_mean_g: Median = at("white_sd")
    neighbours_correlation: list[float] = at("neighbours")
    noise: Coefficients


@dataclass(frozen=True)
class MeanNoise:
    """The noise of position means by their recording.

    - `covariance` (3, positions, positions): of the means of each axis, g^2.
    - `sd` (positions, 3): of each mean relative to the neighbouring positions, g: without their common slow variation.
    - `white_sd` (positions, 3): sd / sqrt(n), g.
    - `noise`: its parts (of the first recording); `dwell_s`: length of the median dwell.
    - `timed`: whether the times of the positions are known; without them correlations between positions are unknown.
    - `lasts`: the slow part that continues between positions: flicker, walk or markov; `apart` if the slow noise
      restarts in each dwell; "white" if it does not appear in the means.
    - `log_weight`: log prior of the candidate.
    - `level`: variance of the slow part over that estimated from the dwells.
    - `sampled`: whether `source` is the raw samples, not the means' own file.
    """

    covariance: Float[np.ndarray, "3 positions positions"]
    sd: Float[np.ndarray, "positions 3"]
    white_sd: Float[np.ndarray, "positions 3"]
    noise: Noise
    dwell_s: float
    timed: bool
    source: str
    lasts: str
    log_weight: float
    level: float = 1.0
    sampled: bool = False

    @property
    def origin(self) -> str:
        """Source of the noise model, in words."""
        return "the raw samples" if self.sampled else "the recording, as the file states it"

    @property
    def neighbours(self) -> Float[np.ndarray, "3"]:
        """Mean correlation of successive positions about the mean of all, by axis."""
        count = self.covariance.shape[1]
        centre = np.eye(count) - 1.0 / count
        about = centre @ self.covariance @ centre
        return np.array([np.sum(np.diag(of_axis, 1)) / np.sum(np.diag(of_axis)[1:]) for of_axis in about])

    @property
    def _of_means(self) -> Covariance:
        """Covariance of the means; independent if the correlation between positions is negligible."""
        relative = self.covariance / (self.sd.T[:, :, None] * self.sd.T[:, None, :])
        if np.max(np.abs(relative - np.eye(len(self.sd)))) < 1e-3:
            return Covariance.of_sd(self.sd)
        return Covariance.by_axis(self.covariance)

    def applied(self, problem: Problem, *, known: bool | None = None) -> Problem:
        """The problem under this noise; its level counts as known unless it is extrapolated, or as given by `known`."""
        known = self.level_known if known is None else known
        return problem.with_noise(self._of_means, known=known, sd=self.sd)

    @property
    def level_known(self) -> bool:
        """Whether the level of the noise is known: it is not extrapolated."""
        return not self.extrapolated

    @property
    def extrapolated(self) -> bool:
        """Whether slow noise beyond the length of a dwell dominates the sd of a mean; its level then counts as unknown."""
        size = self.covariance.shape[1]
        about_mean = np.trace(self.covariance, axis1=1, axis2=2) - np.sum(self.covariance, axis=(1, 2)) / size
        total = np.sqrt(about_mean / (size - 1))
        return bool(np.max(total / np.sqrt(np.mean(self.white_sd**2, axis=0))) > _MOSTLY_SLOW)

    @property
    def label(self) -> str:
        """Name of the candidate."""
        return f"{self.lasts} {self.level:g}"

    def words(self) -> str:
        """The noise found, and the error of assuming white noise."""
        sd, white = np.median(self.sd, axis=0), np.median(self.white_sd, axis=0)
        ratio, common = sd / white, self.neighbours
        return sentence(
            "noise/means",
            n=self,
            count=self.covariance.shape[1],
            parts=[f"{axis} {words}" for axis, words in zip(AXES, self.noise.words(self.dwell_s), strict=True)],
            sd=_by_axis(sd * 1e6),
            white=_by_axis(white * 1e6),
            ratio=_by_axis(ratio) if np.max(ratio) > 1.1 else "",
            slow=len(self.noise.parts) > 1,
            common=_by_axis(common) if np.max(common) > 0.05 else "",
        )


def sample_noises(samples: "DwellSamples", data: PositionSet) -> list[MeanNoise]:
    """The noise of position means from their raw samples, one candidate for each way in which the slow noise may continue.

    **Arguments:**

    - `samples`: of all positions. `data`: the means; its times take precedence over those of the samples.

    **Returns:** the candidates; in the first the positions are independent, with the sd of a mean relative to the next.

    **Raises:** `InputError` if a position has no samples, or if its mean differs from that of the samples.
    """
    found, source = samples_of(samples, data), samples.positions.source
    forces = found.force
    still = np.median([white_sd(force) for force in forces], axis=0) < LEAST_G
    if np.any(still):
        raise InputError(
            f"{source}: axis {', '.join(AXES[axis] for axis in np.flatnonzero(still))}: most positions' samples are "
            "equal, because their resolution is coarser than their noise; the noise cannot be estimated; give --noise-sd"
        )
    counts = np.array([len(force) for force in forces], float)
    # The times of the means take precedence.
    timed = data.time_s is not None and np.ptp(data.time_s) > 0
    times = data.time_s if timed else found.positions.time_s
    # Positions without times: any order of independent dwells.
    order = np.arange(len(forces)) * np.median(counts) / samples.rate_hz if times is None else times
    recorded = RecordedNoise.of(forces, samples.rate_hz, float(np.ptp(order)))
    noises = recorded_noises(
        replace(
            data,
            n=counts,
            time_s=times,
            sd=sd_of_means(recorded, forces, order),
            recorded_noise=(recorded.text(),) * len(data),
        )
    )
    return [replace(noise, source=source, sampled=True) for noise in noises]


def recorded_noises(data: PositionSet) -> list[MeanNoise]:
    """The noise of position means as their recordings state it, one candidate for each way in which the slow noise
    may continue.

    **Arguments:**

    - `data`: means with the noise model of their recordings; none where a position lacks it.

    **Raises:** `InputError` when the noise model cannot be read, or gives no covariance.
    """
    listed = recordings(data)
    if not listed or data.n is None or data.sd is None or not np.all(np.sum([rows for rows, _ in listed], axis=0)):
        return []
    white, fast = np.zeros_like(data.sd), np.zeros_like(data.sd)
    for rows, recorded in listed:
        white[rows] = recorded.sample_sd / np.sqrt(data.n[rows])[:, None]
        white_part = Noise(tuple(part for part in recorded.noise.parts if isinstance(part, White)))
        fast[rows] = white_part.allan_deviation(data.n[rows] / recorded.rate_hz)
    noise, rate_hz = listed[0][1].reported, listed[0][1].rate_hz
    dwell_s = float(np.median(data.n)) / rate_hz

    white = np.maximum(white, LEAST_G)
    base = MeanNoise(
        _diagonal(data.sd),
        data.sd,
        white,
        noise,
        dwell_s,
        data.time_s is not None,
        data.source,
        "apart",
        np.log(_PRIOR["apart"]),
    )
    noises = [
        base,
        replace(base, covariance=_diagonal(white), sd=white, lasts="white", log_weight=np.log(_PRIOR["white"])),
    ]
    lasting, tau = recorded_covariance(data), np.array([dwell_s])
    if lasting is not None and data.time_s is not None and np.ptp(data.time_s) > 0:
        shares = {
            name: np.sum(Noise(tuple(p for p in noise.parts if isinstance(p, kind))).allan_deviation(tau) ** 2)
            for name, kind in _SLOW.items()
        }
        lasts = max(shares, key=lambda name: shares[name])
        for level, prior in _LEVELS.items():
            covariance = _diagonal(fast) + level * (lasting - _diagonal(fast))
            sd = np.sqrt(against_neighbours(covariance, data.time_s))
            weight = float(np.log(prior))
            noises.append(replace(base, covariance=covariance, sd=sd, lasts=lasts, log_weight=weight, level=level))
    return noises


def likeliest_noise(fit: Fit) -> MeanNoise | None:
    """The noise of the recording that the residuals of a fit with it support; None if the positions do not all state it.

    The ways in which slow noise may continue compete by the restricted likelihood of the residuals (Patterson and Thompson
    1971), linearised at the exact fit, and by their prior weights. The covariance is the mean over all, by probability.
    """
    problem = fit.problem
    noises = recorded_noises(fit.data)
    if not noises:
        return None
    unit = problem.with_noise(Covariance.of_sd(np.ones(problem.readings.shape)), known=True)
    residual, jacobian = (np.asarray(part) for part in linearised(unit, fit.values))
    rows = np.column_stack([jacobian, residual])
    weights = [noise.log_weight + _restricted(Covariance.by_axis(noise.covariance), rows) for noise in noises]
    probabilities = softmax(weights)
    return replace(
        noises[int(np.argmax(weights))],
        covariance=np.tensordot(probabilities, [noise.covariance for noise in noises], 1),
        sd=np.sqrt(np.tensordot(probabilities, [noise.sd**2 for noise in noises], 1)),
    )


def _restricted(noise: Covariance, rows: Float[np.ndarray, "rows columns"]) -> float:
    """Logarithm of the restricted likelihood under a noise; the columns are a Jacobian and the residual (g)."""
    triangle = np.abs(np.diag(np.linalg.qr(noise.whiten(rows), mode="r")))
    return float(-noise.half_log_det - np.sum(np.log(triangle[:-1])) - triangle[-1] ** 2 / 2)


def _diagonal(sd: Float[np.ndarray, "positions 3"]) -> Float[np.ndarray, "3 positions positions"]:
    """Covariance of independent positions."""
    return np.array([np.diag(variance) for variance in sd.T**2])


def _by_axis(values: np.ndarray) -> str:
    return " / ".join(f"{value:.2g}" if value < 100 else f"{value:.0f}" for value in values)

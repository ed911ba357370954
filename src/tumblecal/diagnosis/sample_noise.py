"""What the raw samples say of the noise of position means: its sd, and what neighbouring positions have in common.

The Allan deviation of all dwells together gives noise models (capture.noise_model); a model gives the exact covariance of
means over dwells at the times of the positions (simulation.noise). White noise alone would be independent from position
to position, with sd / sqrt(n); flicker, random walk and slow Gauss-Markov noise are neither. But a dwell does not show how
what is slow in it goes on until the next: it may be the instrument's and last, or the fixture's (settling, a hand) and
begin anew. These are told apart by the scatter of the positions: the candidates here compete in the diagnosis.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from tumblecal.capture.allan import averaging_factors, overlapping_allan
from tumblecal.capture.noise_model import SLOW, NoiseModel, fitted_models
from tumblecal.capture.position_samples import PositionSamples
from tumblecal.capture.reduce import batch_means_sd
from tumblecal.data import PositionSet
from tumblecal.diagnosis.noise_causes import NoiseAlternative, alternative
from tumblecal.diagnosis.noise_change import most_probable
from tumblecal.diagnosis.sample_check import require_samples_of
from tumblecal.diagnosis.screen import Screening
from tumblecal.diagnosis.tangent import Tangent
from tumblecal.effects import AXES
from tumblecal.errors import InputError
from tumblecal.estimation.problem import Problem
from tumblecal.noise.covariance import Covariance
from tumblecal.simulation.noise import Dwells, GaussMarkov, Noise, RandomWalk, flicker


# A dwell this much noisier than the model (sd of its samples) goes by its own scatter.
_NOISIER = 1.5
# Slowest flicker that is counted, in lengths of the whole measurement: slower is constant, and the bias takes it up.
_SLOWEST = 10.0
# Readings that do not move at all (coarse quantisation) still have some noise.
_LEAST_G = 1e-9
# A mean this much (sd) noisier than white noise is mostly slow noise.
_MOSTLY_SLOW = 1.5
_PRIOR = {"apart": 0.3, "white": 0.1, "flicker": 0.2, "walk": 0.2, "markov": 0.2}
_LASTING = {
    "apart": "What is slow within a dwell begins anew at every position (settling, handling), so the positions are "
    "independent.",
    "white": "What is slow within a dwell does not show in the scatter of the positions; they are counted as means of "
    "white noise.",
}


@dataclass(frozen=True)
class SampleNoise:
    """The noise of position means from their raw samples.

    - `covariance` (3, positions, positions): of the means of each axis, g^2.
    - `sd` (positions, 3): of each mean against the positions measured next to it, g: without the slow wander that
      they have in common.
    - `white_sd` (positions, 3): what sd / sqrt(n) would say, g.
    - `models`: the noise model of each axis; `dwell_s`: length of the median dwell.
    - `timed`: whether the positions' times were known; without them nothing is said of what they have in common.
    - `lasts`: the slow part that goes on from position to position: flicker, walk or markov; "apart" when what is slow
      within a dwell begins anew in each; "white" when it does not show in the means at all.
    - `log_weight`: prior of the candidate, and how well its model fits the Allan deviation.
    """

    covariance: Float[np.ndarray, "3 positions positions"]
    sd: Float[np.ndarray, "positions 3"]
    white_sd: Float[np.ndarray, "positions 3"]
    models: tuple[NoiseModel, ...]
    dwell_s: float
    timed: bool
    source: str
    lasts: str
    log_weight: float

    @property
    def neighbours(self) -> Float[np.ndarray, "3"]:
        """Mean correlation of successive positions about the mean of all, by axis."""
        count = self.covariance.shape[1]
        centre = np.eye(count) - 1.0 / count
        about = centre @ self.covariance @ centre
        return np.array([np.sum(np.diag(own, 1)) / np.sum(np.diag(own)[1:]) for own in about])

    @property
    def _of_means(self) -> Covariance:
        """Of the means; independent where what neighbours have in common is next to nothing."""
        relative = self.covariance / (self.sd.T[:, :, None] * self.sd.T[:, None, :])
        if np.max(np.abs(relative - np.eye(len(self.sd)))) < 1e-3:
            return Covariance.of_sd(self.sd)
        return Covariance.by_axis(self.covariance)

    def applied(self, problem: Problem, *, known: bool | None = None) -> Problem:
        """The problem under this noise; its level counts as known unless it is extrapolated, or as said."""
        known = not self.extrapolated if known is None else known
        return problem.with_noise(self._of_means, known=known, sd=self.sd)

    @property
    def extrapolated(self) -> bool:
        """Whether the slow part, which no dwell shows for as long as it lasts, decides the sd of a mean: its level then
        counts as unknown."""
        return bool(np.max(np.median(self.sd, axis=0) / np.median(self.white_sd, axis=0)) > _MOSTLY_SLOW)

    def alternative(self, at: Tangent) -> NoiseAlternative:
        """This noise as an alternative to that with which a linearisation was made."""
        whitening, matrix = np.asarray(at.problem.whitening), Covariance.by_axis(self.covariance).matrix
        root = whitening if at.problem.correlated else np.diag(whitening)
        return alternative(at, self.lasts, self.lasts, self.log_weight, Covariance(root @ matrix @ root.T, "full"))

    def record(self) -> dict:
        """The same in numbers."""
        return {
            "source": self.source,
            "dwell_s": self.dwell_s,
            "slow_noise": self.lasts,
            "level_known": not self.extrapolated,
            "sd_of_mean_g": np.median(self.sd, axis=0).tolist(),
            "white_sd_of_mean_g": np.median(self.white_sd, axis=0).tolist(),
            "neighbours_correlation": self.neighbours.tolist(),
            "noise": dict(zip(AXES, (model.as_dict() for model in self.models), strict=True)),
        }

    def words(self) -> str:
        """What was found, and how the assumption of white noise would have erred."""
        sd, white = np.median(self.sd, axis=0), np.median(self.white_sd, axis=0)
        parts = "; ".join(f"{axis} {_model_words(model)}" for axis, model in zip(AXES, self.models, strict=True))
        said = [
            f"Raw samples of {self.source} ({self.covariance.shape[1]} positions of {self.dwell_s:.3g} s): {parts}. "
            f"Sd of a position mean against the next: {_by_axis(sd * 1e6)} ug."
        ]
        ratio = sd / white
        if np.max(ratio) > 1.1:
            said.append(
                f"Counted as white noise (sd / sqrt(n)) it would be {_by_axis(white * 1e6)} ug, "
                f"{_by_axis(ratio)} times too small."
            )
        else:
            said.append("That is the noise of independent samples, sd / sqrt(n).")
        if self.lasts in _LASTING and any(_slow_only(model).mean_variance(self.dwell_s) > 0 for model in self.models):
            said.append(_LASTING[self.lasts])
        common = self.neighbours
        if np.max(common) > 0.05:
            said.append(
                f"Successive positions are correlated by {_by_axis(common)}, since the noise is slower than a dwell; "
                "the tests and intervals here count that."
            )
        if self.extrapolated:
            said.append("That is extrapolated from within the dwells, so the level of the noise counts as unknown.")
        if not self.timed:
            said.append("The positions' times are not known (column time_s): they are taken as independent.")
        return " ".join(said)


def sample_noises(samples: PositionSamples, data: PositionSet) -> list[SampleNoise]:
    """The covariance of position means from their raw samples, one for each way the slow noise may go on.

    **Arguments:**

    - `samples`: raw samples, by position name. `data`: the means; its times go before those of the samples.

    **Returns:** the candidates; the first makes the positions independent, with the sd of a mean at its dwell's length.

    **Raises:** `InputError` when a position has no samples, or its mean is not that of the samples.
    """
    require_samples_of(samples, data)
    forces = [samples.force[name] for name in data.names]
    rate, counts = samples.rate_hz, np.array([len(force) for force in forces])
    steps = np.array([np.std(np.diff(force, axis=0)) for force in forces])
    ordinary = steps < _NOISIER * np.median(steps)
    used = [force for force, kept in zip(forces, ordinary, strict=True) if kept]
    factors = averaging_factors(int(max(counts)), per_octave=2)
    fits = [fitted_models(overlapping_allan([one[:, axis] for one in used], rate, factors)) for axis in range(3)]
    best = [min(one.values(), key=lambda pair: pair[0]) for one in fits]
    times = _times(samples, data)
    white_sd = np.stack([force.std(0, ddof=1) for force in forces]) / np.sqrt(counts)[:, None]
    still = np.median(white_sd, axis=0) < _LEAST_G
    if np.any(still):
        raise InputError(
            f"{samples.source}: axis {', '.join(AXES[axis] for axis in np.flatnonzero(still))}: most positions' samples are "
            "all the same, since their resolution is coarser than their noise: they say nothing of it; give --noise-sd"
        )
    white_sd = np.maximum(white_sd, _LEAST_G)
    own = np.maximum(np.stack([batch_means_sd(force) for force in forces]), white_sd)

    def candidate(lasts: str, models: list[NoiseModel], log_weight: float) -> SampleNoise:
        slow, local = _slow(models, lasts, counts, rate, times)
        variance = np.array([[_fast_variance(model, count / rate) for model in models] for count in counts]) + local
        variance = np.maximum(variance, _LEAST_G**2)
        variance = np.where(ordinary[:, None], variance, np.maximum(own**2, variance))
        covariance = slow + np.stack([np.diag(one) for one in (variance - local).T])
        return SampleNoise(
            covariance,
            np.sqrt(variance),
            white_sd,
            tuple(models),
            samples.dwell_s,
            times is not None,
            samples.source,
            lasts,
            log_weight,
        )

    found = [candidate(lasts, [model for _, model in best], np.log(_PRIOR[lasts])) for lasts in ("apart", "white")]
    for kind in SLOW[1:] if times is not None else ():
        chosen = [one.get(kind, pair) for one, pair in zip(fits, best, strict=True)]
        if any(kind in one for one in fits):
            worse = sum(score - least for (score, _), (least, _) in zip(chosen, best, strict=True))
            found.append(candidate(kind, [model for _, model in chosen], float(np.log(_PRIOR[kind]) - worse / 2)))
    return found


def chosen_sample_noise(screening: Screening, noises: list[SampleNoise]) -> SampleNoise | None:
    """The candidate that goes best with the scatter of the positions, causes allowed; None without candidates."""
    chosen = noises[0] if noises else None
    for _ in noises:
        assert chosen is not None
        # The levels, too, tell them apart: all of them count as known here.
        now = chosen.applied(screening.given, known=True)
        screened = replace(screening, given=now)(now)
        listed = [noise.alternative(screened.at) for noise in noises if noise is not chosen]
        # Scatter that no samples show (a head that repeats less well) is no reason to take their noise for slow.
        best = most_probable(screened, [*listed, *screened.noise])
        if best is None or best.log_odds < chosen.log_weight:
            break
        if not any(best.alternative is alternative for alternative in listed):
            break
        chosen = next(noise for noise in noises if noise.lasts == best.alternative.label)
    return chosen


def _times(samples: PositionSamples, data: PositionSet) -> np.ndarray | None:
    if data.time_s is not None and np.ptp(data.time_s) > 0:
        return np.asarray(data.time_s, float)
    if samples.middle_s:
        return np.array([samples.middle_s[name] for name in data.names])
    return None


def _against_neighbours(slow: np.ndarray, times: np.ndarray) -> Float[np.ndarray, "positions 3"]:
    """Half the variance of the difference of successive positions, the mean of both sides."""
    order = np.argsort(times, kind="stable")
    local = np.zeros((len(times), 3))
    for axis, own in enumerate(slow):
        sorted_own = own[np.ix_(order, order)]
        diagonal = np.diag(sorted_own)
        steps = np.maximum(diagonal[1:] + diagonal[:-1] - 2 * np.diag(sorted_own, 1), 0.0) / 2
        sides = np.concatenate([steps[:1], steps]) + np.concatenate([steps, steps[-1:]])
        local[order, axis] = sides / 2
    return local


def _slow(
    models: list[NoiseModel], lasts: str, counts: np.ndarray, rate_hz: float, times: np.ndarray | None
) -> tuple[Float[np.ndarray, "3 positions positions"], Float[np.ndarray, "positions 3"]]:
    """Covariance of the slow part of the means, and its variance against the neighbours."""
    size = len(counts)
    slow = np.zeros((3, size, size))
    if lasts == "white":
        return slow, np.zeros((size, 3))
    if lasts == "apart" or times is None:
        durations = counts / rate_hz
        local = np.array([[_slow_only(model).mean_variance(duration) for model in models] for duration in durations])
        for axis in range(3):
            np.fill_diagonal(slow[axis], local[:, axis])
        return slow, local
    dwells = Dwells(times - times.min(), int(np.median(counts)), 1.0 / rate_hz)
    slow = slow + _lasting(models, dwells, rate_hz).mean_covariance(dwells)
    return slow, _against_neighbours(slow, times)


def _lasting(models: list[NoiseModel], dwells: Dwells, rate_hz: float) -> Noise:
    """The slow parts as processes that go on through the moves."""
    whole = float(np.ptp(dwells.start_s)) + dwells.samples * dwells.period_s
    walk = np.array([model.walk_g_per_rts for model in models])
    bias = np.array([model.flicker_g for model in models])
    parts: list = [RandomWalk(walk)] if np.any(walk) else []
    if np.any(bias):
        parts += flicker(bias, shortest_s=1.0 / rate_hz, longest_s=_SLOWEST * whole)
    for axis, model in enumerate(models):
        if model.markov_sd_g:
            parts.append(GaussMarkov(model.markov_sd_g * np.eye(3)[axis], model.markov_time_s))
    return Noise(tuple(parts))


def _slow_only(model: NoiseModel) -> NoiseModel:
    return replace(model, quantisation_g_s=0.0, white_g_per_rthz=0.0)


def _fast_variance(model: NoiseModel, duration_s: float) -> float:
    """Variance of a mean from white and quantisation noise."""
    fast = NoiseModel(quantisation_g_s=model.quantisation_g_s, white_g_per_rthz=model.white_g_per_rthz)
    return fast.mean_variance(duration_s)


def _by_axis(values: np.ndarray) -> str:
    return " / ".join(f"{value:.2g}" if value < 100 else f"{value:.0f}" for value in values)


def _model_words(model: NoiseModel) -> str:
    parts = [
        (model.white_g_per_rthz, "white {:.3g} ug/sqrt(Hz)"),
        (model.flicker_g, "flicker (bias instability) {:.3g} ug"),
        (model.markov_sd_g, f"Gauss-Markov {{:.3g}} ug with {model.markov_time_s:.3g} s"),
        (model.walk_g_per_rts, "random walk {:.3g} ug/sqrt(s)"),
        (model.quantisation_g_s, "quantisation {:.3g} ug s"),
    ]
    return ", ".join(text.format(value * 1e6) for value, text in parts if value > 0) or "none"

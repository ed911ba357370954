"""The noise that a file of position means states: a comment `noise_model`, and the covariance that follows from it.

`# noise_model: {"rate_hz": ..., "recording": ..., "sample_sd_g": [x, y, z], "parts": [{"white_g_per_rthz": [x, y, z]},
{"flicker_g": ..., "shortest_s": ..., "longest_s": ...}, {"walk_g_per_rts": ...}, {"markov_sd_g": ..., "markov_time_s": ...}]}`
contains the parts of the noise, in g, s and Hz, for the three axes. With the times (column `time_s`, the middle of each dwell)
and lengths (column `n`) of the dwells they give the covariance of all means in closed form.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.data import PositionSet
from tumblecal.ground.errors import InputError
from tumblecal.ground.units import SMALLEST_SD_G
from tumblecal.noise.dwell_fit import fit_dwells
from tumblecal.noise.parts import Dwells, Flicker, GaussMarkov, Noise, RandomWalk, White


# A stated sd this much above that of the parts belongs to a noisier dwell.
_NOISIER = 1.2
_MOST_PARTS = 64


@dataclass(frozen=True)
class RecordedNoise:
    """The noise of means over dwells of one recording.

    **Arguments:**

    - `noise`: its parts. `rate_hz`: of the samples. `sample_sd` (3): sd of a sample without its slow part, g.
    - `recording`: name that distinguishes it from other recordings.
    """

    noise: Noise
    rate_hz: float
    sample_sd: Float[np.ndarray, "3"]
    recording: str = ""

    @classmethod
    def of(
        cls, dwells: Sequence[Float[np.ndarray, "samples 3"]], rate_hz: float, whole_s: float, recording: str = ""
    ) -> "RecordedNoise":
        """The noise of a recording from the samples of its dwells, g; `whole_s` from the first dwell to the last."""
        steps = np.median([np.std(np.diff(dwell, axis=0), axis=0) for dwell in dwells], axis=0)
        return cls(fit_dwells(dwells, rate_hz, whole_s), rate_hz, steps / np.sqrt(2), recording)

    @property
    def reported(self) -> Noise:
        """The parts, with the white part from the samples, because that of the model average includes some slow noise."""
        slow = (part for part in self.noise.parts if not isinstance(part, White))
        return Noise((White(self.sample_sd / np.sqrt(self.rate_hz)), *slow))

    def text(self) -> str:
        """The text of the comment."""
        parts = [_written(part) for part in self.noise.parts]
        content = {"rate_hz": self.rate_hz, "recording": self.recording, "sample_sd_g": self.sample_sd.tolist()}
        return json.dumps({**content, "parts": parts})

    def covariance(
        self, time_s: Float[np.ndarray, " positions"], counts: Float[np.ndarray, " positions"]
    ) -> Float[np.ndarray, "3 positions positions"]:
        """Covariance of the means, g^2, from the middle of each dwell and its number of samples."""
        counts = np.maximum(np.rint(counts).astype(int), 1)
        start = time_s - (counts - 1) / 2 / self.rate_hz
        return self.noise.mean_covariance(Dwells(start, counts, 1.0 / self.rate_hz))

    def sd_of_means(
        self, time_s: Float[np.ndarray, " positions"], counts: Float[np.ndarray, " positions"]
    ) -> Float[np.ndarray, "positions 3"]:
        """Sd of each mean relative to its neighbours in time, g: without their common slow variation.

        A mean alone has the Allan deviation at the length of its dwell.
        """
        if len(counts) < 2:
            return self.noise.allan_deviation(counts / self.rate_hz)
        return np.sqrt(against_neighbours(self.covariance(time_s, counts), time_s))


def against_neighbours(
    covariance: Float[np.ndarray, "3 positions positions"], time_s: Float[np.ndarray, " positions"]
) -> Float[np.ndarray, "positions 3"]:
    """Half the variance of the difference of positions that follow each other in time, the mean of both sides."""
    order = np.argsort(time_s, kind="stable")
    local = np.zeros((len(time_s), 3))
    for axis, of_recording in enumerate(covariance):
        diagonal = np.diag(of_recording)[order]
        common = of_recording[order[1:], order[:-1]]
        steps = np.maximum(diagonal[1:] + diagonal[:-1] - 2 * common, 0.0) / 2
        sides = np.concatenate([steps[:1], steps]) + np.concatenate([steps, steps[-1:]])
        local[order, axis] = sides / 2
    return local


def recordings(data: PositionSet) -> list[tuple[Bool[np.ndarray, " positions"], RecordedNoise]]:
    """The rows of each recording of a position set that states its noise.

    **Raises:** `InputError` if a comment cannot be read.
    """
    stated = data.recorded_noise or ()
    texts = [text for text in dict.fromkeys(stated) if text]
    return [
        (np.array([of_recording == text for of_recording in stated]), read_noise(text, data.source)) for text in texts
    ]


def recorded_covariance(data: PositionSet) -> Float[np.ndarray, "3 positions positions"] | None:
    """Covariance of the means of a position set, g^2, as its recordings state it; None if none does, or if times or numbers of
    samples are missing.

    Recordings are independent of each other. If the sd column of a position is well above that of the parts (a noisier dwell),
    the difference is added. For positions of a recording without stated noise the sd columns are used.

    **Raises:** `InputError` if a comment cannot be read.
    """
    listed = recordings(data)
    if not listed or data.time_s is None or data.n is None or data.sd is None:
        return None
    total = np.array([np.diag(of_recording) for of_recording in data.sd.T**2])
    for rows, recorded in listed:
        time_s, counts = data.time_s[rows], data.n[rows]
        local, stated = recorded.sd_of_means(time_s, counts) ** 2, data.sd[rows] ** 2
        extra = np.where(stated > _NOISIER**2 * local, stated - local, 0.0)
        of_recording = recorded.covariance(time_s, counts) + np.array([np.diag(variances) for variances in extra.T])
        total[np.ix_(np.ones(3, bool), rows, rows)] = of_recording
    return total


def read_noise(text: str, source: str) -> RecordedNoise:
    """The noise of a comment.

    **Raises:** `InputError` if it does not have the form of `RecordedNoise.text`.
    """
    try:
        content = json.loads(text)
        listed, rate = content["parts"], float(content["rate_hz"])
        if not (isinstance(listed, list) and 0 < len(listed) <= _MOST_PARTS and 0 < rate < 1e6):
            raise ValueError("parts or rate_hz")
        noise, sample_sd = Noise(tuple(map(_read, listed))), _sizes(content["sample_sd_g"])
        if not any(isinstance(part, White) for part in noise.parts):
            raise ValueError("white_g_per_rthz is missing")
        return RecordedNoise(noise, rate, sample_sd, str(content.get("recording", "")))
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise InputError(
            f"{source}: comment noise_model: not a noise model ({type(error).__name__}: {str(error)[:80]}); run tumblecal "
            "reduce again, or delete the line to use the sd columns alone"
        ) from None


def _written(part) -> dict[str, object]:
    if isinstance(part, White):
        return {"white_g_per_rthz": part.N.tolist()}
    if isinstance(part, Flicker):
        return {"flicker_g": part.B.tolist(), "shortest_s": part.shortest_s, "longest_s": part.longest_s}
    if isinstance(part, RandomWalk):
        return {"walk_g_per_rts": part.K.tolist()}
    assert isinstance(part, GaussMarkov)
    return {"markov_sd_g": part.sd.tolist(), "markov_time_s": part.time_s}


def _read(part: dict) -> White | Flicker | RandomWalk | GaussMarkov:
    if "white_g_per_rthz" in part:
        white = _sizes(part["white_g_per_rthz"])
        if not np.all(white >= SMALLEST_SD_G):
            raise ValueError(f"white_g_per_rthz must be above 0, {SMALLEST_SD_G:g} or more")
        return White(white)
    if "flicker_g" in part:
        shortest, longest = _time(part["shortest_s"]), _time(part["longest_s"])
        if not shortest < longest:
            raise ValueError("shortest_s must be below longest_s")
        return Flicker(_sizes(part["flicker_g"]), shortest, longest)
    if "walk_g_per_rts" in part:
        return RandomWalk(_sizes(part["walk_g_per_rts"]))
    return GaussMarkov(_sizes(part["markov_sd_g"]), _time(part["markov_time_s"]))


def _sizes(values: object) -> Float[np.ndarray, "3"]:
    sizes = np.array(values, float)
    if sizes.shape != (3,) or not np.all((sizes >= 0) & (sizes < 1e3)):
        raise ValueError("a part has three sizes in g, 0 or above")
    return sizes


def _time(value: object) -> float:
    time = float(value)  # type: ignore[arg-type]
    if not 1e-6 < time < 1e12:
        raise ValueError("a time is in s, above 0")
    return time

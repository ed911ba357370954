"""Errors that belong to the attitude, where attitudes are repeated.

Differences of repeats (pure error) show the noise for any model of the attitude. Additional dispersion of the means of repeats
is lack of fit (Draper and Smith 1998, section 2.1). So every noise model that makes readings noisier has a twin that is no
noise and no named cause: the means follow that model, the differences the noise as assumed.
"""

from collections.abc import Sequence

import numpy as np

from tumblecal.diagnosis.causes.generic import UNEXPLAINED
from tumblecal.diagnosis.model.tangent import Tangent
from tumblecal.diagnosis.noise.models import NoiseModel
from tumblecal.diagnosis.noise.repeats import Repeats
from tumblecal.diagnosis.priors import GENERIC_WEIGHT, NOISE_WEIGHT
from tumblecal.noise.covariance import Covariance


# Size of an error of the attitude of all three axes, in noise standard deviations.
_SIZES = (0.7, 1.5, 3.0, 8.0, 30.0)
_WORDS = "the attitude (repeats of an attitude agree, so this is not noise)"


def twins(at: Tangent, repeats: Repeats, listed: Sequence[NoiseModel]) -> list[NoiseModel]:
    """Twins of some noise models as errors of the attitude, with covariances of means and differences; none without
    repeats."""
    if not repeats.share:
        return []
    share = float(np.log(repeats.share * GENERIC_WEIGHT))
    weights = repeats.weights / np.median(repeats.weights)
    sizes = np.repeat(np.bincount(repeats.attitude, weights**2)[repeats.attitude], 3)
    made = [
        NoiseModel(
            UNEXPLAINED,
            _WORDS,
            share - float(np.log(len(_SIZES))),
            Covariance(np.where(np.repeat(repeats.is_mean, 3), 1.0 + size**2 * sizes, 1.0), "rows"),
            of_means=True,
        )
        for size in _SIZES
    ]
    for model in listed:
        covariance = _of_means(model, repeats)
        if covariance is not None:
            weight = model.log_weight + share - float(np.log(NOISE_WEIGHT))
            made.append(NoiseModel(UNEXPLAINED, _WORDS, weight, covariance, tail=model.tail, of_means=True))
    return made


def _of_means(model: NoiseModel, repeats: Repeats) -> Covariance | None:
    """The covariance of means and differences; None of a model that makes no reading noisier than another, or whose readings
    are correlated in time."""
    values, form, mean = model.covariance.values, model.covariance.form, repeats.is_mean
    if form == "blocks":
        return Covariance(np.where(mean[:, None, None], values, np.eye(3)), form)
    noisier = form == "rows" and np.min(values) >= 1.0 and (np.ptp(values) > 0.0 or model.tail is not None)
    return Covariance(np.where(np.repeat(mean, 3), values, 1.0), form) if noisier else None

"""The parameters as a calibration is used: at one reference, with an uncertainty that holds what these data leave open.

The covariance of one fit is that of its noise. Here it is the mean square about the values that are written, over all
explanations that are left (Hoeting et al. 1999, Statistical Science 14, 382), and over what the temperature may do beside them:
every sensor follows it to first order, whether these data show it or not. Where something without a name is wrong, any other
effect may be there as well.
"""

from dataclasses import replace

import numpy as np

from tumblecal.diagnosis.findings.decision import Average, Weighed, averaged, explanations_left, mixed, reference_of
from tumblecal.diagnosis.findings.linear_estimate import linear_estimate
from tumblecal.diagnosis.findings.reference import at_reference
from tumblecal.diagnosis.findings.unseen import unseen_shifts
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.effects import Catalogue
from tumblecal.estimation.fit import Fit


# What every sensor has, of one size or another.
_OF_EVERY_SENSOR = ("bias_temperature.", "scale_temperature.")


def in_use(screened: Screened, entries: Catalogue, extended: Fit, sigma: float, verdict: str) -> Average:
    """Of an ambiguous verdict the mean over the explanations, else the explanation acted on; with the covariance in use.

    **Arguments:**

    - `extended`: exact fit of the explanation acted on. `sigma`: noise in units of the white rows.
    """
    at, left = screened.at, explanations_left(screened)
    added = reference_of(screened, left)
    average = averaged(screened, left, added, extended) if verdict == "ambiguous" else None
    if average is None:
        fit = at_reference(extended, at, added)
        average = mixed([Weighed(screened.best.labels, 1.0, screened.members, fit)])
    # The nominal parameters come first.
    nominal, scales = slice(at.model.nominal), at.model.scales[: at.model.nominal]
    taken = {own.labels for own in average.weighed}
    covariance, whole = average.covariance.copy(), sum(own.share for own in left if own.labels in taken) or 1.0
    covariance *= whole
    for own in left:
        told = linear_estimate(at, own.members, added) if own.labels not in taken else None
        if told is not None:
            off = told.values - average.values[nominal]
            covariance[nominal, nominal] += own.share * (told.covariance + np.outer(off, off))
            whole += own.share
    ids = [id for id in entries if verdict == "unexplained" or id.startswith(_OF_EVERY_SENSOR)]
    covariance /= whole
    others = unseen_shifts(screened, entries, extended, sigma, ids, added)
    covariance[nominal, nominal] += others.covariance * np.outer(scales, scales)
    return replace(average, covariance=covariance)

"""The parameters as a calibration is used: at one reference, with the one uncertainty that is stated of them.

The covariance of one fit is that of its noise. Here it is the mean square about the values that are written, over all
explanations that are left (Hoeting et al. 1999, Statistical Science 14, 382), each with coefficients of one size where an
effect has several (`findings.common_size`), and over the effects that were not detected, of a
size that the data themselves make probable (`findings.undetected_effects`).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.findings.common_size import with_common_size
from tumblecal.diagnosis.findings.decision import Average, Weighed, averaged, explanations_left, mixed, reference_of
from tumblecal.diagnosis.findings.linear_estimate import linear_estimate
from tumblecal.diagnosis.findings.reference import at_reference
from tumblecal.diagnosis.findings.undetected_effects import undetected_effects
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.effects import Catalogue
from tumblecal.estimation.fit import Fit


def in_use(screened: Screened, entries: Catalogue, extended: Fit, sigma: float, verdict: str) -> Average:
    """Of an ambiguous verdict the mean over the explanations, else the explanation acted on; with the covariance in use.

    **Arguments:**

    - `extended`: exact fit of the explanation acted on. `sigma`: noise in units of the white rows.
    """
    at, left = screened.at, explanations_left(screened)
    extended = with_common_size(extended, at, screened.members, sigma)
    added = reference_of(screened, left)
    average = averaged(screened, left, added, extended) if verdict == "ambiguous" else None
    if average is None:
        fit = at_reference(extended, at, added)
        average = mixed([Weighed(screened.best.labels, 1.0, screened.members, fit)])
    # The nominal parameters come first.
    nominal = slice(at.model.nominal)
    taken = {own.labels for own in average.weighed}
    covariance, whole = average.covariance.copy(), sum(own.share for own in left if own.labels in taken) or 1.0
    covariance *= whole
    for own in left:
        told = linear_estimate(at, own.members, added) if own.labels not in taken else None
        if told is not None:
            off = told.values - average.values[nominal]
            covariance[nominal, nominal] += own.share * (told.covariance + np.outer(off, off))
            whole += own.share
    covariance /= whole
    to, scale = _derivative(screened, average.names, added)
    undetected = undetected_effects(screened, entries, extended, sigma, to * scale[:, None])
    return replace(average, covariance=covariance + undetected.covariance, undetected=undetected)


def _derivative(
    screened: Screened, names: Sequence[str], added: Float[np.ndarray, "nominal full"]
) -> tuple[Float[np.ndarray, "names full"], Float[np.ndarray, " names"]]:
    """Derivative of scaled parameters at the reference by the scaled full vector, and their scales. The coefficients of an
    explanation that is not acted on do not move."""
    model, nominal = screened.at.model, screened.at.model.nominal
    columns = dict(zip(model.names, range(nominal), strict=True))
    for slot in [cause.slot for cause in screened.members]:
        columns |= dict(zip(slot.names, slot.all_columns, strict=True))
    to, scale = np.zeros((len(names), len(screened.at.vector))), np.zeros(len(names))
    for row, name in enumerate(names):
        if name in columns:
            to[row, columns[name]], scale[row] = 1.0, model.scales[columns[name]]
    to[:nominal] += added
    return to, scale

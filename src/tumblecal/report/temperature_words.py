"""Changes during a measurement in words: the temperature, and the readings within dwells."""

import numpy as np

from tumblecal.data import PositionSet
from tumblecal.data.positions import WITHIN_DWELLS
from tumblecal.effects import Catalogue
from tumblecal.estimation.fit import Fit
from tumblecal.ground.suggested_command import suggested
from tumblecal.report.sensor_terms import effects_in


# With typical coefficients such a change (degC) causes several times the noise of a good measurement.
_MUCH_DEGC = 2.0


def within_dwells_words(data: PositionSet) -> str:
    """The change within dwells that the reduction of the data states (its comment); "" where it states none."""
    return data.comments.get(WITHIN_DWELLS, "")


def temperature_words(fit: Fit, entries: Catalogue) -> str:
    """That the standard uncertainties do not include the effect of a changed temperature; "" if it hardly changed, is unknown,
    or the chain has effects of temperature."""
    degc = fit.data.temperature_degc
    if degc is None or np.ptp(degc) < _MUCH_DEGC:
        return ""
    effects = effects_in(fit.problem.chain, fit.problem.where, entries)
    if any("reference_degc" in form for effect in effects for form in effect.forms):
        return ""
    return (
        f"The temperature changed by {np.ptp(degc):.2g} degC: the standard uncertainties do not include the effect of this "
        "change on bias and scale factors. To include it, run: "
        f"{suggested('diagnose', *fit.data.as_arguments)}"
    )

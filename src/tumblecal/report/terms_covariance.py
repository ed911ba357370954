"""The covariance of matrix, bias and terms of a diagnosis' calibration together, for the uncertainty of corrected readings."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from tumblecal.data.calibration import ORDER
from tumblecal.data.calibration_terms import Term
from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.diagnosis.findings.decision import Average
from tumblecal.estimation.intrinsic import correction_slope


KEY = "covariance_with_terms"


def covariance_with_terms(used: Average, terms: Mapping[str, Term], added: Float[np.ndarray, "12 12"]) -> dict:
    """The key `KEY` of a file: the covariance of `ORDER` and of the terms' coefficients, in the order and units of the file;
    nothing without terms, or if one of them was not estimated.

    **Arguments:**

    - `used`: the parameters as written. `terms`: by the names of their coefficients. `added`: to the covariance of `ORDER`.
    """
    if not terms or not terms.keys() <= set(used.names):
        return {}
    sensor, own = [used.names.index(name) for name in SENSOR], [used.names.index(name) for name in terms]
    slope = np.zeros((len(ORDER) + len(own), len(used.names)))
    slope[: len(ORDER), sensor] = correction_slope(used.values[sensor])
    # The model counts time in seconds.
    slope[len(ORDER) + np.arange(len(own)), own] = [3600.0 if term.per_hour else 1.0 for term in terms.values()]
    covariance = slope @ used.covariance @ slope.T
    covariance[: len(ORDER), : len(ORDER)] += added
    return {KEY: {"order": [*ORDER, *terms], "covariance": covariance.tolist()}}

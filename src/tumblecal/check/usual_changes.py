"""Usual sizes and probabilities of changes of a triad after its calibration.

The sizes are the limits for repeats of the paper (section 4), from which scale mixtures are made: a change may be ten times
smaller or thirty times larger. Biases change first (mounting stress, ageing, temperature, power), then scale factors, and
angles of the input axes last (IEEE Std 1293, annex on error sources).
"""

import numpy as np

from tumblecal.data.sensor_parameters import SENSOR, leaf_of
from tumblecal.history.repeatability import PAPER_LIMITS


USUAL = np.array([PAPER_LIMITS[leaf_of(name)] for name in SENSOR])
# Standard deviations of a change over the usual size, with equal probability.
FACTORS = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
# Prior probabilities of the kinds of change, given that there is one.
BIAS, BIASES, SCALE, SCALES, ANGLE, SEVERAL, ATTITUDE = 0.40, 0.13, 0.14, 0.06, 0.07, 0.10, 0.10
# A reading of an attitude that was not at rest is in error by about this, g, times the factors.
DISTURBED_G = 1.5e-3

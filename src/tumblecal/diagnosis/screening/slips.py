"""Corrected angles compared with the angles as written.

Angles are corrected before the fit, assuming a sensor with errors of usual size. An effect of tenths of a g on whole pitch
settings may look like an error of the angles. If the data with corrected angles still contradict the model, both versions are
diagnosed, and the more probable one is used: by the sum of squares S that the exact fit of each explanation leaves of its n
readings with k coefficients, -(n log S + k log n) / 2 (Schwarz 1978), and the priors of the causes and of the set-up error.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.priors import SLIP_WEIGHT
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.diagnosis.sets.prior import log_prior
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.plausibility import Implausible
from tumblecal.estimation.setup.error import SetupError
from tumblecal.full_model.evidence import ROUNDING


# Errors that are corrected by different angles of rows.
_OF_ANGLES = ("mislabelled_setting", "settings_exchanged", "pitch_reversed", "spindle_reversed", "angles_exchanged")
_OF_ANGLES += ("index_offset", "rows_shifted")


def of_angles(mixed: Sequence[SetupError]) -> list[SetupError]:
    """The slips that gave rows other angles."""
    return [slip for slip in mixed if slip.label in _OF_ANGLES]


class Credence(NamedTuple):
    """Score of one interpretation of the angles; of two, the greater one is used.

    - `usual`: by how much (log, negative) the parameters of the fit are beyond their usual range, all together.
    - `log_posterior`: of its explanation, on a scale common to all interpretations of the angles.
    """

    usual: float
    log_posterior: float

    @classmethod
    def of(
        cls,
        screened: Screened,
        fit: Fit,
        sd: Float[np.ndarray, "positions 3"],
        implausible: Sequence[Implausible],
        slips: int,
    ) -> "Credence":
        """Score of a screen and of the exact fit of its leading explanation.

        **Arguments:**

        - `sd`: of the readings before their noise was corrected, to a factor. `implausible`: parameters of the fit.
        - `slips`: number of corrected errors.
        """
        rows = np.repeat(fit.problem.takes_part, 3)
        residuals, readings = ((np.asarray(values) / sd).ravel() for values in (fit.residuals, fit.problem.readings))
        residual_ss = max(float(np.sum(residuals[rows] ** 2)), ROUNDING * float(readings @ readings))
        # An excluded position takes as many coefficients as it has readings.
        coefficients = residuals.size - fit.dof
        prior = log_prior(screened.pool, screened.best.members) + slips * float(np.log(SLIP_WEIGHT))
        count = residuals.size
        posterior = prior - 0.5 * (count * float(np.log(residual_ss)) + coefficients * float(np.log(count)))
        usual = -sum(float(np.log(unusual.times)) for unusual in implausible)
        good = fit.code.good and not screened.contradicted
        return cls(usual if good else -np.inf, posterior)

"""An error that no entry of the catalogue explains: where it is, how large, and which closed form may describe it."""

from dataclasses import dataclass

import numpy as np

from tumblecal.diagnosis.findings.candidate_law import Law, candidate_law
from tumblecal.diagnosis.findings.excess import Excess, excess
from tumblecal.diagnosis.findings.left_over import LeftOver
from tumblecal.diagnosis.model.tangent import Tangent
from tumblecal.estimation.fit import Fit
from tumblecal.ground.showing import brief


@dataclass(frozen=True)
class Unnamed:
    """An error that no entry explains: `fit` is that of the model with the named causes, which leaves it."""

    __repr__ = brief

    fit: Fit
    law: Law | None
    excess: Excess


def unnamed(at: Tangent, fit: Fit) -> Unnamed:
    """Region of the residuals of a fit, and a candidate law for them.

    **Arguments:**

    - `at`: a linearisation near the fit.
    """
    whole, probe = LeftOver.of(fit), at.model.probe
    # The probe's first two angles turn as the spindle and the pitch axis do.
    head = at.evaluation.jacobian[:, :, probe][:, :, :2] / at.model.scales[probe][:2]
    law = candidate_law(whole, fit.problem.where, np.asarray(at.evaluation.inputs), head)
    return Unnamed(fit, law, excess(whole, fit, law))

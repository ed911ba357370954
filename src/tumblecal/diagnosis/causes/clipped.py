"""Readings that ended at their axis's range: as many coefficients as readings that are equal there to the last digit."""

import numpy as np

from tumblecal.diagnosis.causes.cause import Cause, Kind
from tumblecal.diagnosis.causes.faults import log_weights
from tumblecal.diagnosis.causes.table import CauseTable, tables_of
from tumblecal.diagnosis.priors import OUTLIER_VISIBLE
from tumblecal.effects import AXES
from tumblecal.estimation.setup.unmeasured import equal_ends
from tumblecal.full_model.tangent import Tangent


CLIPPED = Kind("clipped")
# Of readings whose numbers are coarse, equal ones are no evidence.
_LEAST_CHANCE = 0.05


def clipped(at: Tangent) -> tuple[CauseTable, ...]:
    """A candidate for each axis that has such readings where the residuals can show them. It has no part in the test: of plans
    alone nobody knows of them."""
    weight, _ = log_weights("clipping", -float(np.log(len(AXES))))
    causes = dict[int, Cause]()
    for end in equal_ends(np.asarray(at.problem.readings)):
        left, singular, right = np.linalg.svd(at.responses[:, end.rows, end.axis], full_matrices=False)
        shown = singular > OUTLIER_VISIBLE * np.max(at.whole_responses[end.rows, end.axis])
        if end.axis in causes or end.chance > _LEAST_CHANCE or not np.any(shown):
            continue
        signals = np.zeros((*at.problem.readings.shape, int(np.sum(shown))))
        signals[end.rows, end.axis] = right[shown].T
        names = ", ".join(at.problem.names[row] for row in end.rows.tolist())
        causes[end.axis] = Cause(
            CLIPPED,
            f"clipping.{AXES[end.axis]}",
            weight,
            -np.inf,
            left[:, shown],
            terms=tuple(at.problem.rows(signals).T.copy()),
            words=f"{end.size:.9g} g at positions {names}",
        )
    return tables_of(list(causes.values()), at.dof)

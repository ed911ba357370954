"""Where to linearise for an effect that jumps with an input's sign, when its signs are not those at the nominal fit.

Positions whose input is near zero change its sign as the nominal parameters move by what they absorb of the effect. At the
nominal fit such an effect may then be invisible, and what it leaves looks like faults at these positions.
"""

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.causes import Cause
from tumblecal.diagnosis.insert import fit_with
from tumblecal.diagnosis.tangent import Tangent, tangent
from tumblecal.diagnosis.tuning import LARGE


# Amplitudes are tried up to this norm of their signal (sigma).
_LARGEST = 3000.0


def kink_start(at: Tangent, members: tuple[Cause, ...], sigma: float) -> Float[np.ndarray, " full"] | None:
    """Full vector of the linear solution that leaves least with an effect that jumps beside the effects of `members`.

    **Arguments:**

    - `members`: the causes of the leading explanation, faults of single positions among them.
    - `sigma`: sd of the white rows.

    **Returns:** None where none of them explains about as much as the leading explanation.
    """
    model, leading = at.model, fit_with(at, members)
    effects = [column for cause in members for column in cause.slot.columns]
    base, start = tangent(model, at.problem, leading.vector), None
    least = leading.chi2 + LARGE * sigma**2
    for column in model.layout.jumping:
        if column in effects:
            continue
        columns = [*range(model.nominal), column, *effects]
        for vector in _between_jumps(base, column, sigma):
            there = tangent(model, at.problem, vector)
            solution, *_ = np.linalg.lstsq(there.jacobian[:, columns], there.residual, rcond=1e-10)
            left = float(np.sum((there.residual - there.jacobian[:, columns] @ solution) ** 2))
            if left < least:
                least, start = left, model.with_nominal(vector[: model.nominal])
                start[columns] += model.scales[columns] * solution
    return start


def _between_jumps(base: Tangent, column: int, sigma: float) -> list[Float[np.ndarray, " full"]]:
    """Full vectors with the effect at amplitudes between which no input changes its sign, and the nominal parameters moved by
    what they absorb of it."""
    model, jacobian = base.model, base.jacobian
    absorbed, *_ = np.linalg.lstsq(jacobian[:, : model.nominal], jacobian[:, column], rcond=None)
    way = np.zeros(len(model.scales))
    way[: model.nominal], way[column] = -model.scales[: model.nominal] * absorbed, model.scales[column]
    largest = _LARGEST * sigma / float(np.linalg.norm(jacobian[:, column]))
    moved = model.evaluate(base.problem.where, base.vector + 0.1 * largest * way).inputs
    before, slope = base.evaluation.inputs.ravel(), (moved - base.evaluation.inputs).ravel() / (0.1 * largest)
    jumps = np.divide(-before, slope, out=np.full(len(before), np.inf), where=slope != 0)
    ends = np.sort([-largest, *jumps[np.abs(jumps) < largest], largest])
    return [base.vector + amplitude * way for amplitude in (ends[1:] + ends[:-1]) / 2]

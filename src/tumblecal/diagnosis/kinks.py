"""Where to linearise for an effect that jumps with an input's sign, when its signs are not those at the nominal fit.

Positions whose input is near zero change its sign as the nominal parameters move by what they absorb of the effect. At the
nominal fit such an effect may then be invisible, and what it leaves looks like faults at these positions, or like another
error of the pitch setting at which the input is near zero everywhere.
"""

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.causes import Cause
from tumblecal.diagnosis.insert import fit_with
from tumblecal.diagnosis.tangent import Tangent, tangent, white_residual
from tumblecal.diagnosis.tuning import LARGE


# Amplitudes are tried up to this norm of their signal (sigma), pitch errors up to this (rad).
_LARGEST, _PITCH = 3000.0, 0.1
# Rounds in which signs are sought and everything is fitted; choices of signs that are fitted in each.
_ROUNDS, _CHOICES = 4, 5
# What it may leave of what seemed to be noise: a multiple of the variance.
_WHOLE = 4.0
# What a solution leaves (sigma^2) must make up for each further coefficient.
_COST = 12.0


def kink_start(at: Tangent, members: tuple[Cause, ...], sigma: float) -> Float[np.ndarray, " full"] | None:
    """Full vector of the solution that leaves least with an effect that jumps, alone or beside the effects of `members`.

    **Arguments:**

    - `members`: the causes of the leading explanation, faults of single positions among them.
    - `sigma`: sd of the white rows.

    **Returns:** None where none of them explains about as much as the leading explanation.
    """
    model, leading = at.model, fit_with(at, members)
    effects = [column for cause in members for column in cause.slot.columns]
    base, start = tangent(model, at.problem, leading.vector), None
    least = leading.chi2 + (LARGE + _COST * len(effects)) * sigma**2
    if not members:
        # What looks like noise an effect must explain whole: of several each part looks like it as well.
        least = _WHOLE * at.dof * min(sigma, at.rough_level) ** 2
    for column in model.layout.jumping:
        others = [other for other in effects if other != column]
        tried = [_by_signs(at, beside, column) for beside in ([], others)[: 1 + bool(others)]]
        if column not in effects:
            tried += [_solved(at, vector, column, effects) for vector in _between_jumps(base, column, sigma)]
        for left, vector, count in tried:
            if left + _COST * count * sigma**2 < least:
                least, start = left + _COST * count * sigma**2, vector
    return start


# What is left, a full vector, and how many coefficients of effects are in it.
_Tried = tuple[float, Float[np.ndarray, " full"], int]


def _solved(at: Tangent, vector: Float[np.ndarray, " full"], column: int, beside: list[int]) -> _Tried:
    """The linear solution around a full vector, and what is left by it."""
    model, columns = at.model, [*range(at.model.nominal), column, *beside]
    there = tangent(model, at.problem, vector)
    solution, *_ = np.linalg.lstsq(there.jacobian[:, columns], there.residual, rcond=1e-10)
    left = float(np.sum((there.residual - there.jacobian[:, columns] @ solution) ** 2))
    moved = model.with_nominal(vector[: model.nominal])
    moved[columns] += model.scales[columns] * solution
    return left, moved, 1 + len(beside)


def _by_signs(at: Tangent, beside: list[int], column: int) -> _Tried:
    """The fit with an effect that jumps, and other columns, in which the signs of one pitch setting after the other are
    sought: of all that a pitch error may make of them, those with which the effect explains most."""
    columns = [*range(at.model.nominal), *beside]
    plain = at.model.with_nominal(at.vector[: at.model.nominal])
    starts = (plain, _without_near_zero(at, plain, [*columns, column]))
    left, vector = min((_rounds(at, start, columns, column) for start in starts), key=lambda solution: solution[0])
    return left, vector, 1 + len(beside)


def _without_near_zero(
    at: Tangent, vector: Float[np.ndarray, " full"], columns: list[int]
) -> Float[np.ndarray, " full"]:
    """The linear solution without what the output of the last column's effect reads near zero: whose signs are not known."""
    there = tangent(at.model, at.problem, vector)
    own, inputs = _output(there, columns[-1]), there.evaluation.inputs
    takes_part = np.ones((len(inputs), 3))
    takes_part[:, own] = np.abs(inputs[:, own]) > _PITCH
    takes_part = np.concatenate([takes_part.ravel(), np.ones(len(there.residual) - takes_part.size)])
    solution, *_ = np.linalg.lstsq(
        there.jacobian[:, columns] * takes_part[:, None], there.residual * takes_part, rcond=1e-6
    )
    moved = vector.copy()
    moved[columns] += at.model.scales[columns] * solution
    return moved


def _rounds(
    at: Tangent, vector: Float[np.ndarray, " full"], columns: list[int], column: int
) -> tuple[float, Float[np.ndarray, " full"]]:
    """What is left, and the full vector, of fits from one start, each with the signs that let the effect explain most."""
    model, problem, least = at.model, at.problem, np.inf
    for _ in range(_ROUNDS):
        there = tangent(model, problem, vector)
        signals = _signals(there, column)
        basis, _ = np.linalg.qr(there.jacobian[:, columns])
        residual = there.residual - basis @ (basis.T @ there.residual)
        apart = signals - basis @ (basis.T @ signals)
        explained = (apart.T @ residual) ** 2 / np.maximum(np.sum(apart**2, axis=0), 1e-12 * np.sum(signals**2, axis=0))
        before = least
        for choice in np.argsort(-explained)[:_CHOICES]:
            rows = np.column_stack([there.jacobian[:, columns], signals[:, choice]])
            solution, *_ = np.linalg.lstsq(rows, there.residual, rcond=1e-10)
            moved = model.with_nominal(there.vector[: model.nominal])
            moved[[*columns, column]] += model.scales[[*columns, column]] * solution
            residual = white_residual(problem, moved, model.predict(problem.where, moved))
            if residual @ residual < least:
                least, vector = float(residual @ residual), moved
        if least == before:
            break
    return least, vector


def _output(there: Tangent, column: int) -> int:
    """The output on which an effect acts."""
    return int(np.argmax(np.sum(np.abs(there.evaluation.jacobian[:, :, column]), axis=0)))


def _signals(there: Tangent, column: int) -> Float[np.ndarray, "rows choices"]:
    """White rows of an effect that jumps, by its scaled coefficient: as it is, and with the signs that each pitch error makes
    between two changes of the sign of an input."""
    model, raw = there.model, there.evaluation.jacobian
    own = _output(there, column)
    inputs, size = there.evaluation.inputs[:, own], np.max(np.abs(raw[:, own, column]))
    signs = [np.sign(inputs)]
    for number in (k for k, name in enumerate(model.names) if name.startswith("dbeta")):
        slope = raw[:, own, number] / model.scales[number]
        crossing = np.divide(-inputs, slope, out=np.full(len(inputs), np.inf), where=np.abs(slope) > 0.1)
        ends = np.sort([-_PITCH, *crossing[np.abs(crossing) < _PITCH], _PITCH])
        signs += [np.sign(inputs + slope * middle) for middle in (ends[1:] + ends[:-1]) / 2]
    choices = np.unique(np.array(signs), axis=0)
    signals = np.zeros((*raw.shape[:2], len(choices)))
    signals[:, own] = size * choices.T
    rows = there.problem.rows(signals)
    return np.concatenate([rows, np.zeros((len(there.residual) - len(rows), len(choices)))])


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

"""Linearisation for an effect that jumps with the sign of an input, if its signs differ from those at the nominal fit.

Positions whose input is near zero change its sign as the nominal parameters move by what they absorb of the effect. At the
nominal fit such an effect may then be invisible. Its residuals look like faults at these positions, or like a different error
of the pitch setting at which the input is near zero everywhere.
"""

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.causes.cause import Cause
from tumblecal.diagnosis.causes.effects import SeenEffects, seen_effects
from tumblecal.diagnosis.exact.insert import fit_with, linear_solution
from tumblecal.diagnosis.exact.jump_pairs import pairs_with_a_jump
from tumblecal.diagnosis.exact.signs import NEAR_ZERO, jump_signals, left_with, output_of, sign_choices
from tumblecal.diagnosis.model.tangent import Tangent, tangent, white_residual
from tumblecal.diagnosis.tuning import CONTRADICTED, LARGE
from tumblecal.noise.covariance import Covariance


# Amplitudes are tried up to this norm of their signal (sigma).
_LARGEST = 3000.0
# An input with a fixed sign is at this distance (g) from zero, pulled there by so much (1/g).
_BESIDE, _HELD = 1e-6, 1e8
# The linearised residual sum of squares may be in error by this share of its excess over the noise, for effects as large as
# the inputs.
_HOPELESS = 0.25
# Rounds in which signs are sought and everything is fitted; choices of signs that are fitted in each.
_ROUNDS, _CHOICES = 4, 5
# Effects that are tried together with it, leading or not, from each start.
_PAIRS = 2
# Amplitudes at which a small effect is fitted.
_AMPLITUDES = 8
# Times the sd of a position that a fit does without.
_LEFT_OUT = 1e4
# What it may leave of what seemed to be noise: a multiple of the variance.
_WHOLE = 4.0
# What a solution leaves (sigma^2) must make up for each further coefficient.
_COST = 12.0


def kink_start(
    at: Tangent, members: tuple[Cause, ...], sigma: float, leads: tuple[Cause, ...] = ()
) -> Float[np.ndarray, " full"] | None:
    """Full vector of the solution with the smallest residual for an effect that jumps, alone or with the effects of `members`.

    **Arguments:**

    - `members`: the causes of the leading explanation, faults of single positions among them.
    - `sigma`: sd of the white rows.
    - `leads`: the causes of the leading explanation, if it differs from `members`.

    **Returns:** None if none of them explains about as much as the leading explanation.
    """
    model, leading = at.model, fit_with(at, members)
    effects = [list(cause.slot.columns) for cause in members if cause.slot.columns]
    columns = [column for own in effects for column in own]
    base, start = tangent(model, at.problem, leading.vector), None
    noise, beyond = at.dof * sigma**2, _beyond_noise(at, sigma)
    astray = _HOPELESS * beyond
    # What no entry describes may have taken up much of the noise as well.
    least = max(leading.chi2, noise) + (LARGE + _COST * len(columns)) * sigma**2
    if not members:
        # What looks like noise an effect must explain whole: of several each part looks like it as well.
        least = _WHOLE * at.dof * min(sigma, at.rough_level) ** 2
    # Only a large effect moves the nominal parameters so far that many signs are wrong; unknown attitudes follow any.
    large = not model.hand_held and at.much_more_than(sigma)
    # The nominal fit of something large may be far off: the instrument without errors may be nearer.
    plain = model.with_nominal(at.vector[: model.nominal])
    starts = [tangent(model, at.problem, vector) for vector in (plain, model.start)] if large else []
    seen = [seen_effects(there) for there in starts]
    slopes = cache(lambda column: _slope(starts[0], column))
    if leads:
        least = min(least, fit_with(at, leads).chi2 + LARGE * sigma**2 + astray)
    for column in model.layout.jumping:
        others, tried = [own for own in effects if column not in own], []
        if large:
            # Each further effect may only compensate wrong signs.
            beside = [[], *others, [other for own in others for other in own]]
            beside += _likeliest(starts, seen, column, noise + LARGE * sigma**2 + CONTRADICTED * beyond)
            tried = [
                _by_signs(starts, own, column, slopes, least + astray)
                for k, own in enumerate(beside)
                if own not in beside[:k]
            ]
        if large and column in columns:
            tried += [_turned(base, columns, column, positions, slopes) for positions in _faulty(members)]
        if others == effects:
            vectors = _between_jumps(base, column, columns, sigma, least + astray if large else None)
            tried += [_solved(at, vector, column, columns) for vector in vectors]
        for left, vector, count in tried:
            if left + _COST * count * sigma**2 < least:
                least, start = left + _COST * count * sigma**2, vector
    return start


def most_left(at: Tangent, sigma: float) -> float:
    """The sum of squares that something with a jump may leave where not all signs are the right ones yet."""
    return at.dof * sigma**2 + _HOPELESS * _beyond_noise(at, sigma)


def _beyond_noise(at: Tangent, sigma: float) -> float:
    """The sum of squares in excess of the noise."""
    return max(float(at.z @ at.z) - at.dof * sigma**2, 0.0)


def without_faults(at: Tangent, faults: Sequence[Cause]) -> Tangent:
    """The problem with faults of single positions undone, linearised at the same point; positions that a fit does without
    count for next to nothing."""
    problem = at.problem
    for fault in faults:
        problem = fault.undone(problem)
    if not np.all(problem.takes_part):
        times = np.where(problem.takes_part, 1.0, _LEFT_OUT)
        noise = problem.noise.compounded(Covariance(np.repeat(times**2, 3), "rows"))
        problem = problem.with_noise(noise, known=problem.known, sd=problem.sd * times[:, None])
    return tangent(at.model, problem, at.vector)


def turns_a_sign(at: Tangent, effects: Sequence[Cause]) -> bool:
    """Whether an input changes its sign between the linearised problem and the linear solution with some effects. If none
    does, an effect that jumps with it is the same for the exact fit and for the screen."""
    solution = linear_solution(at, effects)
    inputs = at.model.evaluate(at.problem.where, solution).inputs
    return bool(np.any(np.sign(inputs) != np.sign(at.evaluation.inputs)))


# How the inputs turn with each column, worked out where it is asked for.
_Slopes = Callable[[int], Float[np.ndarray, "positions 3"]]
# Residual sum of squares, full vector, and the number of effect coefficients in it.
_Tried = tuple[float, Float[np.ndarray, " full"], int]


def _solved(at: Tangent, vector: Float[np.ndarray, " full"], column: int, beside: list[int]) -> _Tried:
    """The linear solution around a full vector, and its residual sum of squares."""
    model, columns = at.model, [*range(at.model.nominal), column, *beside]
    there = tangent(model, at.problem, vector)
    solution, *_ = np.linalg.lstsq(there.jacobian[:, columns], there.residual, rcond=1e-10)
    left = float(np.sum((there.residual - there.jacobian[:, columns] @ solution) ** 2))
    moved = model.with_nominal(vector[: model.nominal])
    moved[columns] += model.scales[columns] * solution
    return left, moved, 1 + len(beside)


def _by_signs(starts: Sequence[Tangent], beside: list[int], column: int, slopes: _Slopes, hopeless: float) -> _Tried:
    """The fit with an effect that jumps, and other columns, in which the signs of one pitch setting after the other are
    sought, from each start and from the first without what is near zero: of all that small errors may make of them, those
    with which the effect explains most."""
    columns = [*range(starts[0].model.nominal), *beside]
    tried = [*starts, _without_near_zero(starts[0], [*columns, column])]
    left, vector = min(
        (_rounds(start, columns, column, slopes, hopeless) for start in tried), key=lambda solution: solution[0]
    )
    return left, vector, 1 + len(beside)


def _likeliest(starts: Sequence[Tangent], seen: Sequence[SeenEffects], column: int, hopeless: float) -> list[list[int]]:
    """Columns of the effects that explain most, given one that jumps."""
    slots, chosen = starts[0].model.layout.slots, dict[int, None]()
    for start, effects in zip(starts, seen, strict=True):
        left, numbers = pairs_with_a_jump(start, effects, column)
        chosen |= dict.fromkeys(numbers[:_PAIRS][left[:_PAIRS] < hopeless].tolist())
    return [list(slots[number].columns) for number in chosen]


def _faulty(members: tuple[Cause, ...]) -> list[tuple[int, ...]]:
    """Positions of the faults among some causes: all of them, and those of each."""
    each = [cause.positions for cause in members if cause.positions]
    return list(dict.fromkeys([tuple(k for own in each for k in own), *each])) if each else []


def _turned(base: Tangent, effects: list[int], column: int, positions: tuple[int, ...], slopes: _Slopes) -> _Tried:
    """The fit with the signs of some positions turned: an input on the wrong side of zero looks like a fault there."""
    columns = [*range(base.model.nominal), *(own for own in effects if own != column)]
    signs = np.sign(base.evaluation.inputs[:, output_of(base, column)])
    signs[list(positions)] *= -1.0
    moved = base.model.with_nominal(base.vector[: base.model.nominal])
    solution = _with_signs(base, columns, column, signs, slopes)
    moved[[*columns, column]] += base.model.scales[[*columns, column]] * solution
    return _left(base, moved), moved, len(effects)


def _without_near_zero(there: Tangent, columns: list[int]) -> Tangent:
    """The problem linearised at the solution without what the output of the last column's effect reads near zero: whose signs
    are not known."""
    own, inputs = output_of(there, columns[-1]), there.evaluation.inputs
    takes_part = np.ones((len(inputs), 3))
    takes_part[:, own] = np.abs(inputs[:, own]) > NEAR_ZERO
    takes_part = np.concatenate([takes_part.ravel(), np.ones(len(there.residual) - takes_part.size)])
    solution, *_ = np.linalg.lstsq(
        there.jacobian[:, columns] * takes_part[:, None], there.residual * takes_part, rcond=1e-6
    )
    moved = there.vector.copy()
    moved[columns] += there.model.scales[columns] * solution
    return tangent(there.model, there.problem, moved)


def _rounds(
    there: Tangent, columns: list[int], column: int, slopes: _Slopes, hopeless: float
) -> tuple[float, Float[np.ndarray, " full"]]:
    """Residual sum of squares and full vector of fits from one start, each with the signs with which the effect explains most.
    Nothing is fitted if the linearised model leaves more than `hopeless`."""
    model, vector, least = there.model, there.vector, np.inf
    for number in range(_ROUNDS):
        there = tangent(model, there.problem, vector) if number else there
        signs = sign_choices(there, column)
        by_signs, before = left_with(there, there.jacobian[:, columns], column, signs), least
        if np.min(by_signs) > hopeless:
            break
        for choice in np.argsort(by_signs)[:_CHOICES]:
            moved = model.with_nominal(there.vector[: model.nominal])
            moved[[*columns, column]] += model.scales[[*columns, column]] * _with_signs(
                there, columns, column, signs[choice], slopes
            )
            left = _left(there, moved)
            if left < least:
                least, vector = left, moved
        if least == before:
            break
    return least, vector


def _with_signs(
    there: Tangent, columns: list[int], column: int, signs: Float[np.ndarray, " positions"], slopes: _Slopes
) -> Float[np.ndarray, " solved"]:
    """The linear solution by some columns and an effect that jumps with these signs, held where an input would have another."""
    own = output_of(there, column)
    inputs, turned = there.evaluation.inputs[:, own], np.stack([slopes(k)[:, own] for k in columns], axis=1)
    turned = np.column_stack([turned, np.zeros(len(inputs))])
    rows = np.column_stack([there.jacobian[:, columns], jump_signals(there, column, signs[None])])
    held = np.zeros(len(inputs), bool)
    while True:
        pulled = np.concatenate([rows, _HELD * turned[held]])
        wanted = np.concatenate([there.residual, _HELD * (signs * _BESIDE - inputs)[held]])
        solution, *_ = np.linalg.lstsq(pulled, wanted, rcond=1e-12)
        astray = ~held & (signs * (inputs + turned @ solution) < 0)
        if not np.any(astray):
            return solution
        held |= astray


def _slope(there: Tangent, column: int) -> Float[np.ndarray, "positions 3"]:
    """How the inputs turn with a scaled column."""
    step, moved = 1e-3, there.vector.copy()
    moved[column] += step * there.model.scales[column]
    return (there.model.evaluate(there.problem.where, moved).inputs - there.evaluation.inputs) / step


def _left(at: Tangent, vector: Float[np.ndarray, " full"]) -> float:
    """The sum of squares that a full vector leaves; endless where the model cannot be evaluated there."""
    residual = white_residual(at.problem, vector, at.model.predict(at.problem.where, vector))
    with np.errstate(over="ignore", invalid="ignore"):
        left = float(residual @ residual)
    return left if np.isfinite(left) else np.inf


def _between_jumps(
    base: Tangent, column: int, beside: list[int], sigma: float, hopeless: float | None
) -> list[Float[np.ndarray, " full"]]:
    """Full vectors with the effect at amplitudes between which no input changes its sign, and the nominal parameters moved by
    what they absorb of it: those whose linear solution with the signs there leaves no more than is `hopeless`, or, where
    nothing is said of that, the `_AMPLITUDES` that leave least."""
    model, jacobian = base.model, base.jacobian
    absorbed, *_ = np.linalg.lstsq(jacobian[:, : model.nominal], jacobian[:, column], rcond=None)
    way = np.zeros(len(model.scales))
    way[: model.nominal], way[column] = -model.scales[: model.nominal] * absorbed, model.scales[column]
    largest = _LARGEST * sigma / float(np.linalg.norm(jacobian[:, column]))
    moved = model.evaluate(base.problem.where, base.vector + 0.1 * largest * way).inputs
    before, slope = base.evaluation.inputs, (moved - base.evaluation.inputs) / (0.1 * largest)
    jumps = np.divide(-before, slope, out=np.full(before.shape, np.inf), where=slope != 0).ravel()
    ends = np.sort([-largest, *jumps[np.abs(jumps) < largest], largest])
    amplitudes, own = (ends[1:] + ends[:-1]) / 2, output_of(base, column)
    signs = np.sign(before[:, own] + amplitudes[:, None] * slope[:, own])
    left = left_with(base, jacobian[:, [*range(model.nominal), *beside]], column, signs)
    tried = np.sort(np.argsort(left, kind="stable")[:_AMPLITUDES]) if hopeless is None else left <= hopeless
    return [base.vector + amplitude * way for amplitude in amplitudes[tried]]

"""All candidates of one data set."""

import numpy as np
from jaxtyping import Float

from tumblecal.chain import Where
from tumblecal.diagnosis import generic, gross
from tumblecal.diagnosis.candidates import Candidate, Pool, Visibility, effect_candidates
from tumblecal.diagnosis.linear import Linear, Weighting
from tumblecal.diagnosis.model import Model


def pooled(
    model: Model,
    linear: Linear,
    where: Where,
    readings: Float[np.ndarray, "positions 3"],
    names: tuple[str, ...],
    how: Weighting,
    scale: float,
    kept: tuple[int, ...] | None = None,
) -> tuple[Pool, list[Visibility], tuple[int, ...]]:
    """Effects of the catalogue, faults of single positions, and generic terms.

    **Arguments:**

    - `scale`: noise in weighted units; faults smaller than a few of it are no candidates.
    - `kept`: numbers of the generic terms to be taken; chosen here where left out.

    **Returns:** the pool, what is visible of every effect, and the generic terms' numbers.
    """
    effects, seen = effect_candidates(model, linear)
    each = gross.responses(linear, how, len(names))
    terms, kept = generic.candidates(model, linear, how, where, effects, kept)
    candidates: list[Candidate] = [
        *effects,
        *gross.outliers(each, how, names),
        *([] if model.hand_held else gross.swaps(each, readings, where, names, scale)),
        *([] if model.hand_held else gross.mislabels(model, linear, each, where, names, scale)),
        *terms,
    ]
    return Pool(tuple(candidates), linear.dof), seen, kept


def scaled(pool: Pool, sigma: float) -> Pool:
    """The pool for residuals counted in units of sigma."""
    if sigma == 1.0:
        return pool
    members = (one if one.offset is None else one._replace(offset=one.offset / sigma) for one in pool.candidates)
    return Pool(tuple(members), pool.dof)

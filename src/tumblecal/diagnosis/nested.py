"""Prediction of data that took no part, neither in the fit nor in the choice of causes.

For every fold the search for causes is repeated without it, on the linearised chain: the fold's readings are given free
values, which is the same as leaving them out. What was chosen is then fitted to the rest and predicts the fold. A gain
found so is that of the whole procedure, not of a lucky choice.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.candidates import Candidate, Pool
from tumblecal.diagnosis.gain import fold_errors
from tumblecal.diagnosis.linear import Linear, Weighting, unreachable
from tumblecal.diagnosis.search import COLLINEAR, Search


# A direction of the residual space that a fold takes with it.
_TAKEN = 1e-6


def nested_left_out(
    linear: Linear, pool: Pool, how: Weighting, groups: Int[np.ndarray, " positions"], sure: tuple[int, ...]
) -> tuple[Float[np.ndarray, "positions 3"], Bool[np.ndarray, " folds"]]:
    """Prediction errors of every fold, the causes chosen without it.

    **Arguments:**

    - `linear`, `pool`: linearisation and candidates of all data.
    - `how`: weights. `groups`: the fold of each position, -1: in every fit.
    - `sure`: the set chosen with all data.

    **Returns:** measured minus predicted, g (0 for the group -1), and for each fold whether it chose that same set.
    """
    names = {pool.candidates[k].label for k in sure}
    errors, same = np.zeros(how.weights.size), []
    rows_of = np.repeat(groups, 3)
    for fold in np.unique(groups[groups >= 0]):
        rows = np.flatnonzero(rows_of == fold)
        chosen = _chosen_without(rows, linear, pool, how.known)
        same.append({one.label for one in chosen} == names)
        errors[rows] = _predicted(rows, linear, chosen)
    return errors.reshape(-1, 3) / how.weights, np.array(same, bool)


def _chosen_without(rows: np.ndarray, linear: Linear, pool: Pool, known: bool) -> list[Candidate]:
    """The best set of causes when some rows have free values of their own."""
    left, singular, _ = np.linalg.svd(linear.basis[rows].T, full_matrices=False)
    beside, _ = unreachable(left[:, singular > _TAKEN])
    ranked = Search(_seen_in(pool, beside), beside.T @ linear.z, known).run()
    return [pool.candidates[k] for k in ranked.set_at(0)]


def _seen_in(pool: Pool, beside: Float[np.ndarray, "nu left"]) -> Pool:
    """The candidates in a part of the residual space."""
    rest, offsets = beside.T @ pool.stacked, beside.T @ pool.offsets
    sizes = np.linalg.norm(rest, axis=0)
    candidates = list(pool.candidates)
    for rank, (indices, columns) in pool.by_rank.items():
        for k, own in zip(indices.tolist(), columns.tolist(), strict=True):
            if rank == 1:
                block = rest[:, own] / sizes[own] if sizes[own[0]] ** 2 > COLLINEAR else rest[:, :0]
            else:
                left, singular, _ = np.linalg.svd(rest[:, own], full_matrices=False)
                block = left[:, singular**2 > COLLINEAR]
            candidates[k] = candidates[k]._replace(block=block)
    for place, k in enumerate(pool.faults.tolist()):
        candidates[k] = candidates[k]._replace(offset=offsets[:, place])
    return Pool(tuple(candidates), beside.shape[1])


def _predicted(rows: np.ndarray, linear: Linear, chosen: list[Candidate]) -> np.ndarray:
    """Weighted errors in some rows of the fit of the chosen causes to the other rows."""
    residual = linear.residual.copy()
    columns = [linear.reached]
    for one in chosen:
        if one.offset is not None:
            residual -= linear.basis @ one.offset
        elif one.block is not None:
            # What the nominal model absorbs of a cause needs no column: only its part in the residual space counts.
            columns.append(linear.basis @ one.block)
    left, singular, _ = np.linalg.svd(np.hstack(columns), full_matrices=False)
    q = left[:, singular > _TAKEN * singular[0]]
    return fold_errors(q[rows], (residual - q @ (q.T @ residual))[rows])

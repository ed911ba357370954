"""What changes for good at some position: a bias that jumps, a mount that slips. Their words stand in effects/procedure.py."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.causes import NO_SLOT, Cause
from tumblecal.diagnosis.fault_causes import log_weights, told_at
from tumblecal.diagnosis.tangent import Tangent
from tumblecal.diagnosis.tuning import LEAST_VISIBLE_TERM
from tumblecal.effects import AXES, Effect
from tumblecal.estimation.problem import Problem


class Jump(NamedTuple):
    """Signals that begin at one position of the measuring order, with coefficients of their own."""

    label: str
    log_weight: float
    log_test_weight: float
    block: Float[np.ndarray, "nu rank"] | None
    terms: tuple[Float[np.ndarray, " rows"], ...]
    words: str

    offset = None
    slot = NO_SLOT
    directions = None
    positions = ()
    left_out = ()
    family = None
    named = True

    def undone(self, problem: Problem) -> Problem:
        """The same problem: the jump is fitted."""
        return problem

    def told(self, entry: Effect | None, sizes: str) -> str:
        """From where on, what it is and what to do."""
        return told_at(self, entry)


def jumps(at: Tangent, level: float) -> list[Cause]:
    """Candidates from each position on: another bias of one axis; another mount angle, until the triad is remounted."""
    names, where = at.problem.names, at.problem.where
    order = np.argsort(where.measuring_order, kind="stable")
    rank = np.argsort(order, kind="stable")
    after = rank >= np.arange(1, len(names))[:, None]
    causes: list[Cause] = []
    biases = [np.broadcast_to(unit[:, None], (len(names), 3, 1)) for unit in np.eye(3)]
    for unit, axis in zip(biases, AXES, strict=True):
        causes += _beginning(at, "bias_jump", unit, after, order, f"{axis} axis", len(AXES))
    mount, mounting = _mount_angles(at), np.asarray(where.index("mount"))
    if mount is not None:
        causes += _beginning(at, "mount_slip", mount, after & (mounting == mounting[order[1:], None]), order, "", 1)
    return causes


def _mount_angles(at: Tangent) -> Float[np.ndarray, "positions 3 3"] | None:
    """What the mount's three angles do to every position, g; None where they are not all free."""
    leaves = [name.partition("@")[0] for name in at.model.names]
    columns = [[k for k, name in enumerate(leaves) if name == f"dtheta_{axis}"] for axis in AXES]
    if not all(columns):
        return None
    return np.stack([at.evaluation.jacobian[:, :, own].sum(axis=2) for own in columns], axis=2)


def _beginning(
    at: Tangent,
    id: str,
    signal: Float[np.ndarray, "positions 3 terms"],
    after: Bool[np.ndarray, "begins positions"],
    order: Int[np.ndarray, " positions"],
    words: str,
    kinds: int,
) -> list[Cause]:
    """The candidates of one kind, where the residuals can show all of a jump; each begins at the next of `order`."""
    begins, terms = len(after), signal.shape[2]
    signals = after.T[:, None, :, None] * signal[:, :, None, :]
    rows = at.problem.rows(signals.reshape(len(signal), 3, -1))
    projected = (at.basis[: len(rows)].T @ rows).reshape(-1, begins, terms).swapaxes(0, 1)
    values, vectors = np.linalg.eigh(projected.swapaxes(1, 2) @ projected)
    sizes = np.sqrt(np.maximum(values, 0.0))
    rows = rows.reshape(len(rows), begins, terms)
    shown = sizes[:, 0] > np.maximum(LEAST_VISIBLE_TERM * np.linalg.norm(rows, axis=(0, 2)), 1e-12)
    blocks = projected[shown] @ (vectors[shown] / sizes[shown][:, None, :])
    weights, names = log_weights(id, -float(np.log(kinds * begins))), at.problem.names
    return [
        Jump(f"{id}:{names[order[k + 1]]}", *weights, block, tuple(rows[:, k].T.copy()), words)
        for block, k in zip(blocks, np.flatnonzero(shown).tolist(), strict=True)
    ]

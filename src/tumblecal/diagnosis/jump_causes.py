"""What changes for good at some position: a bias that jumps, a mount that slips. Their words stand in effects/procedure.py."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.cause_table import CauseTable, alike
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


def jumps(at: Tangent) -> list[CauseTable]:
    """Candidates from each position on: another bias of one axis; another mount angle, until the triad is remounted."""
    where = at.problem.where
    order = np.argsort(where.measuring_order, kind="stable")
    rank = np.argsort(order, kind="stable")
    after = rank >= np.arange(1, len(order))[:, None]
    biases = np.broadcast_to(np.eye(3)[:, :, None], (len(order), 3, 3, 1))
    tables = [_beginning(at, "bias_jump", biases, after, order, tuple(f"{axis} axis" for axis in AXES))]
    mount, mounting = _mount_angles(at), np.asarray(where.index("mount"))
    if mount is not None:
        same = mounting == mounting[order[1:], None]
        tables.append(_beginning(at, "mount_slip", mount[:, :, None], after & same, order, ("",)))
    return tables


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
    signals: Float[np.ndarray, "positions 3 kinds terms"],
    after: Bool[np.ndarray, "begins positions"],
    order: Int[np.ndarray, " positions"],
    words: tuple[str, ...],
) -> CauseTable:
    """The candidates of some kinds with these words, where the residuals can show all of a jump; each begins at the next
    of `order`."""
    begins, (*_, kinds, terms) = len(after), signals.shape
    signals = after.T[:, None, None, :, None] * signals[:, :, :, None, :]
    rows = at.problem.rows(signals.reshape(len(signals), 3, -1))
    projected = (at.basis[: len(rows)].T @ rows).reshape(-1, kinds * begins, terms).swapaxes(0, 1)
    values, vectors = np.linalg.eigh(projected.swapaxes(1, 2) @ projected)
    sizes = np.sqrt(np.maximum(values, 0.0))
    rows = rows.reshape(len(rows), kinds * begins, terms)
    wholes = np.sqrt(np.sum(rows**2, axis=(0, 2)))
    shown = np.flatnonzero(sizes[:, 0] > np.maximum(LEAST_VISIBLE_TERM * wholes, 1e-12))
    blocks = projected[shown] @ (vectors[shown] / sizes[shown][:, None, :])
    numbers, names = shown.tolist(), at.problem.names
    first = [names[k] for k in order[1 + shown % begins].tolist()]

    def made(k: int, label: str, weights: tuple[float, float], block: np.ndarray) -> Cause:
        return Jump(label, *weights, block, tuple(rows[:, numbers[k]].T.copy()), words[numbers[k] // begins])

    blocks, owners = blocks.swapaxes(1, 2).reshape(-1, at.dof), np.repeat(np.arange(len(shown)), terms)
    weights = log_weights(id, -float(np.log(kinds * begins)))
    return alike(Jump, [f"{id}:{name}" for name in first], weights, blocks, owners, made)

"""Permanent changes at some position: a bias that jumps, a mount that slips. Their descriptions are in
effects/procedure.py."""

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.causes.cause import Cause, Kind
from tumblecal.diagnosis.causes.faults import log_weights
from tumblecal.diagnosis.causes.table import CauseTable, equally_weighted
from tumblecal.diagnosis.priors import LEAST_VISIBLE_TERM
from tumblecal.effects import AXES
from tumblecal.full_model.tangent import Tangent


# Ids of the kinds.
JUMPS = ("bias_jump", "mount_slip")


# Signals that begin at one position of the measuring order, with coefficients of their own.
JUMP = Kind("jump")


def jumps(at: Tangent) -> list[CauseTable]:
    """Candidates from each position on: another bias of one axis; another mount angle, until the triad is remounted."""
    where = at.problem.where
    order = np.argsort(where.measuring_order, kind="stable")
    rank = np.argsort(order, kind="stable")
    after = rank >= np.arange(1, len(order))[:, None]
    biases = np.broadcast_to(np.eye(3)[:, :, None], (len(order), 3, 3, 1))
    each = tuple((f"{axis} axis", (f"bias_{axis}",)) for axis in AXES)
    tables = [_beginning(at, JUMPS[0], biases, after, order, each)]
    mount, mounting = _mount_angles(at), np.asarray(where.index("mount"))
    if mount is not None:
        same = mounting == mounting[order[1:], None]
        angles = ("", tuple(f"dtheta_{axis}" for axis in AXES))
        tables.append(_beginning(at, JUMPS[1], mount[:, :, None], after & same, order, (angles,)))
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
    told: tuple[tuple[str, tuple[str, ...]], ...],
) -> CauseTable:
    """The candidates of some kinds, where the residuals can show all of a jump; each begins at the next of `order`. `told`: of
    each kind its words, and the nominal parameters that jump."""
    begins, (count, _, kinds, terms) = len(after), signals.shape
    each = signals.reshape(count, 3, -1).mT @ at.responses.transpose(1, 2, 0)
    projected = (after.astype(float) @ each.reshape(count, -1)).reshape(begins, kinds, terms, at.dof)
    projected = projected.swapaxes(0, 1).reshape(kinds * begins, terms, at.dof)
    if terms == 1:
        values, vectors = np.vecdot(projected, projected), np.ones((len(projected), 1, 1))
    else:
        values, vectors = np.linalg.eigh(projected @ projected.mT)
    sizes = np.sqrt(np.maximum(values, 0.0))

    def rows(kind: int, begin: int) -> Float[np.ndarray, "rows terms"]:
        return at.problem.rows(after[begin, :, None, None] * signals[:, :, kind])

    if at.problem.correlated:
        wholes = np.array([np.linalg.norm(rows(kind, begin)) for kind in range(kinds) for begin in range(begins)])
    else:
        squares = ((signals * at.whole_responses[:, :, None, None]) ** 2).sum(axis=(1, 3))
        wholes = np.sqrt(after @ squares).T.ravel()
    shown = np.flatnonzero(sizes[:, 0] > np.maximum(LEAST_VISIBLE_TERM * wholes, 1e-12))
    blocks = vectors[shown].mT @ projected[shown] / sizes[shown][:, :, None]
    kind, begin = (own.tolist() for own in np.divmod(shown, begins))
    names, start = at.problem.names, order[1:].tolist()

    def made(k: int, label: str, weights: tuple[float, float], block: np.ndarray) -> Cause:
        terms = tuple(rows(kind[k], begin[k]).T.copy())
        words, lasting = told[kind[k]]
        return Cause(JUMP, label, *weights, block, terms=terms, lasting=lasting, words=words)

    blocks, owners = blocks.reshape(-1, at.dof), np.repeat(np.arange(len(shown)), terms)
    weights = log_weights(id, -float(np.log(kinds * begins)))
    return equally_weighted(JUMP, [f"{id}:{names[start[k]]}" for k in begin], weights, blocks, owners, made)

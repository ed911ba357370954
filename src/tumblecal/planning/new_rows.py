"""Weighted Jacobian rows of positions that are not measured yet, from the model that is compiled for the data.

New positions are evaluated in blocks of the shape of the data, so nothing is compiled. A parameter of a new group (dbeta of a
new pitch setting) has additional columns: its derivative is that of the group it is evaluated with.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from tumblecal.chain import Link, Parameter, parameters_of
from tumblecal.chain.nominal import Mount
from tumblecal.chain.where import VISITS
from tumblecal.diagnosis import Diagnosis
from tumblecal.estimation.chain_programs import Evaluation
from tumblecal.estimation.mountings import turn_of
from tumblecal.estimation.problem import Problem
from tumblecal.full_model.full_model import FullModel
from tumblecal.full_model.tangent import white_rows
from tumblecal.ground.frames import rotation_angles, rotation_matrix
from tumblecal.planning.conditions import Conditions, continued
from tumblecal.planning.proposals import SIDES, Proposal


# Pitch angles closer than this (rad) are one setting.
_SAME_ANGLE = 1e-6
# New positions determine a parameter of a new group if its singular value exceeds this share of the largest.
_SEEN = 0.02
# Coefficients of effects are within so many of their scales, time constants within one of their value: a coefficient that the
# data do not determine predicts nothing larger. (benchmarks/blind next)
_USUAL = 10.0


@dataclass(frozen=True)
class Rows:
    """Rows in units of the noise; columns: the model's full vector (scaled), then parameters that only new groups or permanent
    changes have, `own` of them.

    `old`: rows of the data, priors' rows last; `shown`: measured minus the model without effects. `new` (cells, 3, columns): of
    each new position; `expected` (cells, 3): its readings by the model without effects; `cells` gives those of each
    proposal. `prior`: information on the parameter of each column. `weight` (3): units of the noise per g.
    """

    old: Float[np.ndarray, "rows columns"]
    shown: Float[np.ndarray, " rows"]
    new: Float[np.ndarray, "cells 3 columns"]
    expected: Float[np.ndarray, "cells 3"]
    cells: list[np.ndarray]
    prior: Float[np.ndarray, " columns"]
    own: int
    weight: Float[np.ndarray, " 3"]

    def of_new_groups(self, cells: np.ndarray) -> Float[np.ndarray, "rows own"]:
        """The columns that only new groups or permanent changes have."""
        return np.concatenate(self.new[cells])[:, self.new.shape[2] - self.own :]

    def determine_group_parameters(self, cells: np.ndarray) -> bool:
        """Whether these new positions determine every parameter of new groups that they depend on. With the spindle upright
        (beta 90) the positions of one mounting do not determine its angles."""
        rows = self.of_new_groups(cells)
        rows = rows[:, np.any(rows != 0, axis=0) & (self.prior[self.new.shape[2] - self.own :] == 0)]
        return rows.shape[1] == 0 or np.linalg.matrix_rank(rows, tol=_SEEN * np.max(np.abs(rows))) == rows.shape[1]


def remountings(diagnosis: Diagnosis) -> tuple[tuple[str, ...], str]:
    """Remountings of the triad that the chain can describe, and if there are none the reason in words."""
    mounts = [link for link in diagnosis.model.nominal_chain.links if isinstance(link, Mount)]
    free = [leaf for leaf in parameters_of(tuple(mounts)) if leaf.name == "dtheta" and leaf.free]
    if len(mounts) != 1 or not free:
        return (), "No remounting is proposed: the chain has no free, exact mount."
    by = free[0].by
    if by is not None and "mount" not in by.split("."):
        return (), f"No remounting is proposed: the chain has one dtheta for each {by}, not for each mounting."
    if by is None and diagnosis.from_rig and len(set(diagnosis.data.mount or ("1",))) > 1:
        return (), "No remounting is proposed: the rig has one dtheta for all mountings; index it by mount."
    return tuple(SIDES), ""


def rows_of(
    diagnosis: Diagnosis,
    listed: Sequence[Proposal],
    vector: Float[np.ndarray, " full"],
    conditions: Conditions | None = None,
    *,
    in_order: bool = False,
) -> Rows:
    """Rows of the data and of all proposals.

    **Arguments:**

    - `diagnosis`: of the present data.
    - `listed`: the proposals. New positions belong to the last run and mounting, or to a new mounting.
    - `vector`: the full vector that the rows are linearised at.
    - `conditions`: under which they are measured; by default directly after the data.
    - `in_order`: whether they are measured one after another as listed; otherwise each is the first.
    """
    conditions = conditions or continued(diagnosis.data)
    problem, model = diagnosis.problem, diagnosis.model
    for cause in diagnosis.members:
        problem = cause.undone(problem)
    residual, old = white_rows(model, problem, vector, model.evaluate(problem.where, vector))
    residual, old = residual / diagnosis.level, old / diagnosis.level
    for rows in (residual, old):
        rows[: problem.readings.size][np.repeat(~problem.takes_part, 3)] = 0.0
    spots = [replace(proposal, alpha_deg=(alpha,)) for proposal in listed for alpha in proposal.alpha_deg]
    ends = np.cumsum([proposal.cost for proposal in listed])
    cells = [np.arange(end - proposal.cost, end) for end, proposal in zip(ends.tolist(), listed, strict=True)]
    new = _NewPositions(problem, model, spots, diagnosis.from_rig, conditions, in_order)
    jacobian, predicted = np.zeros((len(spots), 3, len(model.start))), np.zeros((len(spots), 3))
    sides = np.array([spot.side for spot in spots])
    for side in dict.fromkeys(sides.tolist()):
        chosen, turned = np.flatnonzero(sides == side), new.turned(vector, side)
        room = len(problem.readings) - problem.where.clocks
        for block in np.array_split(chosen, -(-len(chosen) // room)):
            rows, evaluation = new.evaluated(block, turned)
            jacobian[block], predicted[block] = evaluation.jacobian[rows], evaluation.predicted[rows]
    # The noise of a new reading is the median of the measured ones of its axis.
    weight = np.median(1.0 / problem.sd, axis=0) / diagnosis.level
    amplitudes, shapes, prior = model.layout.amplitudes, model.layout.shapes, np.zeros(len(vector))
    sizes = vector[amplitudes] / model.scales[amplitudes]
    prior[amplitudes] = _USUAL**-2
    prior[shapes] = (model.scales[shapes] / vector[shapes]) ** 2
    shown, expected = residual + old[:, amplitudes] @ sizes, (predicted - jacobian[:, :, amplitudes] @ sizes) * weight
    # At a new pitch setting an effect has none of the values that it has at others.
    at_settings = [column for slot in model.slots if any(map(acts_at_settings, slot.links)) for column in slot.columns]
    jacobian[np.ix_(new.index["pitch"] < 0, np.ones(3, bool), np.isin(np.arange(len(vector)), at_settings))] = 0.0
    of_groups, group_prior = new.group_columns(jacobian)
    weighted = np.concatenate([jacobian, of_groups], axis=2) * weight[:, None]
    old = np.hstack([old, np.zeros((len(old), of_groups.shape[2]))])
    prior = np.append(prior, group_prior / diagnosis.level**2)
    return Rows(old, shown, weighted, expected, cells, prior, of_groups.shape[2], weight)


def acts_at_settings(link: Link) -> bool:
    """Whether a link acts at one pitch setting, or has a value for each."""
    return hasattr(link, "setting") or getattr(link, "by", "") == "pitch"


class _NewPositions:
    """New positions of a problem: the groups that they belong to, and their rows.

    `spots`: each as a proposal of one position. `leaves`: of the nominal chain, with their columns (groups, components).
    """

    def __init__(
        self,
        problem: Problem,
        model: FullModel,
        spots: Sequence[Proposal],
        from_rig: bool,
        conditions: Conditions,
        in_order: bool,
    ):
        self.problem, self.model, self.spots, self.from_rig = problem, model, spots, from_rig
        self.conditions, self.in_order = conditions, in_order
        self.leaves, offset = list[tuple[Parameter, np.ndarray]](), 0
        for leaf in model.nominal_chain.free:
            self.leaves.append((leaf, offset + np.arange(leaf.value.size).reshape(leaf.value.shape)))
            offset += leaf.value.size
        data, where = problem.measured_data, problem.where
        count = len(data)
        run, mount, clock = (given or ("1",) * count for given in (data.run, data.mount, data.clock))
        beta, new_beta = np.round(where.pitch_angle, 9), np.radians([spot.beta_deg for spot in spots]).round(9)
        nearest = beta[np.argmin(np.abs(beta - new_beta[:, None]), axis=1)]
        new_beta = np.where(np.abs(nearest - new_beta) < _SAME_ANGLE, nearest, new_beta)
        self.keys = [
            {
                "pitch": pitch,
                "mount": spot.side or mount[-1],
                "run": run[-1],
                "clock": clock[-1],
                "position": f"new {k}",
            }
            for k, (spot, pitch) in enumerate(zip(spots, new_beta.tolist(), strict=True))
        ]
        # A new position is evaluated in place of this one of the last run and mounting, at the nearest pitch setting.
        last = np.array([row for row in range(count) if (run[row], mount[row]) == (run[-1], mount[-1])])
        self.like = last[np.argmin(np.abs(beta[last] - new_beta[:, None]), axis=1)]
        # Group of each new position in every index column; -1: a new group.
        self.index: dict[str, np.ndarray] = {}
        for by, group in where.groups.items():
            if by in VISITS:
                self.index[by] = np.full(len(self.keys), -1)
                continue
            here = {"pitch": beta.tolist(), "mount": mount, "run": run, "clock": clock, "position": range(count)}
            parts = by.split(".")
            known = dict(
                zip(zip(*(here[part] for part in parts), strict=True), np.asarray(group).tolist(), strict=True)
            )
            self.index[by] = np.array([known.get(tuple(key[part] for part in parts), -1) for key in self.keys])

    def evaluated(self, block: np.ndarray, vector: Float[np.ndarray, " full"]) -> tuple[np.ndarray, Evaluation]:
        """New positions evaluated in rows of the data, and these rows. The first row of each clock stays, as drifts count from
        it."""
        where = self.problem.where
        count = len(where.alpha)
        time = np.zeros(count) if where.time_s is None else np.asarray(where.time_s, float)
        rows = np.delete(np.arange(count), where.clock_starts)[: len(block)]

        def put(old, new):
            if old is None:
                return None
            changed = np.array(old)
            changed[rows] = new
            return changed

        index = {}
        for by, old in where.groups.items():
            known = self.index[by][block]
            index[by] = put(old, np.where(known >= 0, known, np.asarray(old)[self.like[block]]))
        after = self.conditions.step_s * (block if self.in_order else np.zeros(len(block)))
        later = (time.max() if self.conditions.time_s is None else self.conditions.time_s) + after
        here = replace(
            where,
            alpha=put(where.alpha, np.radians([self.spots[k].alpha_deg[0] for k in block])),
            beta=put(where.beta, np.radians([self.spots[k].beta_deg for k in block])),
            groups=index,
            time_s=put(where.time_s, later),
            temperature_degc=put(where.temperature_degc, self.conditions.temperature_degc),
            approach=put(where.approach, 1.0),
        )
        return rows, self.model.evaluate(here, vector)

    def turned(self, vector: Float[np.ndarray, " full"], side: str) -> Float[np.ndarray, " full"]:
        """The full vector with the triad turned in its fixture: dtheta of every mounting is the turn.

        New positions are evaluated in the last mounting. If that is turned itself, dtheta is the turn from there.
        """
        if not side:
            return vector
        turned = vector.copy()
        wanted = rotation_matrix(np.radians(SIDES[side]))
        orientations = self.model.nominal_chain.orientations
        if orientations is not None:
            last = int(np.asarray(self.problem.where.index("mount"))[-1])
            wanted = wanted @ np.asarray(orientations)[last].T
        exact = turn_of(wanted)
        angles = rotation_angles(wanted) if exact is None else np.radians(exact)
        for leaf, columns in self.leaves:
            if leaf.name == "dtheta":
                turned[columns] = angles
        return turned

    def group_columns(self, jacobian: Float[np.ndarray, "cells 3 full"]) -> tuple[np.ndarray, np.ndarray]:
        """Columns of the parameters of new groups, removed from the columns that they were evaluated with.

        **Returns:** (cells, 3, columns) and the information that a prior on the whole leaf gives on each.
        """
        added: list[np.ndarray] = []
        prior: list[float] = []
        for leaf, columns in self.leaves:
            first, numbers = len(added), dict[tuple, int]()
            for k, spot in enumerate(self.spots):
                # The pitch settings of a new mounting are new by default; a rig file states the index of dbeta.
                new_group = bool(spot.side) and (leaf.name == "dtheta" or (leaf.name == "dbeta" and not self.from_rig))
                known = 0 if leaf.by is None else self.index[leaf.by][k]
                if known >= 0 and not new_group:
                    continue
                # Positions that set the same setting again have one new visit.
                by = VISITS[leaf.by][0] if leaf.by in VISITS else leaf.by or "run"
                parts = [*by.split("."), *(["mount"] if new_group else [])]
                key = tuple(self.keys[k][part] for part in parts)
                if key not in numbers:
                    numbers[key] = first + leaf.value.shape[1] * len(numbers)
                    added += [np.zeros((len(self.spots), 3)) for _ in range(leaf.value.shape[1])]
                    prior += self._prior(columns)
                replaced = columns.ravel()
                values = jacobian[k][:, replaced].reshape(3, *leaf.value.shape).sum(axis=1)
                if leaf.name == "dtheta" and spot.side:
                    values = _mounting(jacobian[k][:, self.model.probe], float(np.radians(spot.alpha_deg[0])))
                for component in range(leaf.value.shape[1]):
                    added[numbers[key] + component][k] = values[:, component]
                jacobian[k][:, replaced] = 0.0
        if not added:
            return np.zeros((len(self.spots), 3, 0)), np.zeros(0)
        return np.stack(added, axis=2), np.array(prior)

    def _prior(self, columns: np.ndarray) -> list[float]:
        """Information on the parameters of a new group: that of the prior on each alone if it is the same for all groups."""
        root = self.problem.prior_root * self.model.scales[: self.model.nominal]
        stated = np.flatnonzero(np.any(root != 0, axis=0))
        given = np.zeros(root.shape[1])
        given[stated] = 1.0 / np.diag(np.linalg.inv(root[:, stated].T @ root[:, stated]))
        return [float(part[0]) if np.allclose(part, part[0], rtol=1e-6) else 0.0 for part in given[columns].T]


def _mounting(probe: np.ndarray, alpha: float) -> np.ndarray:
    """Response to small rotations of the mounting, from that to rotations of the head before the spindle.

    The angles of the mounting are singular: at 90 degrees about y two of them turn about the same axis.
    """
    return probe @ rotation_matrix(np.array([alpha, 0.0, 0.0])).T

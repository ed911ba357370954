"""Weighted Jacobian rows of positions that are not measured yet, and the linear posterior of an explanation.

The rows are those of the model that is compiled for the data: new positions are evaluated in blocks of the shape of the data,
so nothing is compiled. A parameter of a group that is not measured yet (dbeta of a new pitch setting, dtheta of a new mounting)
has columns of its own: its derivative is that of the group that the position is evaluated with.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from tumblecal.chain import Parameter, Where, settings
from tumblecal.chain.where import VISITS
from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import Cause
from tumblecal.estimation.mountings import turn_of
from tumblecal.estimation.problem import Problem
from tumblecal.full_model.full_model import FullModel
from tumblecal.full_model.tangent import tangent
from tumblecal.ground.frames import rotation_angles, rotation_matrix
from tumblecal.plan.information import Information, Square, covariance_of
from tumblecal.plan.next.conditions import Conditions
from tumblecal.plan.next.proposals import SIDES, NextPosition


# Coefficients of effects are within so many of their scales, time constants within one of their value: a coefficient that the
# data do not determine predicts nothing larger. (benchmarks/blind next)
_USUAL = 10.0
# Information on parameters that nothing determines yet, as a share of the largest: practically none.
_NOTHING = 1e-10
# Pitch angles closer than this are one setting.
_SAME_ANGLE_DEG = 1e-4
# The index of a parameter with a value for each mounting, if the data have one mounting.
_BY_MOUNTING = {None: "mount", "pitch": "mount.pitch", "run.pitch": "run.mount.pitch"}

# Numbers of the new positions of each of several proposals.
Spots = Int[np.ndarray, "proposals cells"]


class Prediction(NamedTuple):
    """Mean and covariance of the readings of each proposal, in units of the noise."""

    mean: Float[np.ndarray, "proposals rows"]
    spread: Float[np.ndarray, "proposals rows rows"]


@dataclass(frozen=True)
class Posterior(Information):
    """Linear posterior of some coefficients: `towards` is the projection of the data, `expected` (cells, 3) the readings of new
    positions without these coefficients."""

    towards: Float[np.ndarray, " all"]
    expected: Float[np.ndarray, "cells 3"]

    @cached_property
    def covariance(self) -> Square:
        """Covariance of the coefficients."""
        return covariance_of(self.information)

    def predicted(self, spots: Spots) -> Prediction:
        """The readings at each proposal's positions."""
        rows = self.rows(spots)
        mean = self.expected[spots].reshape(len(spots), -1) + rows @ (self.covariance @ self.towards)
        return Prediction(mean, rows @ self.covariance @ rows.swapaxes(1, 2) + np.eye(rows.shape[1]))

    def after(self, spots: Int[np.ndarray, " cells"], readings: Float[np.ndarray, " rows"]) -> "Posterior":
        """With these readings of some positions."""
        towards = self.towards + self.rows(spots).T @ (readings - self.expected[spots].ravel())
        return replace(self, information=self.information_with(spots), towards=towards)


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

    def posterior(self, causes: Sequence[Cause], model: FullModel) -> Posterior:
        """The posterior of an explanation with these causes: the nominal parameters, the coefficients of the causes, and what
        only new groups or permanent changes have. Outlier, exchanged or mislabelled positions do not count; a permanent change
        of an axis applies to every new position."""
        old, new = self.old.copy(), self.new
        old[[3 * position + axis for cause in causes for position in cause.positions for axis in range(3)]] = 0.0
        leaves = np.array([name.partition("@")[0] for name in model.names])
        for cause, parameter in [(one, parameter) for one in causes for parameter in one.lasting]:
            # After the change the readings respond to it as to the parameter.
            changed = np.any(np.reshape(cause.terms, (len(cause.terms), -1, 3)), axis=(0, 2))
            shown, columns = np.repeat(changed, 3), np.flatnonzero(leaves == parameter)
            response = old[: len(shown), columns].sum(axis=1) * shown
            old = np.column_stack([old, np.pad(response, (0, len(old) - len(shown)))])
            new = np.dstack([new, self.new[:, :, columns].sum(axis=2)])
        of_causes = (column for cause in causes for column in cause.slot.all_columns)
        chosen = [*range(model.nominal), *of_causes, *range(len(self.prior) - self.own, old.shape[1])]
        prior = np.pad(self.prior, (0, old.shape[1] - len(self.prior)))[chosen]
        information = old[:, chosen].T @ old[:, chosen]
        information += np.diag(np.maximum(prior, _NOTHING * np.max(np.diag(information))))
        return Posterior(new[:, :, chosen], information, old[:, chosen].T @ self.shown, self.expected)


def rows_of(diagnosis: Diagnosis, listed: Sequence[NextPosition], conditions: Conditions) -> Rows:
    """Rows of the data and of all proposals, linearised at the leading explanation.

    **Arguments:**

    - `diagnosis`: of the present data.
    - `listed`: the proposals. New positions belong to the last run and mounting, or to a new mounting.
    - `conditions`: under which they are measured, one after another.
    """
    problem, model, vector = diagnosis.problem, diagnosis.model, diagnosis.extended.vector
    amplitudes, shapes = model.layout.amplitudes, model.layout.shapes
    for cause in diagnosis.members:
        problem = cause.undone(problem)
    at = tangent(model, problem, vector)
    old, shown = at.jacobian / diagnosis.level, at.residual / diagnosis.level
    left_out = np.flatnonzero(np.repeat(~problem.takes_part, 3))
    old[left_out], shown[left_out] = 0.0, 0.0
    spots = [spot for proposal in listed for spot in proposal.each]
    joined, like = _joined_settings(problem, spots)
    jacobian, predicted = _evaluated(problem, model, spots, like, vector, conditions)
    # The noise of a new reading is the median of the measured ones of its axis.
    weight, prior = np.median(1.0 / problem.sd, axis=0) / diagnosis.level, np.zeros(len(vector))
    prior[amplitudes] = _USUAL**-2
    prior[shapes] = (model.scales[shapes] / vector[shapes]) ** 2
    sizes = vector[amplitudes] / model.scales[amplitudes]
    expected = (predicted - jacobian[:, :, amplitudes] @ sizes) * weight
    of_groups, of_prior = _group_columns(diagnosis, spots, joined, jacobian)
    own, ends = len(of_prior), np.cumsum([len(proposal.angles_deg) for proposal in listed])
    new = np.concatenate([jacobian, of_groups], axis=2) * weight[:, None]
    cells, prior = np.split(np.arange(len(spots)), ends[:-1]), np.append(prior, of_prior / diagnosis.level**2)
    return Rows(np.pad(old, ((0, 0), (0, own))), shown, new, expected, cells, prior, own, weight)


def _joined_settings(problem: Problem, spots: Sequence[NextPosition]) -> tuple[Where, Int[np.ndarray, " spots"]]:
    """The settings of the data followed by new positions of the last run and clock, in the last or a new mounting; and for each
    new position the one of the last run and mounting with the nearest pitch setting. Groups are numbered as they first appear:
    those of the data come first."""
    data, where, more = problem.measured_data, problem.where, len(spots)
    pitch, place = np.asarray(where.index("pitch")), np.asarray(where.index("run.mount"))
    beta = np.array([spot.beta_deg for spot in spots])
    distance = np.abs(np.degrees(where.pitch_angle) - beta[:, None])
    another = pitch.max() + 1 + np.unique(beta, return_inverse=True)[1]
    new_pitch = np.where(distance.min(axis=1) < _SAME_ANGLE_DEG, pitch[np.argmin(distance, axis=1)], another)
    run, mount, clock = map(data.labels, ("run", "mount", "clock"))
    angles = np.zeros(len(data) + more)
    joined = settings(
        angles,
        angles,
        pitch=np.append(pitch, new_pitch),
        run=(*run, *(run[-1:] * more)),
        mount=(*mount, *(spot.mount or mount[-1] for spot in spots)),
        clock=(*clock, *(clock[-1:] * more)),
    )
    last = np.flatnonzero(place == place[-1])
    return joined, last[np.argmin(distance[:, last], axis=1)]


def _evaluated(
    problem: Problem,
    model: FullModel,
    spots: Sequence[NextPosition],
    like: Int[np.ndarray, " spots"],
    vector: Float[np.ndarray, " full"],
    conditions: Conditions,
) -> tuple[Float[np.ndarray, "spots 3 full"], Float[np.ndarray, "spots 3"]]:
    """Jacobian and prediction at new positions in the groups of others (`like`), in blocks in place of rows of the data. The
    first row of each clock remains, as drifts count from it."""
    where, count = problem.where, len(spots)
    jacobian, predicted = np.zeros((count, 3, len(vector))), np.zeros((count, 3))
    free = np.delete(np.arange(len(problem.readings)), where.clock_starts)
    alpha, beta = np.radians([(spot.alpha_deg, spot.beta_deg) for spot in spots]).T
    time = (conditions.time_s or 0.0) + conditions.step_s * np.arange(count)
    degc = np.full(count, conditions.temperature_degc, float)
    own = {"alpha": alpha, "beta": beta, "time_s": time, "temperature_degc": degc, "approach": np.ones(count)}
    own = {name: values for name, values in own.items() if getattr(where, name) is not None}
    sides = np.array([spot.mount for spot in spots])
    for side in dict.fromkeys(sides.tolist()):
        chosen, turned = np.flatnonzero(sides == side), _turned(problem, model, vector, side)
        for block in np.split(chosen, range(len(free), len(chosen), len(free))):
            rows, source = free[: len(block)], np.arange(len(problem.readings))
            source[rows] = like[block]
            here = jax.tree.map(partial(np.take, indices=source), where)
            for name, values in own.items():
                getattr(here, name)[rows] = values[block]
            evaluation = model.evaluate(here, turned)
            jacobian[block], predicted[block] = evaluation.jacobian[rows], evaluation.predicted[rows]
    return jacobian, predicted


def _turned(
    problem: Problem, model: FullModel, vector: Float[np.ndarray, " full"], side: str
) -> Float[np.ndarray, " full"]:
    """The full vector with the triad turned in its fixture: dtheta of every mounting is the turn.

    New positions are evaluated in the last mounting. If that is turned itself, dtheta is the turn from there.
    """
    turned, orientations = vector.copy(), model.nominal_chain.orientations
    if side:
        rotation = rotation_matrix(np.radians(SIDES[side]))
        if orientations is not None:
            rotation = rotation @ np.asarray(orientations)[int(np.asarray(problem.where.index("mount"))[-1])].T
        exact = turn_of(rotation)
        angles = rotation_angles(rotation) if exact is None else np.radians(exact)
        for columns in [columns for leaf, columns in leaves_of(model) if leaf.name == "dtheta"]:
            turned[columns] = angles
    return turned


def leaves_of(model: FullModel) -> Iterator[tuple[Parameter, Int[np.ndarray, "groups components"]]]:
    """The free leaves of the nominal chain with their columns."""
    offset = 0
    for leaf in model.nominal_chain.free:
        yield leaf, offset + np.arange(leaf.value.size).reshape(leaf.value.shape)
        offset += leaf.value.size


def _group_columns(
    diagnosis: Diagnosis, spots: Sequence[NextPosition], joined: Where, jacobian: Float[np.ndarray, "spots 3 full"]
) -> tuple[Float[np.ndarray, "spots 3 own"], Float[np.ndarray, " own"]]:
    """Columns of the parameters of new groups, removed from the columns that they were evaluated with.

    **Returns:** the columns, and the information that a prior on the whole leaf gives on each.
    """
    model, added, prior = diagnosis.model, [np.zeros((len(spots), 3, 0))], list[float]()
    root = diagnosis.problem.prior_root * model.scales[: model.nominal]
    stated, information = np.flatnonzero(np.any(root != 0, axis=0)), np.zeros(model.nominal)
    information[stated] = 1.0 / np.diag(np.linalg.inv(root[:, stated].T @ root[:, stated]))
    for leaf, columns in leaves_of(model):
        by, values = leaf.by, jacobian[:, :, columns].sum(axis=2)
        # The pitch settings of a new mounting are new by default; a rig file states the index of dbeta.
        if leaf.name == "dtheta" or (leaf.name == "dbeta" and not diagnosis.from_rig):
            by = _BY_MOUNTING.get(by, by)
        if by is None:
            continue
        # Positions that set the same setting again have one new visit.
        old, number = np.split(np.asarray(joined.index(VISITS.get(by, (by,))[0])), [-len(spots)])
        new = np.flatnonzero((number > old.max()) | (by in VISITS))
        for k in [k for k, spot in enumerate(spots) if leaf.name == "dtheta" and spot.mount]:
            # The angles of the mounting are singular: at 90 degrees about y two of them turn about the same axis. The response
            # to its small rotations is that to rotations of the head before the spindle.
            spindle = rotation_matrix(np.radians([spots[k].alpha_deg, 0.0, 0.0]))
            values[k] = jacobian[k][:, model.probe] @ spindle.T
        groups, own = np.unique(number[new], return_inverse=True)
        block = np.zeros((len(spots), 3, len(groups), columns.shape[1]))
        block[new, :, own] = values[new]
        added.append(block.reshape(len(spots), 3, -1))
        given = information[columns]
        same = np.where(np.ptp(given, axis=0) <= 1e-6 * given[0], given[0], 0.0)
        prior += np.tile(same, len(groups)).tolist()
        jacobian[np.ix_(new, np.arange(3), columns.ravel())] = 0.0
    return np.concatenate(added, axis=2), np.array(prior)

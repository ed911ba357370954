"""Weighted Jacobian rows of positions that are not measured yet, from the model that is compiled for the data.

New positions are evaluated in blocks of the shape of the data, so nothing is compiled.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import jax
import numpy as np
from jaxtyping import Float, Int

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import Cause
from tumblecal.estimation.mountings import turn_of
from tumblecal.estimation.problem import Problem
from tumblecal.full_model.full_model import FullModel
from tumblecal.full_model.tangent import tangent
from tumblecal.ground.frames import rotation_angles, rotation_matrix
from tumblecal.plan.next.conditions import Conditions
from tumblecal.plan.next.groups import group_columns, joined_settings, leaves_of
from tumblecal.plan.next.posterior import Posterior
from tumblecal.plan.next.proposals import SIDES, NextPosition


# Coefficients of effects are within so many of their scales, time constants within one of their value: a coefficient that the
# data do not determine predicts nothing larger. (benchmarks/blind next)
_USUAL = 10.0
# Information on parameters that nothing determines yet, as a share of the largest: practically none.
_NOTHING = 1e-10


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
        for cause in causes:
            for parameter in cause.lasting:
                # After the change the readings respond to it as to the parameter.
                changed = np.any(np.reshape(cause.terms, (len(cause.terms), -1, 3)), axis=(0, 2))
                shown, columns = np.repeat(changed, 3), np.flatnonzero(leaves == parameter)
                response = old[: len(shown), columns].sum(axis=1) * shown
                old = np.column_stack([old, np.pad(response, (0, len(old) - len(shown)))])
                new = np.dstack([new, self.new[:, :, columns].sum(axis=2)])
        added = range(len(self.prior) - self.own, old.shape[1])
        of_causes = (column for cause in causes for column in cause.slot.all_columns)
        chosen, prior = [*range(model.nominal), *of_causes, *added], np.zeros(old.shape[1])
        prior[: len(self.prior)] = self.prior
        information = old[:, chosen].T @ old[:, chosen]
        information += np.diag(np.maximum(prior[chosen], _NOTHING * np.max(np.diag(information))))
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
    joined, like = joined_settings(problem, spots)
    jacobian, predicted = _evaluated(problem, model, spots, like, vector, conditions)
    # The noise of a new reading is the median of the measured ones of its axis.
    weight, prior = np.median(1.0 / problem.sd, axis=0) / diagnosis.level, np.zeros(len(vector))
    prior[amplitudes] = _USUAL**-2
    prior[shapes] = (model.scales[shapes] / vector[shapes]) ** 2
    sizes = vector[amplitudes] / model.scales[amplitudes]
    expected = (predicted - jacobian[:, :, amplitudes] @ sizes) * weight
    of_groups, group_prior = group_columns(diagnosis, spots, joined, jacobian)
    own, ends = len(group_prior), np.cumsum([len(proposal.angles_deg) for proposal in listed])
    return Rows(
        np.pad(old, ((0, 0), (0, own))),
        shown,
        np.concatenate([jacobian, of_groups], axis=2) * weight[:, None],
        expected,
        np.split(np.arange(len(spots)), ends[:-1]),
        np.append(prior, group_prior / diagnosis.level**2),
        own,
        weight,
    )


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
    sides = np.array([spot.mount for spot in spots])
    for side in dict.fromkeys(sides.tolist()):
        chosen, turned = np.flatnonzero(sides == side), _turned(problem, model, vector, side)
        for block in np.split(chosen, range(len(free), len(chosen), len(free))):
            rows, source = free[: len(block)], np.arange(len(problem.readings))
            source[rows] = like[block]
            here = jax.tree.map(partial(np.take, indices=source), where)
            own = {"alpha": alpha, "beta": beta, "time_s": time, "temperature_degc": degc, "approach": np.ones(count)}
            for name, values in own.items():
                if getattr(where, name) is not None:
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

"""Weighted Jacobian rows of positions that are not measured yet, from the model that is compiled for the data.

New positions are evaluated in blocks of the data's own shape, so nothing is compiled. A parameter indexed by a column
of the data (dbeta of a pitch setting) that a new position would have of its own gets columns of its own: the derivative
is that of the setting it is evaluated with.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from tumblecal.chain import Parameter, Where
from tumblecal.chain.frames import rotation_angles, rotation_matrix
from tumblecal.chain.nominal import Mount
from tumblecal.data import PositionSet
from tumblecal.diagnosis.adapt import Fit
from tumblecal.diagnosis.linear import Weighting, weighted
from tumblecal.diagnosis.model import Model
from tumblecal.diagnosis.next_grid import SIDES, Proposal
from tumblecal.diagnosis.repair import Repaired
from tumblecal.estimation.quarter_turns import turn_of


# Pitch angles closer than this (rad) are one setting.
_SAME_ANGLE = 1e-6


@dataclass(frozen=True)
class Rows:
    """Rows in units of the noise; columns: the model's full vector (scaled), then parameters that only new groups have.

    `old`: rows of the data, priors' rows last. `new` (cells, 3, columns): of each new position; `cells` gives those of
    each proposal. `own_prior`: information on each of the new groups' parameters from a prior on their leaf.
    """

    old: Float[np.ndarray, "rows columns"]
    new: Float[np.ndarray, "cells 3 columns"]
    cells: list[np.ndarray]
    own_prior: Float[np.ndarray, " own"]


@dataclass(frozen=True)
class _Place:
    """Columns of one nominal leaf: one row a group."""

    leaf: Parameter
    columns: np.ndarray


def remountings(model: Model, data: PositionSet, from_rig: bool) -> tuple[tuple[str, ...], str]:
    """The ways of turning the triad in its fixture that the chain can describe, and in words why there are none."""
    mounts = [link for link in model.nominal_chain.links if isinstance(link, Mount)]
    if len(mounts) != 1 or not mounts[0].dtheta.free:
        return (), "No remounting is proposed: the chain has no free, exact mount."
    by = mounts[0].dtheta.by
    if by is not None and "mount" not in by.split("."):
        return (), f"No remounting is proposed: the chain has one dtheta for each {by}, not for each mounting."
    if by is None and from_rig and len(set(data.mount or ("1",))) > 1:
        return (), "No remounting is proposed: the rig has one dtheta for all mountings; index it by mount."
    return tuple(SIDES), ""


def rows_of(
    model: Model,
    repaired: Repaired,
    data: PositionSet,
    how: Weighting,
    fit: Fit,
    listed: Sequence[Proposal],
    from_rig: bool,
) -> Rows:
    """Rows of the data and of all proposals.

    **Arguments:**

    - `model`, `repaired`, `how`, `fit`: of the present data, named faults undone; `data`: the same with labels.
    - `listed`: the proposals. New positions belong to the last run and mounting, or to a new mounting.
    - `from_rig`: whether the chain is a rig's own: then the pitch errors of a new mounting are indexed as it says.
    """
    where, size = repaired.where, 1.0 if how.known else fit.sigma
    _, old = weighted(model, model.evaluate(where, fit.vector), repaired.readings, how, fit.vector)
    old = old / size
    old[: repaired.readings.size][np.repeat(~repaired.keep, 3)] = 0.0
    spots = [(place, alpha) for place, one in enumerate(listed) for alpha in one.alpha_deg]
    ends = np.cumsum([one.cost for one in listed])
    cells = [np.arange(end - one.cost, end) for end, one in zip(ends.tolist(), listed, strict=True)]
    jacobian = np.zeros((len(spots), 3, len(model.order)))
    groups = _Groups(where, data, [(listed[place].beta_deg, listed[place].side) for place, _ in spots])
    alpha = np.radians([alpha for _, alpha in spots])
    beta = np.radians([listed[place].beta_deg for place, _ in spots])
    sides = np.array([listed[place].side for place, _ in spots])
    places = _places(model)
    for side in dict.fromkeys(sides.tolist()):
        chosen = np.flatnonzero(sides == side)
        vector = _turned(model, places, fit.vector, side, where)
        for block in np.array_split(chosen, -(-len(chosen) // (len(where.alpha) - 1))):
            jacobian[block] = _block(model, where, groups, block, alpha, beta, vector)
    own, prior = _own_columns(model, places, groups, jacobian, alpha, sides, how, from_rig)
    # A reading of each axis is taken to be as good as half of those measured.
    noise = np.median(how.weights, axis=0) / size
    new = np.concatenate([jacobian, own], axis=2) * noise[:, None]
    old = np.hstack([old, np.zeros((len(old), own.shape[2]))])
    return Rows(old, new, cells, prior / size**2)


class _Groups:
    """Which group of every index column each new position belongs to; -1 where it would be one of its own."""

    def __init__(self, where: Where, data: PositionSet, spots: Sequence[tuple[float, str]]):
        count = len(data)
        run, mount = data.run or ("1",) * count, data.mount or ("1",) * count
        beta = np.round(np.asarray(where.beta), 9)

        def pitch(angle_deg: float) -> float:
            nearest = float(beta[np.argmin(np.abs(beta - np.radians(angle_deg)))])
            same = abs(nearest - np.radians(angle_deg)) < _SAME_ANGLE
            return nearest if same else round(float(np.radians(angle_deg)), 9)

        last = [row for row in range(count) if (run[row], mount[row]) == (run[-1], mount[-1])]
        self.keys = [
            {"pitch": pitch(b), "mount": side or mount[-1], "run": run[-1], "position": f"new {k}"}
            for k, (b, side) in enumerate(spots)
        ]
        # A new position is evaluated as if it were this one of the last run and mounting, at the nearest pitch setting.
        self.like = np.array([min(last, key=lambda row: abs(beta[row] - key["pitch"])) for key in self.keys])
        self.index: dict[str, np.ndarray] = {}
        for by, group in where.groups.items():
            here = {"pitch": beta.tolist(), "mount": mount, "run": run, "position": range(count)}
            parts = by.split(".")
            known = dict(
                zip(zip(*(here[part] for part in parts), strict=True), np.asarray(group).tolist(), strict=True)
            )
            self.index[by] = np.array([known.get(tuple(key[part] for part in parts), -1) for key in self.keys])

    def key(self, by: str, spot: int, also_mount: bool) -> tuple:
        """The name of a new position's own group."""
        parts = [*by.split("."), *(["mount"] if also_mount else [])]
        return tuple(self.keys[spot][part] for part in parts)


def _block(
    model: Model,
    where: Where,
    groups: _Groups,
    block: np.ndarray,
    alpha: np.ndarray,
    beta: np.ndarray,
    vector: np.ndarray,
) -> np.ndarray:
    """Jacobian of some new positions, evaluated in place of the data's; the first in time stays: drifts count from it."""
    count = len(where.alpha)
    time = np.zeros(count) if where.time_s is None else np.asarray(where.time_s, float)
    rows = np.delete(np.arange(count), np.argmin(time))[: len(block)]

    def put(old, new):
        if old is None:
            return None
        changed = np.array(old)
        changed[rows] = new
        return changed

    index = {}
    for by, old in where.groups.items():
        known = groups.index[by][block]
        index[by] = put(old, np.where(known >= 0, known, np.asarray(old)[groups.like[block]]))
    later = time.max() + np.ptp(time) / max(1, count - 1)
    warmth = where.temperature_degc
    here = replace(
        where,
        alpha=put(where.alpha, alpha[block]),
        beta=put(where.beta, beta[block]),
        groups=index,
        time_s=put(where.time_s, later),
        temperature_degc=put(warmth, None if warmth is None else float(np.median(warmth))),
        approach=put(where.approach, 1.0),
    )
    return model.evaluate(here, vector).jacobian[rows]


def _places(model: Model) -> list[_Place]:
    """Columns of the nominal leaves in the full vector."""
    places, offset = [], 0
    for leaf in model.nominal_chain.free:
        shape = leaf.value.shape
        places.append(_Place(leaf, offset + np.arange(leaf.value.size).reshape(shape)))
        offset += leaf.value.size
    return places


def _turned(model: Model, places: list[_Place], vector: np.ndarray, side: str, where: Where) -> np.ndarray:
    """The full vector with the triad turned in its fixture: every mounting's dtheta holds the turn.

    New positions are evaluated as of the last mounting; where that is turned itself, dtheta holds the turn from there.
    """
    if not side:
        return vector
    turned = vector.copy()
    wanted = rotation_matrix(np.radians(SIDES[side]))
    for link in model.nominal_chain.links:
        if isinstance(link, Mount) and link.nominal is not None:
            wanted = wanted @ np.asarray(link.nominal)[int(np.asarray(where.index("mount"))[-1])].T
    exact = turn_of(wanted)
    angles = rotation_angles(wanted) if exact is None else np.radians(exact)
    for place in places:
        if place.leaf.name == "dtheta":
            turned[place.columns] = angles
    return turned


def _own_columns(
    model: Model,
    places: list[_Place],
    groups: _Groups,
    jacobian: np.ndarray,
    alpha: np.ndarray,
    sides: np.ndarray,
    how: Weighting,
    from_rig: bool,
) -> tuple[np.ndarray, np.ndarray]:
    """Columns of parameters that only new positions have, taken out of the columns they were evaluated with.

    **Returns:** (cells, 3, own) and the information that a prior on the whole leaf gives on each.
    """
    own: list[np.ndarray] = []
    prior: list[float] = []
    for place in places:
        leaf, first = place.leaf, len(own)
        found: dict[tuple, int] = {}
        for spot, side in enumerate(sides.tolist()):
            # By custom the head is set anew for a new mounting; a rig says by itself what its dbeta are indexed by.
            anew = bool(side) and (leaf.name == "dtheta" or (leaf.name == "dbeta" and not from_rig))
            known = 0 if leaf.by is None else groups.index[leaf.by][spot]
            if known >= 0 and not anew:
                continue
            key = groups.key(leaf.by or "run", spot, anew)
            if key not in found:
                found[key] = first + leaf.value.shape[1] * len(found)
                own += [np.zeros((len(sides), 3)) for _ in range(leaf.value.shape[1])]
                prior += _prior(model, place, how)
            taken = place.columns.ravel()
            values = jacobian[spot][:, taken].reshape(3, *leaf.value.shape).sum(axis=1)
            if leaf.name == "dtheta" and side:
                values = _mounting(jacobian[spot][:, model.probe], alpha[spot])
            for component in range(leaf.value.shape[1]):
                own[found[key] + component][spot] = values[:, component]
            jacobian[spot][:, taken] = 0.0
    if not own:
        return np.zeros((len(sides), 3, 0)), np.zeros(0)
    return np.stack(own, axis=2), np.array(prior)


def _prior(model: Model, place: _Place, how: Weighting) -> list[float]:
    """Information on a new group's parameters: that of the prior where all groups have the same."""
    given = (how.prior_weights * model.scales[: model.nominal])[place.columns] ** 2
    return [float(part[0]) if np.all(part == part[0]) else 0.0 for part in given.T]


def _mounting(probe: np.ndarray, alpha: float) -> np.ndarray:
    """Response to small rotations of the mounting, from that to rotations of the head before the spindle.

    The angles of the mounting themselves do not do: at 90 degrees about y two of them turn about the same axis.
    """
    return probe @ rotation_matrix(np.array([alpha, 0.0, 0.0])).T

"""Composites of local faults: names that fit a part of any residual, and of which several together represent one error without
a name.

A bias that jumps, a mount that slips, outlier positions and a different kind of noise describe a piece of any signal. Two of
them at once have a lower prior probability (`priors.SIZE_PRIOR`) than one error that is not in the catalogue. Only the
evidence of lack of fit, whose curves are smooth, is lower. They therefore form one class with it. A mount that rotates steadily
and also slips is one that rotates by a different curve. Neighbouring outlier positions are not two accidents. Nor is an outlier
position at which the input of a jump is near zero: an error that jumps with the output (a dead zone), and not with the input,
differs there by the bias.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool

from tumblecal.diagnosis.causes.cause import id_of
from tumblecal.diagnosis.causes.terms import JUMPS
from tumblecal.full_model.tangent import Tangent
from tumblecal.ground.axes import AXES
from tumblecal.ground.showing import brief


_POSITIONS = "outlier_position"
_SLIP, _TURNING = "mount_slip", {"mount_drift", "mount_temperature"}
# What jumps with an input's sign by a constant, and how far (g) a bias lets the output be from zero where the input is not.
_JUMP, _BIAS_G = "bias_asymmetry", 0.05
# An attitude up to so many times as far as the nearest one is a neighbour of a position.
_BESIDE = 1.5


@dataclass(frozen=True)
class Neighbours:
    """Neighbouring positions of a problem: measured one after the other, or at the nearest attitudes."""

    __repr__ = brief

    at: Tangent

    def touch(self, labels: Sequence[str]) -> bool:
        """Whether each of the outlier positions is a neighbour of another one, or two repeat an attitude, by their labels."""
        off = [label.partition(":")[2] for label in labels if id_of(label) == _POSITIONS]
        if len(off) < 2:
            return False
        rows = [self.at.problem.names.index(name) for name in off]
        attitudes = self.at.problem.where.attitude[rows]
        return len(np.unique(attitudes)) < len(rows) or bool(np.all(np.any(self._near[np.ix_(rows, rows)], axis=1)))

    def at_a_jump(self, labels: Sequence[str]) -> bool:
        """Whether one of the outlier positions has an input near zero with which another of the causes jumps."""
        off = [self.at.problem.names.index(label.partition(":")[2]) for label in labels if id_of(label) == _POSITIONS]
        jumping = [AXES.index(axis) for name, _, axis in (label.partition(".") for label in labels) if name == _JUMP]
        inputs = np.asarray(self.at.evaluation.inputs)
        return bool(np.any(np.abs(inputs[np.ix_(off, jumping)]) < _BIAS_G)) if off and jumping else False

    @cached_property
    def _near(self) -> Bool[np.ndarray, "positions positions"]:
        order = self.at.problem.where.measuring_order
        rank = np.argsort(np.argsort(order, kind="stable"), kind="stable")
        following = np.abs(rank[:, None] - rank) == 1
        inputs = np.asarray(self.at.evaluation.inputs)
        apart = np.linalg.norm(inputs[:, None] - inputs, axis=2)
        np.fill_diagonal(apart, np.inf)
        nearest = apart <= _BESIDE * np.min(apart, axis=1)
        return following | nearest | nearest.T


def is_patchwork(labels: Sequence[str], noises: int = 0, neighbours: Neighbours | None = None) -> bool:
    """Whether a set of causes may equally be one error without a name.

    **Arguments:**

    - `labels`: of the set, each jump by its position. `noises`: number of faults of the assumed noise.
    - `neighbours`: of the positions, if any may be an outlier.
    """
    ids = [id_of(label) for label in labels]
    pieces = noises + sum(id in JUMPS for id in ids) + (_POSITIONS in ids)
    if pieces >= 2 or (_SLIP in ids and not _TURNING.isdisjoint(ids)):
        return True
    if neighbours is None or _POSITIONS not in ids:
        return False
    return neighbours.touch(labels) or neighbours.at_a_jump(labels)

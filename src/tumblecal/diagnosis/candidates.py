"""What a set of causes is built of: effects of the catalogue, faults of single positions, generic terms."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.linear import Linear
from tumblecal.diagnosis.model import Model, Slot


# A direction of an effect counts as visible when the nominal model leaves more than this share of it. (At 4 x 12 positions
# 2.6 % of second_order.x are left and 6.6 % of third_order.x: neither may be named without the other.)
VISIBLE = 0.02
# Prior weight of the families: physics of the catalogue, single outlying positions, two exchanged, an angle off by
# a step, and generic terms for causes that no entry describes. Within a family the weight is spread evenly.
FAMILY_WEIGHTS = {"effect": 0.66, "outlier": 0.14, "swap": 0.06, "mislabel": 0.06, "generic": 0.08}
# The test of "is anything wrong" spends its size where it is needed most: large faults are found anyhow.
TEST_WEIGHTS = {"effect": 0.9, "outlier": 0.03, "swap": 0.02, "mislabel": 0.02, "generic": 0.03}
_LOG_FAMILY = {family: float(np.log(weight)) for family, weight in FAMILY_WEIGHTS.items()}
_LOG_TEST = {family: float(np.log(weight)) for family, weight in TEST_WEIGHTS.items()}


class Candidate(NamedTuple):
    """One possible cause (a named tuple: a data set has some hundreds).

    - `family`: effect, outlier, swap, mislabel or generic.
    - `label`: what it is called in an explanation: an id, or an id with the positions' names.
    - `block` (nu, rank): orthonormal basis of the signal that it can make; None for faults without a coefficient.
    - `offset` (nu): the signal of a fault without a coefficient.
    - `log_weight`: logarithm of its share of its family's prior weight.
    - `slot`, `directions`: columns of the full vector that it moves (effects only).
    - `rows`: weighted signal of a generic term.
    - `positions`: positions that it concerns; `words`: description.
    """

    family: str
    label: str
    log_weight: float
    block: Float[np.ndarray, "nu rank"] | None = None
    offset: Float[np.ndarray, " nu"] | None = None
    slot: Slot | None = None
    directions: Float[np.ndarray, "columns rank"] | None = None
    rows: Float[np.ndarray, " rows"] | None = None
    positions: tuple[int, ...] = ()
    words: str = ""

    @property
    def id(self) -> str:
        """The catalogue's id."""
        return self.label.split(":")[0]

    @property
    def rank(self) -> int:
        """Number of coefficients that the data can see."""
        return 0 if self.block is None else self.block.shape[1]


@dataclass(frozen=True)
class Pool:
    """All candidates of one data set, stacked for batched linear algebra."""

    candidates: tuple[Candidate, ...]
    dof: int

    @cached_property
    def blocks(self) -> np.ndarray:
        """Indices of the candidates with coefficients."""
        return np.array([place for place, one in enumerate(self.candidates) if one.block is not None], int)

    @cached_property
    def faults(self) -> np.ndarray:
        """Indices of the candidates without coefficients."""
        return np.array([place for place, one in enumerate(self.candidates) if one.block is None], int)

    @cached_property
    def stacked(self) -> Float[np.ndarray, "nu columns"]:
        """All blocks side by side."""
        return np.concatenate([np.zeros((self.dof, 0)), *(self.candidates[k].block for k in self.blocks)], axis=1)

    @cached_property
    def by_rank(self) -> dict[int, tuple[np.ndarray, np.ndarray]]:
        """For each rank: the candidates' indices and their columns in `stacked` (one row each)."""
        ranks = np.array([self.candidates[k].rank for k in self.blocks], int)
        first = np.concatenate([[0], np.cumsum(ranks)])[:-1]
        groups = {}
        for rank in sorted(set(ranks.tolist())):
            chosen = ranks == rank
            groups[rank] = (self.blocks[chosen], first[chosen][:, None] + np.arange(rank))
        return groups

    @cached_property
    def offsets(self) -> Float[np.ndarray, "nu faults"]:
        """All faults' signals side by side."""
        return np.stack([np.zeros(self.dof), *(self.candidates[k].offset for k in self.faults)], axis=1)[:, 1:]

    @cached_property
    def offset_squares(self) -> Float[np.ndarray, " faults"]:
        """Squared norms of the faults' signals."""
        return np.sum(self.offsets**2, axis=0)

    @cached_property
    def is_generic(self) -> Bool[np.ndarray, " candidates"]:
        """Which candidates are generic terms."""
        return np.array([one.family == "generic" for one in self.candidates], bool)

    @cached_property
    def label_numbers(self) -> tuple[Int[np.ndarray, " candidates"], list[str]]:
        """A number for each candidate's label, and the labels by number, in alphabetical order."""
        labels = sorted({one.label for one in self.candidates})
        place = {label: number for number, label in enumerate(labels)}
        return np.array([place[one.label] for one in self.candidates], np.int64), labels

    @cached_property
    def _axes_of(self) -> dict[str, dict[str, int]]:
        """By family (`second_order` of `second_order.x`): the candidate of each axis, for families seen on all three."""
        found: dict[str, dict[str, int]] = {}
        for place, one in enumerate(self.candidates):
            family, _, axis = one.label.rpartition(".")
            if one.family == "effect" and axis in ("x", "y", "z"):
                found.setdefault(family, {})[axis] = place
        return {family: axes for family, axes in found.items() if len(axes) == 3}

    @property
    def axis_families(self) -> int:
        """Number of families of effects that can act on all three axes."""
        return len(self._axes_of)

    @cached_property
    def _family_at(self) -> dict[int, frozenset[int]]:
        """The candidates of all three axes, for each candidate of such a family."""
        families = (frozenset(axes.values()) for axes in self._axes_of.values())
        return {place: family for family in families for place in family}

    def families_of(self, members: tuple[int, ...]) -> list[frozenset[int]]:
        """The candidates of all three axes, for each family of which a set holds one."""
        return list(dict.fromkeys(self._family_at[place] for place in members if place in self._family_at))

    @cached_property
    def test_log_weights(self) -> Float[np.ndarray, " candidates"]:
        """Logarithms of the weights in the test."""
        return np.array([one.log_weight + _LOG_TEST[one.family] for one in self.candidates])

    @cached_property
    def log_weights(self) -> Float[np.ndarray, " candidates"]:
        """Logarithms of the prior weights."""
        return np.array([one.log_weight + _LOG_FAMILY[one.family] for one in self.candidates])


@dataclass(frozen=True)
class Visibility:
    """What the nominal model leaves of an effect: `block` its visible orthonormal part, `directions` the coefficients'
    directions that make it, `hidden` those that are absorbed; `projected` the norm in the residual space of one scale
    unit of each coefficient, `whole` that before the projection."""

    slot: Slot
    block: Float[np.ndarray, "nu rank"]
    directions: Float[np.ndarray, "columns rank"]
    hidden: Float[np.ndarray, "columns absorbed"]
    projected: Float[np.ndarray, " columns"]
    whole: Float[np.ndarray, " columns"]


_ONE, _NONE = np.ones((1, 1)), np.zeros((1, 0))


def visibility(
    full: Float[np.ndarray, "rows columns"],
    seen: Float[np.ndarray, "nu columns"],
    projected: Float[np.ndarray, " columns"],
    whole: Float[np.ndarray, " columns"],
    slot: Slot,
) -> Visibility:
    """Split an effect's coefficient directions into those that the residuals can show and those absorbed.

    **Arguments:**

    - `full`: Jacobian of the effect's coefficients; `seen`: the same in the residual space.
    - `whole`, `projected`: norms of their columns.
    """
    if seen.shape[1] == 1:
        shown = projected[0] > VISIBLE * whole[0]
        block = seen / projected if shown else seen[:, :0]
        return Visibility(slot, block, _ONE if shown else _NONE, _NONE if shown else _ONE, projected, whole)
    left, singular, right = np.linalg.svd(seen, full_matrices=seen.shape[0] < seen.shape[1])
    singular = np.concatenate([singular, np.zeros(len(right) - len(singular))])
    unprojected = np.linalg.norm(full @ right.T, axis=0)
    shown = singular > VISIBLE * unprojected
    return Visibility(
        slot,
        left[:, shown[: left.shape[1]]],
        right.T[:, shown],
        right.T[:, ~shown],
        projected,
        whole,
    )


def effect_candidates(model: Model, linear: Linear) -> tuple[list[Candidate], list[Visibility]]:
    """Candidates for every visible effect, and the visibility of all of them."""
    projected = linear.basis.T @ linear.jacobian
    sizes, wholes = np.linalg.norm(projected, axis=0), np.linalg.norm(linear.jacobian, axis=0)
    seen = []
    for slot in model.slots:
        columns = list(slot.columns)
        if len(columns) == columns[-1] - columns[0] + 1:
            columns = slice(columns[0], columns[-1] + 1)
        seen.append(
            visibility(linear.jacobian[:, columns], projected[:, columns], sizes[columns], wholes[columns], slot)
        )
    shown = [one for one in seen if one.block.shape[1]]
    ids = {one.slot.id for one in shown}
    variants = {id: sum(one.slot.id == id for one in shown) for id in ids}
    candidates = [
        Candidate(
            "effect",
            one.slot.id,
            -np.log(len(ids) * variants[one.slot.id]),
            block=one.block,
            slot=one.slot,
            directions=one.directions,
        )
        for one in shown
    ]
    return candidates, seen

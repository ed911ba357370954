"""All causes of one data set, stacked for batched linear algebra."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.causes import Cause, EffectCause, Visibility, effect_causes
from tumblecal.diagnosis.fault_causes import FAULTS
from tumblecal.diagnosis.generic_causes import generic_causes
from tumblecal.diagnosis.jump_causes import jumps
from tumblecal.diagnosis.shape_causes import shape_causes
from tumblecal.diagnosis.tangent import Tangent
from tumblecal.diagnosis.tuning import COLLINEAR, FAMILY_TEST_WEIGHT
from tumblecal.ground.showing import brief


class Tested(NamedTuple):
    """Orthonormal blocks side by side (nu, columns), the first column of each, its number of columns, and the logarithm of
    its weight in the test."""

    columns: Float[np.ndarray, "nu columns"]
    first: Int[np.ndarray, " blocks"]
    ranks: Int[np.ndarray, " blocks"]
    log_weights: Float[np.ndarray, " blocks"]


@dataclass(frozen=True)
class Pool:
    """The causes in a residual space of dimension `dof`.

    `seen`: what is visible of every effect. `generic`: the numbers of the generic terms among the causes.
    """

    __repr__ = brief

    causes: tuple[Cause, ...]
    dof: int
    seen: tuple[Visibility, ...] = ()
    generic: tuple[int, ...] = ()

    @cached_property
    def _coefficients(self) -> Int[np.ndarray, " causes"]:
        """Number of coefficients of every cause, -1 for one without any."""
        return np.array([-1 if cause.block is None else cause.block.shape[1] for cause in self.causes], int)

    @cached_property
    def ranks(self) -> Int[np.ndarray, " causes"]:
        """The rank of each cause's block, 0 where it has none."""
        return np.maximum(self._coefficients, 0)

    @cached_property
    def blocks(self) -> np.ndarray:
        """Indices of the causes with coefficients, those of the lowest rank first."""
        have = np.flatnonzero(self._coefficients >= 0)
        return have[np.argsort(self._coefficients[have], kind="stable")]

    @cached_property
    def faults(self) -> np.ndarray:
        """Indices of the causes without coefficients."""
        return np.flatnonzero(self._coefficients < 0)

    @cached_property
    def stacked(self) -> Float[np.ndarray, "nu columns"]:
        """All blocks side by side, in the order of `blocks`."""
        each = (block.T for k in self.blocks.tolist() if (block := self.causes[k].block) is not None)
        return np.concatenate([np.zeros((0, self.dof)), *each]).T

    @cached_property
    def first_columns(self) -> Int[np.ndarray, " causes"]:
        """Where each cause's columns begin in `stacked`; 0 for those without a block."""
        first, ranks = np.zeros(len(self.causes), int), self.ranks[self.blocks]
        first[self.blocks] = np.cumsum(ranks) - ranks
        return first

    @cached_property
    def offsets(self) -> Float[np.ndarray, "nu faults"]:
        """All offsets side by side."""
        return np.array([cause.offset for cause in self.causes if cause.offset is not None]).reshape(-1, self.dof).T

    @cached_property
    def offset_squares(self) -> Float[np.ndarray, " faults"]:
        """Squared norms of the offsets."""
        return np.sum(self.offsets**2, axis=0)

    @cached_property
    def is_named(self) -> Bool[np.ndarray, " causes"]:
        """Which causes the catalogue describes."""
        return np.array([cause.named for cause in self.causes], bool)

    @cached_property
    def is_outlier(self) -> Bool[np.ndarray, " causes"]:
        """Which causes are positions that the fit does without."""
        return np.array([bool(cause.left_out) for cause in self.causes], bool)

    @cached_property
    def outlying(self) -> frozenset[int]:
        """Indices of these."""
        return frozenset(np.flatnonzero(self.is_outlier).tolist())

    @cached_property
    def effects(self) -> np.ndarray:
        """Indices of the effects of the catalogue."""
        return np.flatnonzero([isinstance(cause, EffectCause) for cause in self.causes])

    @property
    def named_effects(self) -> list[Cause]:
        """The effects of the catalogue."""
        return [self.causes[k] for k in self.effects.tolist()]

    @cached_property
    def other_starts(self) -> dict[int, list[int]]:
        """The causes that are the same effect from another start of its time constant, for each cause that has such."""
        alike: dict[str, list[int]] = {}
        for k in self.effects.tolist():
            alike.setdefault(self.causes[k].label, []).append(k)
        return {k: [other for other in same if other != k] for same in alike.values() if len(same) > 1 for k in same}

    @property
    def visible(self) -> frozenset[str]:
        """Ids of the effects of the catalogue among the causes."""
        return frozenset(self.causes[k].label for k in self.effects.tolist())

    @cached_property
    def label_numbers(self) -> tuple[Int[np.ndarray, " causes"], list[str]]:
        """A number for each cause's label, and the labels by number, in alphabetical order."""
        labels = sorted({cause.label for cause in self.causes})
        number = {label: k for k, label in enumerate(labels)}
        return np.array([number[cause.label] for cause in self.causes], np.int64), labels

    @cached_property
    def _axes_of(self) -> dict[str, dict[str, int]]:
        """By family (`second_order` of `second_order.x`): the cause of each axis, for families seen on all three."""
        by_family: dict[str, dict[str, int]] = {}
        for k, cause in enumerate(self.causes):
            if cause.family is not None:
                by_family.setdefault(cause.family[0], {})[cause.family[1]] = k
        return {family: axes for family, axes in by_family.items() if len(axes) == 3}

    @cached_property
    def tested(self) -> "Tested":
        """The causes with coefficients, and each family on all three axes, as the test takes them."""
        families = self._on_all_axes
        ranks = np.concatenate([self.ranks[self.blocks], np.array([block.shape[1] for block in families], int)])
        # Several families share the weight of all.
        of_family = np.full(len(families), np.log(FAMILY_TEST_WEIGHT / max(self.axis_families, 1)))
        weights = np.concatenate([self.test_log_weights[self.blocks], of_family])
        columns = np.concatenate([self.stacked.T, *(block.T for block in families)]).T
        seen = ranks > 0
        return Tested(columns, (np.cumsum(ranks) - ranks)[seen], ranks[seen], weights[seen])

    @property
    def _on_all_axes(self) -> list[Float[np.ndarray, "nu rank"]]:
        """Orthonormal basis of each family on all three axes."""
        by_width: dict[int, list[np.ndarray]] = {}
        for axes in self._axes_of.values():
            blocks = (self.causes[k].block for k in axes.values())
            together = np.concatenate([block for block in blocks if block is not None], axis=1)
            by_width.setdefault(together.shape[1], []).append(together)
        bases = []
        for alike in by_width.values():
            left, singular, _ = np.linalg.svd(np.stack(alike), full_matrices=False)
            bases += [own[:, sizes**2 > COLLINEAR] for own, sizes in zip(left, singular, strict=True)]
        return bases

    @property
    def families(self) -> list[tuple[int, ...]]:
        """The causes of each family seen on all three axes."""
        return [tuple(sorted(axes.values())) for axes in self._axes_of.values()]

    @property
    def axis_families(self) -> int:
        """Number of families of effects that can act on all three axes."""
        return len(self._axes_of)

    @cached_property
    def _family_at(self) -> dict[int, frozenset[int]]:
        """The causes of all three axes, for each cause of such a family."""
        families = (frozenset(axes.values()) for axes in self._axes_of.values())
        return {k: family for family in families for k in family}

    def families_of(self, members: tuple[int, ...]) -> list[frozenset[int]]:
        """The causes of all three axes, for each family of which a set holds one."""
        return list(dict.fromkeys(self._family_at[k] for k in members if k in self._family_at))

    @cached_property
    def test_log_weights(self) -> Float[np.ndarray, " causes"]:
        """Logarithms of the weights in the test."""
        return np.array([cause.log_test_weight for cause in self.causes])

    @cached_property
    def log_weights(self) -> Float[np.ndarray, " causes"]:
        """Logarithms of the prior weights."""
        return np.array([cause.log_weight for cause in self.causes])

    def in_units_of(self, sigma: float) -> "Pool":
        """The pool for residuals counted in units of sigma."""
        if sigma == 1.0:
            return self
        causes = (
            cause if cause.offset is None else cause._replace(offset=cause.offset / sigma) for cause in self.causes
        )
        return Pool(tuple(causes), self.dof)


def pooled(
    at: Tangent, level: float, generic: tuple[int, ...] | None = None, visible: frozenset[str] | None = None
) -> Pool:
    """Effects of the catalogue, faults of single positions, jumps at one, and generic terms.

    **Arguments:**

    - `level`: sd of the white rows; faults smaller than a few of it are no candidates.
    - `generic`: numbers of the generic terms to be taken; chosen here where left out.
    - `visible`: the effects that are visible where nothing is wrong: beside a large effect others seem to be, which only
      change its size. All that are visible here where left out.
    """
    effects, seen = effect_causes(at)
    if visible is not None:
        # Of one that jumps with an input's sign, what is visible hangs on the signs: on where the model is linearised.
        effects = [
            cause
            for cause in effects
            if cause.label in visible or cause.slot.kinked or np.any(at.vector[list(cause.slot.columns)])
        ]
    faults = [cause for candidates in (*FAULTS, jumps) for cause in candidates(at, level)]
    terms, generic = generic_causes(at, effects, generic)
    return Pool((*effects, *faults, *terms, *shape_causes(at)), at.dof, tuple(seen), generic)

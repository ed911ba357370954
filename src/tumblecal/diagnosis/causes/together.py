"""Effects that are one cause together: the axes of a family, and the powers of one variable on one output, a polynomial."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from tumblecal.diagnosis.causes.cause import family_of
from tumblecal.diagnosis.priors import FAMILY_TEST_WEIGHT, OF_ORDERS
from tumblecal.effects import AXES
from tumblecal.full_model.layout import Slot
from tumblecal.ground.showing import brief


def polynomials(slots: Sequence[Slot]) -> list[tuple[int, ...]]:
    """Numbers of the effects that are powers of one variable on one output, the lowest first, of each with two or more."""
    powers: dict[tuple[str, ...], dict[int, int]] = {}
    for number, slot in enumerate(slots):
        if slot.polynomial:
            powers.setdefault(slot.polynomial, {}).setdefault(slot.order, number)
    return [tuple(own[order] for order in sorted(own)) for own in powers.values() if len(own) > 1]


@dataclass(frozen=True)
class Together:
    """The candidates of a table of `size` that are one cause together: the effects of each family that is there on all three
    `axes`, and `polynomials`, the lowest power first."""

    __repr__ = brief

    size: int
    axes: Int[np.ndarray, "families 3"]
    polynomials: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, size: int, effects: Sequence[int], labels: Sequence[str], slots: Sequence[Slot]) -> "Together":
        """Of some effects by their numbers; `labels`, `slots`: of all candidates. Of an effect with several starts the last."""
        families: dict[str, dict[str, int]] = {}
        for k in effects:
            if (family := family_of(labels[k])) is not None:
                families.setdefault(family[0], {})[family[1]] = k
        axes = [[own[axis] for axis in AXES] for own in families.values() if len(own) == len(AXES)]
        powers = polynomials([slots[k] for k in effects])
        return cls(
            size, np.array(axes, int).reshape(-1, 3), tuple([tuple([effects[k] for k in own]) for own in powers])
        )

    @cached_property
    def groups(self) -> list[tuple[int, ...]]:
        """The families, then the lowest powers of each polynomial: no smaller steps of a search need lead to one."""
        orders = [own[:count] for own in self.polynomials for count, _ in OF_ORDERS if count <= len(own)]
        return [tuple(sorted(own)) for own in (*self.axes.tolist(), *orders)]

    @cached_property
    def test_log_weights(self) -> Float[np.ndarray, " groups"]:
        """Of the groups: the families share a weight in the test; polynomials have none."""
        weights = np.full(len(self.groups), -np.inf)
        weights[: len(self.axes)] = np.log(FAMILY_TEST_WEIGHT / max(len(self.axes), 1))
        return weights

    @cached_property
    def family(self) -> Int[np.ndarray, " causes"]:
        """The number of each candidate's family in `axes`, -1 for one without."""
        family = np.full(self.size, -1)
        family[self.axes] = np.arange(len(self.axes))[:, None]
        return family

    @cached_property
    def polynomial(self) -> Int[np.ndarray, " causes"]:
        """The number of each candidate's polynomial, -1 for one without."""
        number = np.full(self.size, -1)
        for k, own in enumerate(self.polynomials):
            number[list(own)] = k
        return number

    @cached_property
    def lower(self) -> Int[np.ndarray, " causes"]:
        """How many lower powers each candidate's polynomial has."""
        lower = np.zeros(self.size, int)
        for own in self.polynomials:
            lower[list(own)] = range(len(own))
        return lower

    @cached_property
    def partners(self) -> Int[np.ndarray, "causes most"]:
        """The other axes and the other powers of each candidate, then -1."""
        others: dict[int, set[int]] = {}
        for own in (*self.axes.tolist(), *self.polynomials):
            for cause in own:
                others.setdefault(cause, set()).update(own)
        partners = np.full((self.size, 1 + max(map(len, others.values()), default=0)), -1)
        for cause, own in others.items():
            partners[cause, : len(own) - 1] = sorted(own - {cause})
        return partners

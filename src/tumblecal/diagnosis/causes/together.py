"""Effects that are one cause together: the axes of a family, and the powers of one variable on one output, a polynomial."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from jaxtyping import Float, Int

from tumblecal.diagnosis.causes.cause import family_of
from tumblecal.diagnosis.priors import COLLINEAR
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


@lru_cache(maxsize=64)
def on_axes(labels: tuple[str, ...]) -> Int[np.ndarray, "families 3"]:
    """The effects of each family seen on all three axes; of an effect with several starts the last."""
    families: dict[str, dict[str, int]] = {}
    for k, label in enumerate(labels):
        if (family := family_of(label)) is not None:
            families.setdefault(family[0], {})[family[1]] = k
    on_all = [[axes[axis] for axis in AXES] for axes in families.values() if len(axes) == len(AXES)]
    return np.array(on_all, int).reshape(-1, len(AXES))


@dataclass(frozen=True)
class Together:
    """The causes of a pool of `size` that are one together: `axes` of families, and `polynomials`, the lowest power first."""

    __repr__ = brief

    size: int
    axes: Int[np.ndarray, "families 3"]
    polynomials: tuple[tuple[int, ...], ...]

    @cached_property
    def family(self) -> Int[np.ndarray, " causes"]:
        """The number of each cause's family in `axes`, -1 for one without."""
        family = np.full(self.size, -1)
        family[self.axes] = np.arange(len(self.axes))[:, None]
        return family

    @cached_property
    def polynomial(self) -> Int[np.ndarray, " causes"]:
        """The number of each cause's polynomial, -1 for one without."""
        number = np.full(self.size, -1)
        for k, own in enumerate(self.polynomials):
            number[list(own)] = k
        return number

    @cached_property
    def lower(self) -> Int[np.ndarray, " causes"]:
        """How many lower powers each cause's polynomial has."""
        lower = np.zeros(self.size, int)
        for own in self.polynomials:
            lower[list(own)] = range(len(own))
        return lower

    @cached_property
    def partners(self) -> Int[np.ndarray, "causes most"]:
        """The other axes and the other powers of each cause, then -1."""
        others: dict[int, set[int]] = {}
        for own in (*self.axes.tolist(), *self.polynomials):
            for cause in own:
                others.setdefault(cause, set()).update(own)
        partners = np.full((self.size, 1 + max(map(len, others.values()), default=0)), -1)
        for cause, own in others.items():
            partners[cause, : len(own) - 1] = sorted(own - {cause})
        return partners


def family_bases(
    rows: Float[np.ndarray, "rows nu"], first: Int[np.ndarray, "families 3"], ranks: Int[np.ndarray, "families 3"]
) -> tuple[Float[np.ndarray, "bases nu"], Int[np.ndarray, " families"]]:
    """Orthonormal bases of the families on all three axes, as rows, one family after the other, and their ranks.

    **Arguments:**

    - `rows`: of the pool's causes; `first`, `ranks`: where those of each family begin on each axis, and how many there are.
    """
    bases, counts = [np.zeros((0, rows.shape[1]))], [np.zeros(0, int)]
    for columns in _by_width(*(tuple(map(tuple, own.tolist())) for own in (first, ranks))):
        values, vectors = np.linalg.eigh(rows[columns] @ rows[columns].mT)
        seen = values > COLLINEAR
        bases.append((vectors.mT @ rows[columns] / np.sqrt(np.maximum(values, COLLINEAR))[:, :, None])[seen])
        counts.append(seen.sum(axis=1))
    return np.concatenate(bases), np.concatenate(counts)


@lru_cache(maxsize=64)
def _by_width(
    first: tuple[tuple[int, ...], ...], ranks: tuple[tuple[int, ...], ...]
) -> list[Int[np.ndarray, "families width"]]:
    """The columns of families, those of equally many together, by the first column and the rank on each axis."""
    by_width: dict[int, list[list[int]]] = {}
    for own in zip(first, ranks, strict=True):
        columns = [column for begin, rank in zip(*own, strict=True) for column in range(begin, begin + rank)]
        by_width.setdefault(len(columns), []).append(columns)
    return [np.array(columns, int) for _, columns in sorted(by_width.items())]

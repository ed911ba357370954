"""A class of explanations as a product: which of its causes can be exchanged for which others while the rest stays."""

from collections.abc import Collection, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float


# Ids of the causes of one explanation.
Labels = tuple[str, ...]


class Exchange(NamedTuple):
    """Some causes of the leading explanation and those that can replace them; `labels`: the explanation in which they do;
    `identical`: whether the two are one function at 1 g."""

    removed: frozenset[str]
    added: frozenset[str]
    labels: Labels
    identical: bool = False


def membership(sets: Sequence[Sequence[str]]) -> tuple[Float[np.ndarray, "sets names"], list[str]]:
    """Which names (1, else 0) each set has, and the names."""
    number = {name: k for k, name in enumerate(dict.fromkeys(name for own in sets for name in own))}
    has = np.zeros((len(sets), len(number)))
    for row, own in enumerate(sets):
        has[row, [number[name] for name in own]] = 1.0
    return has, list(number)


def supersets(best: Labels, equivalents: Sequence[Labels]) -> tuple[Labels, ...]:
    """The members of a class that contain another member and more. The other member makes the signal alone, so the further
    coefficients are not significant (below some 2 u)."""
    members = [frozenset(labels) for labels in (best, *equivalents)]
    return tuple([labels for labels in equivalents if any(other < frozenset(labels) for other in members)])


def exchanges(best: Labels, equivalents: Sequence[Labels], identical: Collection[Labels] = ()) -> list[Exchange]:
    """The exchanges of which the members of a class without supersets are made: those that are no combination of smaller ones,
    in the order of `equivalents`. Of one that contains a smaller one what remains is an exchange as well.

    **Arguments:**

    - `identical`: those of `equivalents` that are one function with the leading explanation at 1 g: so is each axis alone.
    """
    leading, listed = frozenset(best), list[Exchange]()
    differ = [
        Exchange(leading - {*labels}, frozenset(labels) - leading, labels, labels in identical)
        for labels in equivalents
    ]
    differ = [own for exchange in differ for own in (_by_axis(exchange) if exchange.identical else [exchange])]
    for removed, added, labels, same in sorted(differ, key=lambda own: (len(own.removed), len(own.added))):
        for smaller in listed:
            if smaller.removed < removed and smaller.added < added:
                removed, added = removed - smaller.removed, added - smaller.added
        if not any(removed == other.removed and added == other.added for other in listed):
            listed.append(Exchange(removed, added, labels, same))
    order = {labels: number for number, labels in enumerate(equivalents)}
    return sorted(listed, key=lambda own: order[own.labels])


def _by_axis(exchange: Exchange) -> list[Exchange]:
    """One exchange for each output axis, where both sides have the same axes; else the exchange as it is."""
    sides = [
        {label.rpartition(".")[2]: frozenset([label]) for label in own} for own in (exchange.removed, exchange.added)
    ]
    if (
        sides[0].keys() != sides[1].keys()
        or len(sides[0]) != len(exchange.removed)
        or len(sides[1]) != len(exchange.added)
    ):
        return [exchange]
    return [Exchange(sides[0][axis], sides[1][axis], exchange.labels, True) for axis in sides[0]]


def parts(best: Labels, whole: Iterable[Collection[str]]) -> list[Labels]:
    """The causes of an explanation in the order of `best`, those together that are `whole`: that an exchange replaces together,
    or the powers of a polynomial."""
    together = [{label} for label in best]
    for own in whole:
        touched = [part for part in together if not part.isdisjoint(own)]
        if touched:
            joined = set[str]().union(*touched)
            together = [joined if part is touched[0] else part for part in together if part not in touched[1:]]
    return [tuple(label for label in best if label in part) for part in together]

"""The members of a class of indistinguishable explanations, written as a product of causes that replace one another."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product


@dataclass(frozen=True)
class ClassMembers:
    """A class as a product.

    - `exchangeable`: for a cause of the best explanation those sets that take its place while the rest stays.
    - `others`: members that are no combination of these. Members that only add causes to another member are left out.
    """

    exchangeable: dict[str, list[tuple[str, ...]]]
    others: list[tuple[str, ...]]


def class_members(best: tuple[str, ...], equivalents: Sequence[tuple[str, ...]]) -> ClassMembers:
    """The class of an explanation and its equivalents, labels each."""
    sets = [frozenset(labels) for labels in (best, *equivalents)]
    smallest = [labels for labels in equivalents if not any(other < {*labels} for other in sets)]
    exchangeable: dict[str, list[tuple[str, ...]]] = {}
    for labels in smallest:
        gone, new = [k for k in best if k not in labels], tuple([k for k in labels if k not in best])
        if len(gone) == 1 and new:
            exchangeable.setdefault(gone[0], []).append(new)
    choices = product(*([(label,), *exchangeable.get(label, [])] for label in best))
    combined = {frozenset(label for part in chosen for label in part) for chosen in choices}
    return ClassMembers(exchangeable, [labels for labels in smallest if frozenset(labels) not in combined])

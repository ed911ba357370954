"""Changes of an order by its visits: a visit is a stretch of positions of one temperature, mounting and pitch setting."""

import numpy as np
from jaxtyping import Int


Order = Int[np.ndarray, " positions"]


def nested(order: Order, *levels: Int[np.ndarray, " positions"]) -> Order:
    """An order with the fewest changes of the first level, then of the second, and so on: one visit of each combination.

    Values of a level, and positions within the last one, come in the order of their first occurrence. Values of the next level
    come in the reverse order if the first of them is then the last one before: that saves a change.
    """
    if not levels:
        return order
    values = list(dict.fromkeys(levels[0][order].tolist()))
    parts = [nested(order[levels[0][order] == value], *levels[1:]) for value in values]
    if len(levels) == 1:
        return np.concatenate(parts)
    joined = parts[0]
    for part in parts[1:]:
        turned = _reversed_visits(part, levels[1])
        same = levels[1][turned[0]] == levels[1][joined[-1]]
        joined = np.concatenate([joined, turned if same else part])
    return joined


def visits(order: Order, group: Int[np.ndarray, " positions"]) -> list[Order]:
    """The visits of an order; `group`: combination of settings of each position."""
    return np.split(order, np.flatnonzero(np.diff(group[order])) + 1) if len(order) else []


def _reversed_visits(order: Order, group: Int[np.ndarray, " positions"]) -> Order:
    return np.concatenate(visits(order, group)[::-1])


def mirrored(order: Order, group: Int[np.ndarray, " positions"], rng: np.random.Generator) -> Order:
    """Every visit in two halves: the first halves, then the second ones in the reverse order."""
    halves = [np.array_split(rng.permutation(visit), 2) for visit in visits(order, group)]
    return np.concatenate([half[0] for half in halves] + [half[1] for half in halves[::-1]])


def changed(order: Order, group: Int[np.ndarray, " positions"], rng: np.random.Generator) -> Order:
    """An order with one random change of its visits: two of them exchanged, some of them or their positions reversed, one
    moved, split, or joined with another one of its settings. With a single visit two of its positions are exchanged."""
    parts = visits(order, group)
    count = len(parts)
    kind = rng.integers(5) if count > 1 else -1
    first, last = np.sort(rng.choice(count, 2, replace=False)) if count > 1 else (0, 0)
    if kind == -1:
        parts = [_exchanged(order, rng)]
    elif kind == 0:
        parts[first], parts[last] = parts[last], parts[first]
    elif kind == 1:
        parts[first : last + 1] = parts[first : last + 1][::-1]
    elif kind == 2:
        parts.insert(int(rng.integers(count)), parts.pop(int(rng.integers(count))))
    elif kind == 3:
        taken = int(rng.integers(count))
        some = rng.permutation(parts[taken])
        share = int(rng.integers(1, max(len(some), 2)))
        parts[taken] = some[share:]
        parts.insert(int(rng.integers(count + 1)), some[:share])
    else:
        labels = np.array([group[part[0]] for part in parts])
        taken = int(rng.integers(count))
        same = np.setdiff1d(np.flatnonzero(labels == labels[taken]), [taken])
        if len(same):
            into = int(rng.choice(same))
            parts[into] = np.concatenate([parts[into], parts[taken]])
            parts.pop(taken)
        else:
            parts[first : last + 1] = [np.concatenate(parts[first : last + 1])[::-1]]
    return np.concatenate(parts)


def _exchanged(order: Order, rng: np.random.Generator) -> Order:
    order = order.copy()
    if len(order) > 1:
        first, second = rng.choice(len(order), 2, replace=False)
        order[[first, second]] = order[[second, first]]
    return order


def pairs_of_groups(
    labels: Int[np.ndarray, " positions"], most: int, rng: np.random.Generator
) -> Int[np.ndarray, "pairs 2"]:
    """Pairs of positions of one group; a random share of them if there are more than `most`."""
    first, second = np.triu_indices(len(labels), 1)
    same = np.flatnonzero(labels[first] == labels[second])
    if len(same) > most:
        same = rng.choice(same, most, replace=False)
    return np.stack([first[same], second[same]], axis=1)

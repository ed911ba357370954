"""Sets of causes with the same names, taken together."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.causes.cause import UNEXPLAINED
from tumblecal.diagnosis.causes.pool import Pool
from tumblecal.diagnosis.sets.cause_sets import Ranked, keys_of
from tumblecal.diagnosis.sets.patchwork import Neighbours, is_patchwork
from tumblecal.diagnosis.sets.prior import SetPriors
from tumblecal.diagnosis.sets.search import Search


# Only the best sets are compared with each other.
_MOST_COMPARED = 60
# Decimal digits of log posteriors beyond which they are equal.
_EQUAL_DIGITS = 6


class Groups(NamedTuple):
    """Sets with the same names taken together, group by group.

    - `labels`: their names; `log_posterior`: of the group. `sets`: the best of each as a row, its representative; empty where
      that is a noise alternative. `causes`: how many that counts for; `log_prior`: its own.
    """

    labels: list[tuple[str, ...]]
    log_posterior: Float[np.ndarray, " groups"]
    sets: Int[np.ndarray, "groups most"]
    causes: Int[np.ndarray, " groups"]
    log_prior: Float[np.ndarray, " groups"]

    @property
    def unnamed(self) -> Bool[np.ndarray, " groups"]:
        """Which have a cause that no entry describes."""
        return np.array([UNEXPLAINED in own for own in self.labels], bool)

    def patchwork(self, neighbours: Neighbours | None) -> list[int]:
        """Numbers of those that may as well be one thing without a name."""
        named = [(k, own) for k, own in enumerate(self.labels) if UNEXPLAINED not in own]
        return [k for k, own in named if is_patchwork(own, neighbours=neighbours)]

    def with_noise(self, noise: dict[str, float]) -> "Groups":
        """With alternatives that are covariances, by the log posterior of each label, the most probable first; an unexplained
        one joins the explanations by generic terms."""
        labels = [*self.labels, *((label,) for label in noise if (label,) not in self.labels)]
        further = len(labels) - len(self.labels)
        values = np.array([noise.get(own[0], -np.inf) if len(own) == 1 else -np.inf for own in labels])
        before = np.append(self.log_posterior, np.full(further, -np.inf))
        leads = values > before
        sets = np.concatenate([self.sets, np.full((further, self.sets.shape[1]), -1)])
        counted = (
            np.where(leads, 0, np.append(own, np.zeros(further, own.dtype))) for own in (self.causes, self.log_prior)
        )
        together, sets = np.logaddexp(before, values), np.where(leads[:, None], -1, sets)
        order = _best_first(together)
        return Groups(
            [labels[k] for k in order.tolist()], together[order], sets[order], *(own[order] for own in counted)
        )


def grouped(search: Search, ranked: Ranked) -> tuple[Groups, float]:
    """Sets with the same names added up (several generic terms are one `unexplained`), the best of each group kept as
    its representative: the best groups, and the logarithm of the sum over all."""
    numbers, names = _label_numbers(search.pool, ranked.members)
    labels = np.sort(numbers[ranked.members], axis=1)
    labels[:, 1:][labels[:, 1:] == labels[:, :-1]] = -1
    labels = np.sort(labels, axis=1)
    _, first, group = np.unique(keys_of(labels), return_index=True, return_inverse=True)
    top = ranked.log_posterior[first]
    sums = top + np.log(np.bincount(group, np.exp(ranked.log_posterior - top[group])))
    leading = np.flatnonzero(sums >= np.sort(sums)[-_MOST_COMPARED:][0] - 10.0**-_EQUAL_DIGITS)
    leading = leading[np.lexsort(labels[first[leading]].T[::-1])]
    chosen = leading[_best_first(sums[leading])][:_MOST_COMPARED].tolist()
    chosen += [k for k in np.flatnonzero(np.all(labels[first] < 0, axis=1)).tolist() if k not in chosen]
    sets, own = ranked.members[first[chosen]], labels[first[chosen]].tolist()
    named = [tuple([names[number] for number in numbers if number >= 0]) for numbers in own]
    priors = SetPriors.of(search.pool, sets)
    groups = Groups(named, sums[chosen], sets, priors.causes, priors.own)
    return groups, float(np.logaddexp.reduce(sums))


def _best_first(log_posterior: Float[np.ndarray, " groups"]) -> Int[np.ndarray, " groups"]:
    """Numbers of groups in the order of their posteriors; equals stay in the order of their names, which no rounding turns."""
    return np.argsort(-np.round(log_posterior, _EQUAL_DIGITS), kind="stable")


def _label_numbers(pool: Pool, sets: Int[np.ndarray, "sets most"]) -> tuple[Int[np.ndarray, " causes"], list[str]]:
    """A number for the label of every cause that is in one of some sets, -1 at the end for none, and the labels by number, in
    alphabetical order."""
    here = np.zeros(pool.size + 1, bool)
    here[sets] = True
    causes, numbers = np.flatnonzero(here[:-1]).tolist(), np.full(pool.size + 1, -1)
    labels = [pool.labels[k] for k in causes]
    names = sorted(set(labels))
    number = {label: k for k, label in enumerate(names)}
    numbers[causes] = [number[label] for label in labels]
    return numbers, names

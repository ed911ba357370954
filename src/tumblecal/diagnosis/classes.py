"""From scored sets to explanations: the same names together, and what the data cannot tell apart in one class."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

from tumblecal.diagnosis.generic_causes import UNEXPLAINED
from tumblecal.diagnosis.search import Ranked, Search, keys_of
from tumblecal.diagnosis.set_prior import causes_of, log_prior
from tumblecal.diagnosis.tuning import INDISTINGUISHABLE, LEAST_ODDS, NEGLIGIBLE, SURE


# Equivalents of sets less probable than this are not looked for.
LEAST_SHARE = 1e-3
# Only the best sets are compared with each other.
_MOST_COMPARED = 60


@dataclass(frozen=True)
class Explanation:
    """A set of named causes.

    - `labels`: ids, positions after a colon; empty: the model is adequate.
    - `equivalents`: other sets of labels that these data cannot tell from it.
    - `probability`: that the truth is this set or one of its equivalents; `own_probability`: this set alone.
    - `members`: the best set of candidates with these labels; `noise`: the noise alternative where it is one.
    """

    labels: tuple[str, ...]
    equivalents: tuple[tuple[str, ...], ...]
    probability: float
    own_probability: float
    members: tuple[int, ...]
    noise: str = ""

    @property
    def unexplained(self) -> bool:
        """Whether a cause that no entry describes is among them."""
        return UNEXPLAINED in self.labels

    @property
    def single_name(self) -> bool:
        """Whether exactly one set of causes is claimed."""
        return not self.equivalents


@dataclass(frozen=True)
class _Group:
    """Sets with the same names. `causes`: how many the representative counts for; `log_prior`: its own."""

    labels: tuple[str, ...]
    log_posterior: float
    members: tuple[int, ...]
    causes: int = 0
    log_prior: float = 0.0

    @property
    def unnamed(self) -> bool:
        return UNEXPLAINED in self.labels


def explanations(search: Search, ranked: Ranked, noise: dict[str, float], sigma: float) -> list[Explanation]:
    """Explanations, most probable class first.

    **Arguments:**

    - `search`, `ranked`: the sets looked at.
    - `noise`: log posterior of each alternative that is a covariance, on the same scale.
    - `sigma`: noise in the units of the residual vector, for known noise 1.
    """
    groups, total = grouped(search, ranked)
    for label, value in noise.items():
        groups = _with_alternative(groups, label, value)
    groups.sort(key=lambda group: -group.log_posterior)
    total = logsumexp([total, *noise.values()])
    shares = np.exp(np.array([group.log_posterior for group in groups]) - total)
    signals: dict[int, _Signal] = {}
    # By number of causes, as no equal needs more; but what so many named causes can make is not left unexplained.
    counts = [group.causes for group in groups]
    found, used = [], set()
    for k in range(len(groups)):
        if k in used:
            continue
        close = []
        if shares[k] > LEAST_SHARE and counts[k]:
            close = [
                other
                for other, count in enumerate(counts)
                if other not in used
                and other != k
                and (count == counts[k] or (groups[k].unnamed and not groups[other].unnamed and 0 < count <= counts[k]))
            ]
        same = [other for other in close if _same(search, groups, signals, k, other, sigma)]
        used |= {k, *same}
        group = groups[k]
        found.append(
            Explanation(
                labels=group.labels,
                equivalents=tuple(groups[other].labels for other in same),
                probability=float(shares[k] + sum(shares[other] for other in same)),
                own_probability=float(shares[k]),
                members=group.members,
                noise=group.labels[0] if not group.unnamed and group.labels and group.labels[0] in noise else "",
            )
        )
    return sorted(found, key=lambda one: -one.probability)


def _with_alternative(groups: list[_Group], label: str, log_posterior: float) -> list[_Group]:
    """The groups with one that is a covariance; an unexplained one joins what generic terms describe."""
    alone = _Group((label,), log_posterior, ())
    same = next((group for group in groups if group.labels == alone.labels), None)
    if same is None:
        return [*groups, alone]
    leading = max(same, alone, key=lambda group: group.log_posterior)
    together = replace(leading, log_posterior=float(np.logaddexp(same.log_posterior, log_posterior)))
    return [together if group is same else group for group in groups]


def grouped(search: Search, ranked: Ranked) -> tuple[list[_Group], float]:
    """Sets with the same names added up (several generic terms are one `unexplained`), the best of each group kept as
    its representative: the best groups, and the logarithm of the sum over all."""
    numbers, names = search.pool.label_numbers
    labels = np.sort(np.where(ranked.members >= 0, numbers[ranked.members], -1), axis=1)
    labels[:, 1:][labels[:, 1:] == labels[:, :-1]] = -1
    labels = np.sort(labels, axis=1)
    _, first, group = np.unique(keys_of(labels), return_index=True, return_inverse=True)
    top = ranked.log_posterior[first]
    sums = top + np.log(np.bincount(group, np.exp(ranked.log_posterior - top[group])))
    chosen = np.argsort(-sums, kind="stable")[:_MOST_COMPARED].tolist()
    chosen += [k for k in np.flatnonzero(np.all(labels[first] < 0, axis=1)).tolist() if k not in chosen]
    groups = []
    for k in chosen:
        members = ranked.set_at(int(first[k]))
        own = tuple(names[number] for number in labels[first[k]].tolist() if number >= 0)
        count, prior = causes_of(search.pool, members)[0], log_prior(search.pool, members)
        groups.append(_Group(own, float(sums[k]), members, count, prior))
    return groups, float(np.logaddexp.reduce(sums))


def _same(
    search: Search, groups: list[_Group], signals: dict[int, "_Signal"], first: int, second: int, sigma: float
) -> bool:
    """Whether the second set can make the signal that the first one sees, to within what these data could tell."""
    unnamed = groups[first].unnamed and not groups[second].unnamed
    if set(groups[first].labels) < set(groups[second].labels) or set(groups[second].labels) < set(groups[first].labels):
        # Whether one more of a family is needed is for the probabilities to say.
        return False
    odds = groups[first].log_posterior - groups[second].log_posterior
    if not groups[second].unnamed:
        # Equal signals are one class whatever their priors; what some unnamed term can imitate has its name.
        odds -= groups[first].log_prior - groups[second].log_prior
    if odds > (NEGLIGIBLE if unnamed else LEAST_ODDS):
        return False
    for k in (first, second):
        if k not in signals:
            signals[k] = _signal(search, groups[k].members)
    other = signals[second]
    if unnamed and np.linalg.norm(signals[first].signal) < INDISTINGUISHABLE * sigma:
        # What cannot be told from noise every set can make.
        return False
    rest = signals[first].signal - other.offset
    rest = rest - other.basis @ (other.basis.T @ rest)
    return float(np.linalg.norm(rest)) < INDISTINGUISHABLE * sigma


@dataclass(frozen=True)
class _Signal:
    """What a set says that the residual would be without noise: `signal`; it can make `offset` + span of `basis`."""

    signal: Float[np.ndarray, " nu"]
    offset: Float[np.ndarray, " nu"]
    basis: Float[np.ndarray, "nu rank"]


def _signal(search: Search, members: tuple[int, ...]) -> _Signal:
    base = search.base(members)
    offset = search.z - base.z
    return _Signal(offset + base.q @ (base.q.T @ base.z), offset, base.q)


def verdict_of(best: Explanation, otherwise_wrong: bool, implausible_fit: bool, doubtful: bool) -> str:
    """The verdict: adequate, identified, ambiguous or unexplained.

    **Arguments:**

    - `doubtful`: whether what is none of the explanations (an effect that acts in a part of the data alone, something
      unexplained in place of another noise) explains them better, or as well.
    """
    if not best.labels:
        # A fit may be good because a parameter took up what no instrument has: that is no adequate model.
        named = "ambiguous" if doubtful else "identified"
        return "unexplained" if implausible_fit else named if otherwise_wrong else "adequate"
    if best.unexplained and best.single_name:
        return "unexplained"
    return "identified" if best.single_name and best.probability >= SURE and not doubtful else "ambiguous"

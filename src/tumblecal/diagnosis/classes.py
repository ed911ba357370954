"""From scored sets to explanations: the same names together, and what the data cannot tell apart in one class."""

from dataclasses import dataclass, replace

import numpy as np

from tumblecal.diagnosis.cause_sets import keys_of, members_of
from tumblecal.diagnosis.generic_causes import UNEXPLAINED
from tumblecal.diagnosis.partial_set import partial_sets
from tumblecal.diagnosis.search import Ranked, Search
from tumblecal.diagnosis.set_prior import counted_log_priors
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
    total = float(np.logaddexp.reduce([total, *noise.values()]))
    shares = np.exp(np.array([group.log_posterior for group in groups]) - total).tolist()
    alike = _alike(search, groups, _near(groups, shares), INDISTINGUISHABLE * sigma)
    found, used = [], set()
    for k, group in enumerate(groups):
        if k in used:
            continue
        same = [other for other in alike.get(k, []) if other not in used]
        used |= {k, *same}
        found.append(
            Explanation(
                labels=group.labels,
                equivalents=tuple(groups[other].labels for other in same),
                probability=shares[k] + sum(shares[other] for other in same),
                own_probability=shares[k],
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
    sets = ranked.members[first[chosen]]
    named = ([names[number] for number in own if number >= 0] for own in labels[first[chosen]].tolist())
    causes, priors = counted_log_priors(search.pool, sets)
    told = zip(named, sums[chosen].tolist(), sets, causes.tolist(), priors.tolist(), strict=True)
    groups = [_Group(tuple(own), score, members_of(row), *counted) for own, score, row, *counted in told]
    return groups, float(np.logaddexp.reduce(sums))


def _near(groups: list[_Group], shares: list[float]) -> dict[int, list[int]]:
    """For each group that is probable enough those whose names and posteriors let them be one class with it, if they can make
    its signal."""
    causes = np.array([group.causes for group in groups])
    unnamed = np.array([group.unnamed for group in groups], bool)
    posterior = np.array([group.log_posterior for group in groups])
    # Equal signals are one class whatever their priors; what some unnamed term can imitate has its name.
    prior = np.array([group.log_prior for group in groups])
    odds = posterior[:, None] - posterior - np.where(unnamed, 0.0, prior[:, None] - prior)
    # By number of causes, as no equal needs more; but what so many named causes can make is not left unexplained.
    imitated = unnamed[:, None] & ~unnamed
    fewer = (causes[:, None] == causes) | (imitated & (causes > 0) & (causes <= causes[:, None]))
    near = fewer & (odds <= np.where(imitated, NEGLIGIBLE, LEAST_ODDS))
    np.fill_diagonal(near, False)
    labels = [frozenset(group.labels) for group in groups]
    return {
        # Whether one more of a family is needed is for the probabilities to say.
        k: [
            other
            for other in np.flatnonzero(near[k]).tolist()
            if not (labels[k] < labels[other] or labels[other] < labels[k])
        ]
        for k, share in enumerate(shares)
        if share > LEAST_SHARE and groups[k].causes
    }


def _alike(search: Search, groups: list[_Group], near: dict[int, list[int]], least: float) -> dict[int, list[int]]:
    """Of the groups near to each, those that can make the signal that it sees to within `least` (norm).

    The signal is what a representative says that the residual would be without noise; a group can make its offset (its
    faults) and what its blocks span.
    """
    rows = {
        k: row for row, k in enumerate(dict.fromkeys(k for k, others in near.items() if others for k in (k, *others)))
    }
    if not rows:
        return {}
    sets = partial_sets(search.pool, search.z, [groups[k].members for k in rows])
    offsets = search.z - sets.z
    signals = offsets + (sets.along[:, None] @ sets.q)[:, 0]
    squares = np.sum(signals**2, axis=1)
    # What each set leaves of every signal.
    left = squares - 2 * offsets @ signals.T + np.sum(offsets**2, axis=1)[:, None]
    left -= np.sum((sets.q @ signals.T - sets.q @ offsets[:, :, None]) ** 2, axis=1)
    can_make = (left < least**2).tolist()
    alike = {}
    for k, others in near.items():
        # What cannot be told from noise every set can make.
        hidden = bool(others) and groups[k].unnamed and squares[rows[k]] < least**2
        makes = [other for other in others if can_make[rows[other]][rows[k]]]
        alike[k] = [other for other in makes if groups[other].unnamed] if hidden else makes
    return alike


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

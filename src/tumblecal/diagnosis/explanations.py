"""From scored sets to explanations: the same names together, and what the data cannot tell apart in one class."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

from tumblecal.diagnosis.candidates import Pool
from tumblecal.diagnosis.search import Scored, Search


# Two explanations are equivalent for these data when their signals differ by less than three noise sd (norm over all
# readings): the best test would still take one for the other in one case of fifteen (normal tail beyond half of it).
INDISTINGUISHABLE = 3.0
# A set that needs more coefficients for the same signal is no equal: its posterior is lower by more than this (log).
LEAST_ODDS = 4.0
UNEXPLAINED = "unexplained"
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
    def single_name(self) -> bool:
        """Whether exactly one set of causes is claimed."""
        return not self.equivalents


@dataclass(frozen=True)
class _Group:
    labels: tuple[str, ...]
    log_posterior: float
    members: tuple[int, ...]


def explanations(search: Search, scored: list[Scored], noise: dict[str, float], sigma: float) -> list[Explanation]:
    """Explanations, most probable class first.

    **Arguments:**

    - `search`, `scored`: the sets looked at.
    - `noise`: log posterior of each noise alternative, on the same scale.
    - `sigma`: noise in the units of the residual vector, for known noise 1.
    """
    groups = _grouped(search.pool, scored)
    groups += [_Group((label,), value, ()) for label, value in noise.items()]
    groups.sort(key=lambda group: -group.log_posterior)
    logs = np.array([group.log_posterior for group in groups])
    shares = np.exp(logs - logsumexp(logs))
    alive = range(min(len(groups), _MOST_COMPARED))
    signals = {k: _signal(search, groups[k].members) for k in alive if groups[k].members}
    found, used = [], set()
    for k in alive:
        if k in used:
            continue
        same = [
            other for other in alive if other not in used and other != k and _same(groups, signals, k, other, sigma)
        ]
        used |= {k, *same}
        group = groups[k]
        found.append(
            Explanation(
                labels=group.labels,
                equivalents=tuple(groups[other].labels for other in same),
                probability=float(shares[k] + sum(shares[other] for other in same)),
                own_probability=float(shares[k]),
                members=group.members,
                noise=group.labels[0] if group.labels and group.labels[0] in noise else "",
            )
        )
    return sorted(found, key=lambda one: -one.probability)


def labels_of(pool: Pool, members: tuple[int, ...]) -> tuple[str, ...]:
    """Sorted names of a set; several generic terms are one `unexplained`."""
    return tuple(sorted({pool.candidates[k].label for k in members}))


def _log_sum(logs: list[float]) -> float:
    return logs[0] + float(np.log(np.sum(np.exp(np.array(logs) - logs[0]))))


def _grouped(pool: Pool, scored: list[Scored]) -> list[_Group]:
    """Sets with the same names added up, the best of them kept as their representative."""
    together: dict[tuple[str, ...], list[Scored]] = {}
    for one in scored:
        together.setdefault(labels_of(pool, one.members), []).append(one)
    return [
        _Group(labels, _log_sum([one.log_posterior for one in members]), members[0].members)
        for labels, members in together.items()
    ]


def _same(groups: list[_Group], signals: dict[int, "_Signal"], first: int, second: int, sigma: float) -> bool:
    """Whether the second set can make the signal that the first one sees, to within what these data could tell."""
    if len(groups[first].members) != len(groups[second].members) or not groups[first].members:
        return False
    if groups[first].log_posterior - groups[second].log_posterior > LEAST_ODDS:
        return False
    if UNEXPLAINED in groups[first].labels or UNEXPLAINED in groups[second].labels:
        return False
    other = signals[second]
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

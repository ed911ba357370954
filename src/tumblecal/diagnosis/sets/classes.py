"""Classes of indistinguishable explanations: which sets of causes can make the signal of which others.

Two rules go beyond the signals. Powers of one variable on one output are a polynomial, which is one cause, as the reference of
the variable is not known: one more or one fewer of its powers is no other cause. And listed causes lead if they are probable:
an error without a catalogue entry is not claimed then.
"""

from collections.abc import Mapping, Sequence
from operator import attrgetter

import numpy as np
from jaxtyping import Bool, Int

from tumblecal.diagnosis.causes.cause import UNEXPLAINED
from tumblecal.diagnosis.causes.identities import one_function_at_1_g
from tumblecal.diagnosis.causes.pool import Pool
from tumblecal.diagnosis.causes.together import Together
from tumblecal.diagnosis.priors import INDISTINGUISHABLE, LEAST_NAMED, LEAST_ODDS, NEGLIGIBLE
from tumblecal.diagnosis.sets.cause_sets import Members, Ranked, sets_of
from tumblecal.diagnosis.sets.exchanges import Labels, membership
from tumblecal.diagnosis.sets.explanation import Explanation
from tumblecal.diagnosis.sets.groups import Groups, grouped
from tumblecal.diagnosis.sets.partial_set import partial_sets
from tumblecal.diagnosis.sets.patchwork import Neighbours
from tumblecal.diagnosis.sets.search import Search
from tumblecal.diagnosis.sets.setting_changes import SettingChanges
from tumblecal.full_model.layout import Slot


# Equivalents of sets less probable than this are not looked for.
LEAST_SHARE = 1e-3


def explanations(
    search: Search,
    ranked: Ranked,
    noise: dict[str, float],
    sigma: float,
    neighbours: Neighbours | None = None,
    changes: SettingChanges | None = None,
    *,
    named_first: bool = True,
) -> list[Explanation]:
    """Explanations, most probable class first.

    **Arguments:**

    - `search`, `ranked`: the evaluated sets.
    - `noise`: log posterior of each alternative that is a covariance, on the same scale.
    - `sigma`: noise in the units of the residual vector, for known noise 1.
    - `neighbours`: of the positions, if causes may be outlier positions. `changes`: of the settings, if causes may be jumps.
    - `named_first`: whether a listed set may lead in place of one without a name.
    """
    groups, total = grouped(search, ranked)
    groups = groups.with_noise(noise)
    total = float(np.logaddexp.reduce([total, *noise.values()]))
    shares = np.exp(groups.log_posterior - total).tolist()
    # The number -1 means no cause, which has no coefficient.
    coefficients = np.append(search.pool.ranks, 0)[groups.sets].sum(axis=1)
    near, bound = _near(groups, coefficients, shares, changes)
    equivalents = _same_signal(search, groups, near, sigma)
    if (UNEXPLAINED,) in groups.labels:
        unexplained, pieces = groups.labels.index((UNEXPLAINED,)), groups.patchwork(neighbours)
        equivalents |= {k: equivalents.get(k, {}) | {unexplained: np.nan} for k in pieces}
        bound[pieces, unexplained] = True
    found, used, unnamed = [], set(), groups.unnamed.tolist()
    sets, order = sets_of(groups.sets), list(range(len(groups.labels)))
    powers = further_powers(search.pool.together, groups.sets)
    orders = other_orders(search.pool.slots, groups.sets)
    for k in near:
        equivalents[k] = equivalents.get(k, {}) | dict.fromkeys(np.flatnonzero(powers[k] | orders[k]).tolist(), np.nan)
    if named_first and (named := named_in_place(groups.labels, shares, equivalents)) is not None:
        first, unnamed_one = named
        equivalents[first] = {unnamed_one: np.nan} | equivalents.get(first, {})
        bound[first, unnamed_one] = True
        order.sort(key=lambda k: k != first)
    for k in order:
        if k in used:
            continue
        labels, members = groups.labels[k], sets[k]
        same = [other for other in equivalents.get(k, {}) if other not in used]
        used |= {k, *same}
        found.append(
            Explanation(
                labels=labels,
                equivalents=tuple([groups.labels[other] for other in same]),
                own_probability=shares[k],
                shares=tuple([shares[other] for other in same]),
                apart=tuple([equivalents[k][other] for other in same]),
                members=members,
                noise=labels[0] if not unnamed[k] and labels and labels[0] in noise else "",
                identical=tuple(
                    [groups.labels[other] for other in same if _identical(search.pool, members, sets[other])]
                ),
                orders=tuple([groups.labels[other] for other in same if orders[k, other]]),
                at_any_odds=tuple([groups.labels[other] for other in same if bound[k, other]]),
            )
        )
    return sorted(found, key=attrgetter("class_probability"), reverse=True)


def _identical(pool: Pool, first: Members, second: Members) -> bool:
    """Whether the causes in which two sets differ are one function at 1 g."""
    return one_function_at_1_g(
        *(tuple([pool.slots[k] for k in a if k not in b]) for a, b in ((first, second), (second, first)))
    )


def _near(
    groups: Groups, coefficients: Int[np.ndarray, " groups"], shares: list[float], changes: SettingChanges | None
) -> tuple[dict[int, list[int]], Bool[np.ndarray, "groups groups"]]:
    """For each group that is probable enough those whose names and posteriors let them be one class with it, if they can make
    its signal, and which of them no odds part from it; `coefficients`: how many each has."""
    causes, unnamed, posterior, prior = groups.causes, groups.unnamed, groups.log_posterior, groups.log_prior
    # Equal signals are one class whatever their priors; what some unnamed term can imitate has its name.
    odds = posterior[:, None] - posterior - np.where(unnamed, 0.0, prior[:, None] - prior)
    # By number of causes, as no equal needs more; but what so many named causes can make does not remain unexplained.
    imitated = unnamed[:, None] & ~unnamed
    fewer = (causes[:, None] == causes) | (imitated & (causes > 0) & (causes <= causes[:, None]))
    # Two causes that have no more coefficients than one are no less simple.
    fewer |= (causes > causes[:, None]) & (coefficients <= coefficients[:, None]) & ~(unnamed[:, None] | unnamed)
    near = fewer & (odds <= np.where(imitated, NEGLIGIBLE, LEAST_ODDS))
    # Pairs of sets of names of which one is all of the other, itself included.
    has, _ = membership(groups.labels)
    size = has.sum(axis=1)
    held = has @ has.T == np.minimum(size[:, None], size)
    less = coefficients[:, None] < coefficients
    bound = np.zeros_like(held)
    if changes is not None:
        jumped, by_setting = changes.pairs(groups.labels)
        # What jumps with a change of setting is a special case of what is another at each: no odds part them.
        special = fewer & jumped & less
        special &= ~(special @ (held & less))
        # If the input is constant within a setting, a bias and a scale factor by setting are the same signal, and how many
        # directions each shows is no evidence between them.
        bound = special | (near & by_setting & ~held)
        near |= special
    # Whether one more of a family is needed is for the probabilities to say.
    near &= ~held
    probable = [k for k, share in enumerate(shares) if share > LEAST_SHARE and causes[k]]
    return {k: np.flatnonzero(near[k]).tolist() for k in probable}, bound


def _same_signal(
    search: Search, groups: Groups, near: dict[int, list[int]], sigma: float
) -> dict[int, dict[int, float]]:
    """Of the groups near to each, those that can make the signal that it sees to within `INDISTINGUISHABLE`, with the norm of
    what they leave of it, both in units of `sigma`.

    The signal is what a representative says that the residual would be without noise; a group can make its offset (its
    faults) and what its blocks span.
    """
    least = INDISTINGUISHABLE * sigma
    compared = list(dict.fromkeys([k for k, others in near.items() if others for k in (k, *others)]))
    if not compared:
        return {}
    rows = {k: row for row, k in enumerate(compared)}
    sets = partial_sets(search.pool, search.z, sets_of(groups.sets[compared]))
    offsets = search.z - sets.z
    signals = offsets + (sets.along[:, None] @ sets.q)[:, 0]
    squares = np.vecdot(signals, signals)
    # What each set leaves of every signal.
    residual_ss = squares - 2 * offsets @ signals.T + np.vecdot(offsets, offsets)[:, None]
    residual_ss -= np.sum((sets.q @ signals.T - sets.q @ offsets[:, :, None]) ** 2, axis=1)
    can_make, apart = (residual_ss < least**2).tolist(), np.sqrt(np.maximum(residual_ss, 0.0)) / sigma
    equivalents, unnamed = {}, groups.unnamed.tolist()
    for k, others in near.items():
        # A signal indistinguishable from noise is in the span of every set.
        hidden = bool(others) and unnamed[k] and squares[rows[k]] < least**2
        makes = [other for other in others if can_make[rows[other]][rows[k]]]
        makes = [other for other in makes if unnamed[other]] if hidden else makes
        equivalents[k] = {other: float(apart[rows[other]][rows[k]]) for other in makes}
    return equivalents


def further_powers(together: Together, sets: Int[np.ndarray, "sets most"]) -> Bool[np.ndarray, "sets sets"]:
    """Which pairs of sets (rows that end in -1) are one and the same with further powers of polynomials that both have."""
    used = np.unique(sets[sets >= 0])
    has, powers = (sets[:, :, None] == used).any(axis=1), together.polynomial[used]
    # A further member of any other kind excludes a pair.
    of_same = (has @ (powers[:, None] == powers)) & (powers >= 0)
    size, inside = has.sum(axis=1), has.astype(float)
    nested = inside @ inside.T == size[:, None]
    more = nested & ((has | of_same) @ inside.T == size) & (size[:, None] < size)
    return more | more.T


def other_orders(slots: Sequence[Slot], sets: Int[np.ndarray, "sets most"]) -> Bool[np.ndarray, "sets sets"]:
    """Which pairs of sets (rows that end in -1) differ only by the orders in which the same parameters follow the temperature,
    where one has an entry of several powers."""
    several = {k for k, slot in enumerate(slots) if slot.of_several_orders}
    if not several:
        return np.zeros((len(sets), len(sets)), bool)
    causes, has_several, listed = np.empty(len(sets), int), np.zeros(len(sets), bool), dict[frozenset, int]()
    for row, members in enumerate(sets_of(sets)):
        parameters = frozenset(slots[k].parameter_over_temperature or k for k in members)
        causes[row] = listed.setdefault(parameters, len(listed))
        has_several[row] = not several.isdisjoint(members)
    pairs = (causes[:, None] == causes) & (has_several[:, None] | has_several)
    return pairs & ~np.eye(len(sets), dtype=bool)


def named_in_place(
    labels: Sequence[Labels], shares: Sequence[float], equivalents: Mapping[int, Mapping[int, float]]
) -> tuple[int, int] | None:
    """Numbers of the listed set that leads in the place of one without a name, and of that one: the most probable listed set
    and the listed ones like it have together a probability of at least `LEAST_NAMED`. None if the leading set has a name, or
    no listed set is that probable.

    **Arguments:**

    - `labels`, `shares`: of all sets, the most probable first. `equivalents`: by number, those of the same signal.
    """
    leader = next((k for k, own in enumerate(labels) if own), None)
    if leader is None or UNEXPLAINED not in labels[leader]:
        return None
    named = {k for k, own in enumerate(labels) if own and UNEXPLAINED not in own}
    together = {k: shares[k] + sum(shares[other] for other in equivalents.get(k, {}) if other in named) for k in named}
    best = max(together, key=lambda k: (together[k], shares[k]), default=None)
    if best is None or together[best] < LEAST_NAMED:
        return None
    return max([best, *(k for k in equivalents.get(best, {}) if k in named)], key=shares.__getitem__), leader

"""From scored sets to explanations: the same names together, and indistinguishable sets in one class."""

from dataclasses import dataclass, replace
from functools import cached_property
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.causes.generic import UNEXPLAINED
from tumblecal.diagnosis.causes.identities import one_function_at_1_g
from tumblecal.diagnosis.causes.pool import Pool
from tumblecal.diagnosis.priors import INDISTINGUISHABLE, LEAST_ODDS, LISTED, NEGLIGIBLE, SURE
from tumblecal.diagnosis.sets.cause_sets import Members, Ranked, keys_of, sets_of
from tumblecal.diagnosis.sets.exchanges import Labels, membership, supersets
from tumblecal.diagnosis.sets.named_first import named_in_place
from tumblecal.diagnosis.sets.occam import further_powers
from tumblecal.diagnosis.sets.partial_set import partial_sets
from tumblecal.diagnosis.sets.patchwork import Neighbours, is_patchwork
from tumblecal.diagnosis.sets.prior import SetPriors
from tumblecal.diagnosis.sets.search import Search
from tumblecal.diagnosis.sets.setting_changes import SettingChanges


# Equivalents of sets less probable than this are not looked for.
LEAST_SHARE = 1e-3
# Only the best sets are compared with each other.
_MOST_COMPARED = 60
# Decimal digits of log posteriors beyond which they are equal.
_EQUAL_DIGITS = 6


@dataclass(frozen=True)
class Explanation:
    """A set of named causes.

    - `labels`: ids, positions after a colon; empty: the model is adequate.
    - `equivalents`: other sets of labels that can produce its signal, and those with fewer or more powers of the same
      polynomial; `identical`: those of them that are the same function at 1 g, so that no data of a head separate them;
      `at_any_odds`: those that count regardless of their probability.
    - `own_probability`: that the truth is this set; `shares`: the same of each equivalent.
    - `apart`: norm of the part of its signal that each equivalent cannot produce, in noise standard deviations; NaN if
      unknown.
    - `members`: the best set of candidates with these labels; `noise`: the noise alternative where it is one.
    """

    labels: tuple[str, ...]
    equivalents: tuple[tuple[str, ...], ...]
    own_probability: float
    shares: tuple[float, ...]
    members: tuple[int, ...]
    noise: str = ""
    identical: tuple[Labels, ...] = ()
    at_any_odds: tuple[Labels, ...] = ()
    apart: tuple[float, ...] = ()

    @property
    def unexplained(self) -> bool:
        """Whether a cause that no entry describes is among them."""
        return UNEXPLAINED in self.labels

    @property
    def single_name(self) -> bool:
        """Whether one set of causes is claimed, and no measurement on a head could show another in its place."""
        return not self.separable

    @property
    def supersets(self) -> tuple[Labels, ...]:
        """Equivalents that contain another one, or this one, and causes that the data do not need."""
        return supersets(self.labels, [own for own in self.equivalents if not {*own} < {*self.labels}])

    @property
    def powers(self) -> tuple[Labels, ...]:
        """The same causes with fewer or more powers of a polynomial."""
        nested = [own for own in self.equivalents if {*own} < {*self.labels} or {*own} > {*self.labels}]
        return tuple([own for own in nested if own not in self.at_any_odds])

    @property
    def class_probability(self) -> float:
        """That the truth is this set or one of its equivalents."""
        return self.own_probability + sum(self.shares)

    @property
    def probability(self) -> float:
        """Of the statement that is made: of this set with what is identical and its powers where one is claimed, otherwise
        of the whole class."""
        return self._claimed if self.single_name else self.class_probability

    @cached_property
    def separable(self) -> tuple[Labels, ...]:
        """The equivalents that other positions could separate from it and that count: none if it is sure without them,
        otherwise the most probable ones up to `LISTED` of the class.

        The posterior contains Occam's factor: an additional or a rare coefficient costs probability. Equivalents of a cause
        without a name count in any case.
        """
        aside, left = {*self.identical, *self.supersets, *self.powers}, LISTED * self.class_probability - self._claimed
        counted = {*self.at_any_odds} - {*self.identical}
        for share, labels in sorted(zip(self.shares, self.equivalents, strict=True), reverse=True):
            if labels in aside:
                continue
            if self.unexplained or (self._claimed < SURE and left > 0.0):
                counted.add(labels)
            left -= share
        return tuple([own for own in self.equivalents if own in counted])

    @property
    def stated(self) -> tuple[Labels, ...]:
        """The members of the class that a statement names with this set: identical or separable."""
        return tuple([own for own in self.equivalents if own in {*self.identical, *self.separable}])

    @property
    def less_probable(self) -> tuple[tuple[Labels, float], ...]:
        """The other equivalents that a measurement could find in its place, with their probabilities."""
        aside = {*self.identical, *self.supersets, *self.powers, *self.separable}
        return tuple([own for own in zip(self.equivalents, self.shares, strict=True) if own[0] not in aside])

    def times(self, probability: float) -> "Explanation":
        """The same, given something of this probability."""
        shares = tuple([share * probability for share in self.shares])
        return replace(self, own_probability=self.own_probability * probability, shares=shares)

    @property
    def _claimed(self) -> float:
        both, same = zip(self.equivalents, self.shares, strict=True), {*self.identical, *self.powers}
        return self.own_probability + sum([share for labels, share in both if labels in same])


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
    alike = _alike(search, groups, near, sigma)
    if (UNEXPLAINED,) in groups.labels:
        unexplained, pieces = groups.labels.index((UNEXPLAINED,)), groups.patchwork(neighbours)
        alike |= {k: alike.get(k, {}) | {unexplained: np.nan} for k in pieces}
        bound[pieces, unexplained] = True
    found, used, unnamed = [], set(), groups.unnamed.tolist()
    sets, order = sets_of(groups.sets), list(range(len(groups.labels)))
    powers = further_powers(search.pool.together, groups.sets)
    for k in near:
        alike[k] = alike.get(k, {}) | dict.fromkeys(np.flatnonzero(powers[k]).tolist(), np.nan)
    if named_first and (named := named_in_place(groups.labels, shares, alike)) is not None:
        first, unnamed_one = named
        alike[first] = {unnamed_one: np.nan} | alike.get(first, {})
        bound[first, unnamed_one] = True
        order.sort(key=lambda k: k != first)
    for k in order:
        if k in used:
            continue
        labels, members = groups.labels[k], sets[k]
        same = [other for other in alike.get(k, {}) if other not in used]
        used |= {k, *same}
        found.append(
            Explanation(
                labels=labels,
                equivalents=tuple([groups.labels[other] for other in same]),
                own_probability=shares[k],
                shares=tuple([shares[other] for other in same]),
                apart=tuple([alike[k][other] for other in same]),
                members=members,
                noise=labels[0] if not unnamed[k] and labels and labels[0] in noise else "",
                identical=tuple(
                    [groups.labels[other] for other in same if _identical(search.pool, members, sets[other])]
                ),
                at_any_odds=tuple([groups.labels[other] for other in same if bound[k, other]]),
            )
        )
    return sorted(found, key=attrgetter("class_probability"), reverse=True)


def _identical(pool: Pool, first: Members, second: Members) -> bool:
    """Whether the causes in which two sets differ are one function at 1 g."""
    return one_function_at_1_g(
        *(tuple([pool.slots[k] for k in a if k not in b]) for a, b in ((first, second), (second, first)))
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


def _near(
    groups: Groups, coefficients: Int[np.ndarray, " groups"], shares: list[float], changes: SettingChanges | None
) -> tuple[dict[int, list[int]], Bool[np.ndarray, "groups groups"]]:
    """For each group that is probable enough those whose names and posteriors let them be one class with it, if they can make
    its signal, and which of them no odds part from it; `coefficients`: how many each has."""
    causes, unnamed, posterior, prior = groups.causes, groups.unnamed, groups.log_posterior, groups.log_prior
    # Equal signals are one class whatever their priors; what some unnamed term can imitate has its name.
    odds = posterior[:, None] - posterior - np.where(unnamed, 0.0, prior[:, None] - prior)
    # By number of causes, as no equal needs more; but what so many named causes can make is not left unexplained.
    imitated = unnamed[:, None] & ~unnamed
    fewer = (causes[:, None] == causes) | (imitated & (causes > 0) & (causes <= causes[:, None]))
    # Two causes that have no more coefficients than one are no less simple.
    fewer |= (causes > causes[:, None]) & (coefficients <= coefficients[:, None]) & ~(unnamed[:, None] | unnamed)
    near = fewer & (odds <= np.where(imitated, NEGLIGIBLE, LEAST_ODDS))
    held, less = _one_holds_the_other(groups.labels), coefficients[:, None] < coefficients
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


def _one_holds_the_other(sets: list[Labels]) -> Bool[np.ndarray, "groups groups"]:
    """Of which pairs of sets of names one is all of the other, itself included."""
    has, _ = membership(sets)
    size = has.sum(axis=1)
    return has @ has.T == np.minimum(size[:, None], size)


def _alike(search: Search, groups: Groups, near: dict[int, list[int]], sigma: float) -> dict[int, dict[int, float]]:
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
    left = squares - 2 * offsets @ signals.T + np.vecdot(offsets, offsets)[:, None]
    left -= np.sum((sets.q @ signals.T - sets.q @ offsets[:, :, None]) ** 2, axis=1)
    can_make, apart = (left < least**2).tolist(), np.sqrt(np.maximum(left, 0.0)) / sigma
    alike, unnamed = {}, groups.unnamed.tolist()
    for k, others in near.items():
        # A signal indistinguishable from noise is in the span of every set.
        hidden = bool(others) and unnamed[k] and squares[rows[k]] < least**2
        makes = [other for other in others if can_make[rows[other]][rows[k]]]
        makes = [other for other in makes if unnamed[other]] if hidden else makes
        alike[k] = {other: float(apart[rows[other]][rows[k]]) for other in makes}
    return alike


def verdict_of(best: Explanation, otherwise_wrong: bool, implausible_fit: bool, doubtful: bool) -> str:
    """The verdict: adequate, identified, ambiguous or unexplained.

    **Arguments:**

    - `doubtful`: whether an alternative outside the explanations explains the data equally well or better: an effect in a part
      of the data, or an unexplained error instead of a different noise.
    """
    if not best.labels and (implausible_fit or not otherwise_wrong):
        # A fit may be good because a parameter took up what no instrument has: that is no adequate model.
        return "unexplained" if implausible_fit else "adequate"
    if best.unexplained and best.single_name:
        return "unexplained"
    sure = best.single_name and best.probability >= SURE
    return "identified" if sure and not (doubtful or implausible_fit) else "ambiguous"

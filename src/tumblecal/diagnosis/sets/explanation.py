"""An explanation: a set of named causes with all that can make its signal, its probability, and the verdict on it."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

from tumblecal.diagnosis.causes.cause import UNEXPLAINED
from tumblecal.diagnosis.priors import LISTED, SURE
from tumblecal.diagnosis.sets.exchanges import Labels, supersets


@dataclass(frozen=True)
class Explanation:
    """A set of named causes.

    - `labels`: ids, positions after a colon; empty: the model is adequate.
    - `equivalents`: other sets of labels that can produce its signal, and those with fewer or more powers of the same
      polynomial; `identical`: those of them that are the same function at 1 g, so that no data of a head separate them;
      `orders`: those that differ only by the order in which a parameter follows the temperature; `at_any_odds`: those that
      count regardless of their probability.
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
    orders: tuple[Labels, ...] = ()
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

    @cached_property
    def supersets(self) -> tuple[Labels, ...]:
        """Equivalents that contain another one, or this one, and causes that the data do not need."""
        return supersets(self.labels, [own for own in self.equivalents if not {*own} < {*self.labels}])

    @cached_property
    def powers(self) -> tuple[Labels, ...]:
        """The same causes with fewer or more powers of a polynomial, or another order of it."""
        nested = [own for own in self.equivalents if {*own} < {*self.labels} or {*own} > {*self.labels}]
        return tuple([own for own in (*nested, *self.orders) if own not in self.at_any_odds])

    @property
    def class_probability(self) -> float:
        """That the truth is this set or one of its equivalents."""
        return self.own_probability + sum(self.shares)

    @property
    def probability(self) -> float:
        """Of the statement that is made: of this set with what is identical and its powers where one is claimed, otherwise
        of the whole class."""
        return self._claimed if self.single_name else self.class_probability

    def more_probable_than(self, least: float) -> bool:
        """Whether `probability` exceeds a number; quick for the many classes that are improbable as a whole."""
        return self.class_probability > least and self.probability > least

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

    @cached_property
    def _claimed(self) -> float:
        both, same = zip(self.equivalents, self.shares, strict=True), {*self.identical, *self.powers}
        return self.own_probability + sum([share for labels, share in both if labels in same])


def all_labels(setup_errors: Iterable[str], noises: Iterable[str], best: Explanation) -> tuple[str, ...]:
    """Ids of all named causes: set-up errors, faults of the noise, effects; positions after a colon."""
    noises = tuple(noises)
    return (*dict.fromkeys(setup_errors), *noises, *(label for label in best.labels if label not in noises))


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

"""Proposals chosen by what they add: the best single ones, and a set with a large joint value."""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from tumblecal.plan.next.posterior import Gains, Posterior
from tumblecal.plan.next.proposals import NextPosition, by_pitch


MOST_IN_SET = 12
# Single proposals.
MOST = 6
# Separated: the odds of the alternatives together are expected to fall by e^20, so that they almost always fall by e^4, also
# against sets of causes that are not listed.
DECIDED = 20.0
# A position with new unknown parameters counts for so many: a new pitch setting or mounting is more work.
_EFFORT = 2.0


class Value:
    """What proposals add to a set, in natural logarithms.

    **Arguments:**

    - `posteriors`: of the explanations, the leading one first.
    - `gains`: of each proposal, in as many parts as there are `log_odds`.
    - `log_odds`: of each part: the value is the decrease of the logarithm of the sum of all odds.
    - `needed`: the value of a complete set, also if one of its positions turns out to be an outlier.
    """

    def __init__(
        self, posteriors: Sequence[Posterior], gains: Gains, log_odds: np.ndarray, needed: float = DECIDED
    ) -> None:
        self._posteriors, self._gains, self._log_odds = posteriors, gains, log_odds
        self._gained, self._needed, self._most = np.zeros(len(log_odds)), needed, 0.0

    def of(self, cells: Sequence[np.ndarray]) -> Float[np.ndarray, " proposals"]:
        """The value that each proposal adds."""
        gains, counts = np.empty((len(self._log_odds), len(cells))), np.array([len(each) for each in cells])
        for count in np.unique(counts):
            numbers = np.flatnonzero(counts == count)
            gains[:, numbers] = self._gains(self._posteriors, np.stack([cells[k] for k in numbers.tolist()]))
        return self._total(gains + self._gained[:, None]) - self.total

    @property
    def total(self) -> float:
        """The value of the set."""
        return float(self._total(self._gained[:, None])[0])

    @property
    def lacking(self) -> float:
        """What the set lacks, without the position that adds most."""
        return max(self._needed - self.total + self._most, 0.0)

    def take(self, cells: np.ndarray) -> float:
        """Add a proposal to the set, with the readings that the leading explanation predicts; the value that it adds."""
        before = self.total
        self._gained = self._gained + self._gains(self._posteriors, cells[None])[:, 0]
        expected = self._posteriors[0].predicted(cells[None]).mean[0]
        self._posteriors = [known.after(cells, expected) for known in self._posteriors]
        added = self.total - before
        self._most = max(self._most, added / len(cells))
        return added

    def _total(self, gains: Float[np.ndarray, "parts proposals"]) -> Float[np.ndarray, " proposals"]:
        return np.logaddexp.reduce(self._log_odds) - np.logaddexp.reduce(self._log_odds[:, None] - gains, axis=0)


def best_of(
    listed: Sequence[NextPosition], cells: Sequence[np.ndarray], value: Value, least: float
) -> list[NextPosition]:
    """The best single proposals with their values: at most `MOST`, each with a value above `least`; `cells`: of each."""
    values = np.where([one.needs_others for one in listed], 0.0, value.of(cells))
    order = np.argsort(-values, kind="stable")[:MOST].tolist()
    return [replace(listed[k], value=float(values[k])) for k in order if values[k] > least]


def greedy(
    listed: Sequence[NextPosition],
    cells: Sequence[np.ndarray],
    value: Value,
    least: Float[np.ndarray, " listed"],
    settings: Collection[float],
) -> list[NextPosition]:
    """A set in the order in which it is measured, chosen one by one, each the best per position given those before it, with the
    value that each adds.

    **Arguments:**

    - `least`: the value of each proposal below which it is not added. `settings`: measured pitch settings, deg.
    """
    chosen, spent = list[NextPosition](), set[tuple[str, float, float]]()
    places = [{(one.mount, one.beta_deg, alpha) for alpha in one.angles_deg} for one in listed]
    effort = [len(one.angles_deg) * (_EFFORT if one.mount or one.beta_deg not in settings else 1.0) for one in listed]
    while value.lacking > 0.0:
        values, mounts = value.of(cells), {mount for mount, _, _ in spent}
        # The same position is not proposed twice: a turn of four is part of that of eight.
        fits = [
            len(own) <= MOST_IN_SET - len(spent) and not spent & own and (not one.needs_others or one.mount in mounts)
            for one, own in zip(listed, places, strict=True)
        ]
        usable = np.array(fits) & (values >= least)
        if not np.any(usable):
            break
        best = int(np.argmax(np.where(usable, np.minimum(values, value.lacking) / effort, 0.0)))
        chosen.append(replace(listed[best], value=value.take(cells[best])))
        spent |= places[best]
    return by_pitch(chosen)

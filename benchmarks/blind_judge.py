"""How answers of a diagnosis are judged against what was hidden, and counted: shared by the blind studies."""

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import binomtest


if TYPE_CHECKING:
    from tumblecal.diagnosis.sets.classes import Explanation


UNEXPLAINED = "unexplained"
BINS = (0.0, 0.3, 0.5, 0.7, 0.85, 0.95, 1.0)


def right(best: "Explanation", truth: tuple[str, ...], noise: Sequence[str] = ()) -> bool:
    """Whether the hidden set is the best explanation or one of its equivalents, and nothing is said of the noise."""
    return not noise and truth in (best.labels, *best.equivalents)


def stated(best: "Explanation", truth: tuple[str, ...], noise: Sequence[str] = ()) -> bool:
    """Whether the statement of which the probability is given is true: of one set with what is the same function at 1 g where
    that is claimed alone, otherwise of the class."""
    return right(best, truth, noise) and (not best.single_name or truth in (best.labels, *best.identical))


def with_unexplained(best: "Explanation", noise: Sequence[str] = ()) -> bool:
    """Whether the statement includes a cause without a name, and nothing is said of the noise."""
    others = () if best.single_name else best.equivalents
    return not noise and any(UNEXPLAINED in labels for labels in (best.labels, *others))


def sure(best: "Explanation") -> bool:
    """Whether one set is claimed with a probability above 0.9."""
    return bool(best.labels and best.single_name and best.probability > 0.9)


def interval(yes: int, of: int) -> tuple[float, float]:
    """95 % interval of a share (Wilson)."""
    low, high = binomtest(int(yes), of).proportion_ci(method="wilson")
    return float(low), float(high)


def print_reliability(said: Iterable[tuple[float, bool]], bins: Sequence[float] = BINS) -> None:
    """Stated probabilities, each with whether it was right, beside how often they were."""
    said = list(said)
    print("\nprobability said  statements  mean said  right")
    for low, high in pairwise(bins):
        here = [own for own in said if low <= own[0] < high or own[0] == high == 1.0]
        if here:
            mean, share = np.mean(np.array(here, float), axis=0)
            print(f"{low:4.2f} to {high:4.2f} {len(here):15d} {mean:10.3f} {share:6.3f}")

"""Listed causes lead if they are probable: an error without a catalogue entry is not claimed then."""

from collections.abc import Mapping, Sequence

from tumblecal.diagnosis.causes.generic import UNEXPLAINED
from tumblecal.diagnosis.priors import LEAST_NAMED
from tumblecal.diagnosis.sets.exchanges import Labels


def named_in_place(
    labels: Sequence[Labels], shares: Sequence[float], alike: Mapping[int, Mapping[int, float]]
) -> tuple[int, int] | None:
    """Numbers of the listed set that leads in the place of one without a name, and of that one: the most probable listed set
    and the listed ones like it have together a probability of at least `LEAST_NAMED`. None if the leading set has a name, or
    no listed set is that probable.

    **Arguments:**

    - `labels`, `shares`: of all sets, the most probable first. `alike`: by number, those of the same signal.
    """
    leader = next((k for k, own in enumerate(labels) if own), None)
    if leader is None or UNEXPLAINED not in labels[leader]:
        return None
    named = {k for k, own in enumerate(labels) if own and UNEXPLAINED not in own}
    together = {k: shares[k] + sum(shares[other] for other in alike.get(k, {}) if other in named) for k in named}
    best = max(together, key=lambda k: (together[k], shares[k]), default=None)
    if best is None or together[best] < LEAST_NAMED:
        return None
    return max([best, *(k for k in alike.get(best, {}) if k in named)], key=shares.__getitem__), leader

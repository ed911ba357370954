"""Sets of causes that can make another set's signal and are no equals of it: they need more for it."""

from collections.abc import Sequence

from tumblecal.diagnosis.causes.identities import one_function_at_1_g
from tumblecal.diagnosis.model.layout import Slot


def needs_more(simpler: Sequence[Slot], other: Sequence[Slot]) -> bool:
    """Whether some effects, which make the signal of simpler ones, need more for it.

    A higher order in the same variable of the same output, met less often, needs the lower one not to be there. A special case
    (at 1 g) of an effect needs another effect in addition.
    """
    if not simpler:
        return False
    if all(any(_is_higher_order(high, low) for high in other) for low in simpler):
        return True
    return len(other) > len(simpler) and all(any(_is_special_case(part, own) for part in other) for own in simpler)


def _is_higher_order(high: Slot, low: Slot) -> bool:
    return low.polynomial == high.polynomial != () and low.order < high.order and high.weight < low.weight


def _is_special_case(part: Slot, whole: Slot) -> bool:
    return len(part.columns) < len(whole.columns) and one_function_at_1_g([part], [whole])

"""Sets of causes that can make another set's signal and are no equals of it: they need more for it.

Powers of one variable on one output are a polynomial, which is one cause, as the reference of the variable is not known. One
more or one fewer of its powers is no other cause.
"""

from collections.abc import Sequence

from tumblecal.diagnosis.causes.identities import one_function_at_1_g
from tumblecal.diagnosis.causes.pool import Pool
from tumblecal.diagnosis.model.layout import Slot
from tumblecal.diagnosis.sets.cause_sets import Members


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


def further_powers(pool: Pool, first: Members, second: Members) -> bool:
    """Whether one of two sets is the other with further powers of polynomials that both have."""
    fewer, more = sorted((set(first), set(second)), key=len)
    own, further = (
        pool.together.polynomial[sorted(fewer)].tolist(),
        pool.together.polynomial[sorted(more - fewer)].tolist(),
    )
    return fewer < more and -1 not in further and {*further} <= {*own}


def splits(pool: Pool, simpler: Members, other: Members) -> bool:
    """Whether a set has another cause in the place of some powers of a polynomial of a simpler one."""
    powers = [k for k in simpler if pool.together.polynomial[k] >= 0]
    number = pool.together.polynomial[powers].tolist()
    return any(number.count(own) > 1 and k not in other for k, own in zip(powers, number, strict=True))


def _is_higher_order(high: Slot, low: Slot) -> bool:
    return low.polynomial == high.polynomial != () and low.order < high.order and high.weight < low.weight


def _is_special_case(part: Slot, whole: Slot) -> bool:
    return len(part.columns) < len(whole.columns) and one_function_at_1_g([part], [whole])

"""Powers of one variable on one output are a polynomial, which is one cause, as the reference of the variable is not known. One
more or one fewer of its powers is no other cause."""

from tumblecal.diagnosis.causes.pool import Pool
from tumblecal.diagnosis.sets.cause_sets import Members


def further_powers(pool: Pool, first: Members, second: Members) -> bool:
    """Whether one of two sets is the other with further powers of polynomials that both have."""
    fewer, more = sorted((set(first), set(second)), key=len)
    own, further = (
        pool.together.polynomial[sorted(fewer)].tolist(),
        pool.together.polynomial[sorted(more - fewer)].tolist(),
    )
    return fewer < more and -1 not in further and {*further} <= {*own}

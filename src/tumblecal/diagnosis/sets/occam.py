"""Powers of one variable on one output are a polynomial, which is one cause, as the reference of the variable is not known. One
more or one fewer of its powers is no other cause."""

import numpy as np
from jaxtyping import Bool, Int

from tumblecal.diagnosis.causes.together import Together


def further_powers(together: Together, sets: Int[np.ndarray, "sets most"]) -> Bool[np.ndarray, "sets sets"]:
    """Which pairs of sets (rows that end in -1) are one and the same with further powers of polynomials that both have."""
    more = np.zeros((len(sets), len(sets)), bool)
    # A further member of any other kind excludes a pair.
    powers = np.append(together.polynomial, -1)[sets]
    fewer, larger = np.nonzero((sets >= 0).sum(axis=1)[:, None] < (sets >= 0).sum(axis=1))
    likely = np.any(powers >= 0, axis=1)
    fewer, larger = (rows[likely[fewer] & likely[larger]] for rows in (fewer, larger))
    both = sets[fewer][:, :, None] == sets[larger][:, None, :]
    nested = np.all(np.any(both, axis=2) | (sets[fewer] < 0), axis=1)
    same = (powers[fewer][:, :, None] == powers[larger][:, None, :]) & (powers[larger] >= 0)[:, None, :]
    of_both = np.any(same, axis=1) | np.any(both, axis=1) | (sets[larger] < 0)
    here = nested & np.all(of_both, axis=1)
    more[fewer[here], larger[here]] = True
    return more | more.T

"""The effect that occurs together with one that jumps: each with every choice of the jump's signs, in a few products.

With wrong signs, neither of two large effects explains much by the linear screen, and neither leads. With the signal a of the
jump and the orthonormal signals U of another effect, both without their absorbed parts, the remaining sum of squares of z is
z'z
- |U'z|^2 - (a'(z - UU'z))^2 / (a'a - |U'a|^2) (Frisch and Waugh 1933).
"""

import numpy as np
from jaxtyping import Float, Int

from tumblecal.diagnosis.causes.effects import SeenEffects
from tumblecal.diagnosis.exact.signs import jump_signals, sign_choices
from tumblecal.diagnosis.model.tangent import Tangent
from tumblecal.diagnosis.tuning import COLLINEAR


def pairs_with_a_jump(
    there: Tangent, seen: SeenEffects, column: int
) -> tuple[Float[np.ndarray, " pairs"], Int[np.ndarray, " pairs"]]:
    """Residual sum of squares of a jump with each other effect, for the signs with which they explain most, and the number of
    the effect in the model; smallest residual first.

    **Arguments:**

    - `there`: the linearised problem. `seen`: the visibility of its effects there. `column`: the jump's.
    """
    z = there.z
    own = np.array([column in slot.columns for slot in seen.slots], bool)
    numbers = np.flatnonzero((seen.ranks > 0) & ~own)
    signals, owners = seen.rows(numbers)
    begins = np.flatnonzero(np.diff(owners, prepend=-1))
    jumps = there.basis.T @ jump_signals(there, column, sign_choices(there, column))
    shared, alone = signals @ jumps, signals @ z
    explained = np.add.reduceat(alone**2, begins)
    beside = z @ jumps - np.add.reduceat(alone[:, None] * shared, begins)
    whole = np.sum(jumps**2, axis=0)
    apart = whole - np.add.reduceat(shared**2, begins)
    gained = np.where(apart > COLLINEAR * whole, beside**2 / np.maximum(apart, 1e-300), 0.0)
    left = z @ z - explained - np.max(gained, axis=1)
    order = np.argsort(left, kind="stable")
    return left[order], numbers[order]

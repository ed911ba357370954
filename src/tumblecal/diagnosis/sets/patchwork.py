"""Patchwork: names that fit a part of whatever is left, of which several together stand for one thing without a name.

A bias that jumps, a mount that slips, positions that are off and a noise of another kind describe a piece of any signal. That
two of them, or one and two more causes, happened at once is less probable beforehand (`tuning.SIZE_PRIOR`) than one thing that
no entry describes; only the evidence of lack of fit, whose curves are smooth, is behind. So they make one class with it.
"""

from collections.abc import Sequence

from tumblecal.diagnosis.causes.cause import id_of


_JUMPS = ("bias_jump", "mount_slip")
_POSITIONS = "outlier_position"


def is_patchwork(labels: Sequence[str], causes: int, noises: int = 0) -> bool:
    """Whether a set of causes may as well be one thing without a name.

    **Arguments:**

    - `labels`: of the set, each jump by its position. `causes`: how many it counts for (`prior.SetPriors`).
    - `noises`: in how many ways the noise is not as assumed.
    """
    ids = [id_of(label) for label in labels]
    patches = noises + sum(id in _JUMPS for id in ids) + (_POSITIONS in ids)
    return patches >= 2 or (patches == 1 and noises + causes >= 3)

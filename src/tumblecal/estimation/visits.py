"""Priors on errors of settings that are set again: each visit has what the setting has in common, and an error of its own.

A rig states both: `[priors]` of the leaf for the common part, `[head.repeatability]` for the part of each visit. With a leaf
that is indexed by visit (`by = "pitch_visit"`) they are correlated priors of the fit: a split plot (Jones and Goos 2007).
"""

import numpy as np
from jaxtyping import Float, Int

from tumblecal.chain import Chain, Where
from tumblecal.chain.head_ability import Repeatability
from tumblecal.chain.where import VISITS
from tumblecal.estimation.priors import Priors


# Errors of settings without a prior have this sd, rad: no bound for angles, and the covariance can be inverted.
_NO_BOUND = 1.0


def visit_precision(
    common: float | None, again: float, settings: Int[np.ndarray, " visits"]
) -> Float[np.ndarray, "visits visits"]:
    """Information on one component of the errors of some visits.

    **Arguments:**

    - `common`: prior sd of the errors that all visits of one setting share; None: unknown without bound. `again`: sd that each
      visit adds.
    - `settings`: the setting that each visit belongs to.
    """
    count = len(settings)
    if common is None and not again:
        # Each visit is unknown without bound if the setting is, and nothing is stated of its repeatability.
        return np.zeros((count, count))
    same = settings[:, None] == settings
    if common is None:
        return (np.eye(count) - same / same.sum(axis=1)) / again**2
    # Exactly repeated settings are kept invertible; in closed form the information on the common part keeps its digits.
    variance = max(again**2, 1e-10 * common**2, 1e-18)
    return (np.eye(count) - same * common**2 / (variance + same.sum(axis=1) * common**2)) / variance


def with_repeatability(priors: Priors, stated: Repeatability, chain: Chain, where: Where) -> Priors:
    """Priors with the stated repeatability of the settings, for the leaves of a chain that are indexed by visit.

    **Arguments:**

    - `priors`: of the leaves; that of a leaf indexed by visit is of the part that visits of one setting share.
    - `where`: the settings of the data.
    """
    repeated: dict[str | tuple[str, ...], tuple] = dict(priors.items())
    for leaf in chain.free:
        again = {"dbeta": stated.pitch, "dtheta": stated.mount}.get(leaf.name)
        if leaf.by not in VISITS or not again:
            continue
        common = repeated.pop(leaf.name, (0.0, _NO_BOUND))[1]
        visit, setting = np.asarray(where.index(leaf.by)), np.asarray(where.index(VISITS[leaf.by][1]))
        settings = setting[np.unique(visit, return_index=True)[1]]
        covariance = common**2 * (settings[:, None] == settings) + again**2 * np.eye(len(settings))
        count = len(leaf.components)
        for component in range(count):
            repeated[leaf.names[component::count]] = (np.zeros(len(settings)), covariance)
    return repeated

"""Priors on errors of settings that are set again: each visit has what the setting has in common, and an error of its own.

A rig states both: `[priors]` of the leaf for the common part, `[head.repeatability]` for the part of each visit. With a leaf
that is indexed by visit (`by = "pitch_visit"`) they are correlated priors of the fit: a split plot (Jones and Goos 2007).
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float, Int

from tumblecal.chain import Chain, Parameter, Where
from tumblecal.chain.head_ability import Repeatability
from tumblecal.chain.where import VISITS
from tumblecal.estimation.priors import Priors


# Errors of settings without a prior have this sd, rad: no bound for angles, and the covariance can be inverted.
_NO_BOUND = 1.0


def visit_precision(
    common: float | None, again: float, settings: Int[np.ndarray, "*n visits"]
) -> Float[np.ndarray, "*n visits visits"]:
    """Information on one component of the errors of some visits, or of each of several lists of visits.

    **Arguments:**

    - `common`: prior sd of the errors that all visits of one setting share; None: unknown without bound. `again`: sd that each
      visit adds.
    - `settings`: the setting that each visit belongs to.
    """
    same, every = settings[..., :, None] == settings[..., None, :], np.eye(settings.shape[-1])
    if common is None and not again:
        # Each visit is unknown without bound if the setting is, and nothing is stated of its repeatability.
        return np.zeros(same.shape)
    number = same.sum(axis=-1, keepdims=True)
    if common is None:
        return (every - same / number) / again**2
    # Exactly repeated settings are kept invertible; in closed form the information on the common part keeps its digits.
    variance = max(again**2, 1e-10 * common**2, 1e-18)
    return (every - same * common**2 / (variance + number * common**2)) / variance


def with_repeatability(priors: Priors, stated: Repeatability, chain: Chain, where: Where) -> Priors:
    """Priors with the stated repeatability of the settings, for the leaves of a chain that are indexed by visit.

    **Arguments:**

    - `priors`: of the leaves; that of a leaf indexed by visit is of the part that visits of one setting share.
    - `where`: the settings of the data.
    """
    repeated: dict[str | tuple[str, ...], tuple] = dict(priors.items())
    for leaf, again, settings in _set_again(stated, chain, where):
        common = repeated.pop(leaf.name, (0.0, _NO_BOUND))[1]
        covariance = common**2 * (settings[:, None] == settings) + again**2 * np.eye(len(settings))
        count = len(leaf.components)
        for component in range(count):
            repeated[leaf.names[component::count]] = (np.zeros(len(settings)), covariance)
    return repeated


def drawn_with_repeatability(
    truth: Float[np.ndarray, " free"],
    spread: Float[np.ndarray, " free"],
    stated: Repeatability,
    chain: Chain,
    where: Where,
) -> tuple[Float[np.ndarray, " free"], Float[np.ndarray, "free draws"]] | None:
    """Mean and a root of the covariance of random instruments whose settings are set again; None if none is.

    All visits of a setting have its mean error and its `spread` in common, and each adds the repeatability.

    **Arguments:**

    - `truth`, `spread`: parameters, and standard deviations of independent draws of them.
    """
    mean, columns, names = truth.copy(), [np.diag(spread)], chain.names
    for leaf, again, settings in _set_again(stated, chain, where):
        count = len(leaf.components)
        for component in range(count):
            own = np.array([names.index(name) for name in leaf.names[component::count]])
            same = (settings[:, None] == settings).astype(float)
            mean[own] = same @ truth[own] / same.sum(axis=1)
            columns[0][own, own] = 0.0
            drawn = np.zeros((len(names), 2 * len(own)))
            # A setting's own draw is that of its first visit.
            first = np.argmax(same, axis=1)
            drawn[own, first] = spread[own[0]]
            drawn[own, len(own) + np.arange(len(own))] = again
            columns.append(drawn)
    return (mean, np.hstack(columns)) if len(columns) > 1 else None


def _set_again(
    stated: Repeatability, chain: Chain, where: Where
) -> Iterator[tuple[Parameter, float, Int[np.ndarray, " visits"]]]:
    """The leaves indexed by visit whose repeatability is stated, that, and the setting of each visit."""
    for leaf in chain.free:
        again = {"dbeta": stated.pitch, "dtheta": stated.mount}.get(leaf.name)
        if leaf.by in VISITS and again:
            visit, setting = np.asarray(where.index(leaf.by)), np.asarray(where.index(VISITS[leaf.by][1]))
            yield leaf, again, setting[np.unique(visit, return_index=True)[1]]

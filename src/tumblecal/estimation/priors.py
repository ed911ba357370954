"""Priors on the parameters of a chain."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from tumblecal.chain import Chain
from tumblecal.ground.errors import InputError


# Mean and sd by the name of a parameter or leaf; means and covariance by the names of several parameters. Base units.
Priors = Mapping[str, tuple[float, float]] | Mapping[str | tuple[str, ...], tuple[Any, Any]]


def prior_of(chain: Chain, priors: Priors) -> tuple[np.ndarray, np.ndarray]:
    """Means (free,), and 1/sd of each parameter (free,), 0 without a prior; for correlated priors a matrix (stated, free).

    **Raises:** `InputError` for a parameter that the chain lacks, or an sd that is not positive.
    """
    names = chain.names
    mean, weights = np.zeros(len(names)), np.zeros(len(names))
    members = {leaf.name: leaf.names for leaf in chain.free} | {name: (name,) for name in names}
    for key, stated in priors.items():
        if not (isinstance(stated, tuple | list) and len(stated) == 2):
            raise InputError(f"prior on {key!r}: give (mean, standard deviation), not {stated!r}")
        centre, sd = stated
        unknown = [name for name in ((key,) if isinstance(key, str) else key) if name not in members]
        if unknown:
            raise InputError(f"prior on {unknown[0]!r}: the model has no such parameter; it has {', '.join(names)}")
        if isinstance(key, str):
            if not sd > 0:
                raise InputError(f"prior on {key!r}: the standard deviation must be above 0")
            columns = [names.index(name) for name in members[key]]
            mean[columns], weights[columns] = centre, 1.0 / sd
    correlated = [(key, *stated) for key, stated in priors.items() if isinstance(key, tuple)]
    if not correlated:
        return mean, weights
    # Several priors on one parameter combine: information adds.
    information = np.diag(weights**2)
    towards = information @ mean
    for key, centre, covariance in correlated:
        columns = [names.index(name) for name in key]
        precision = np.linalg.inv(covariance)
        information[np.ix_(columns, columns)] += precision
        towards[columns] += precision @ centre
    stated = np.flatnonzero(np.diag(information))
    mean[stated] = np.linalg.solve(information[np.ix_(stated, stated)], towards[stated])
    root = np.zeros((len(stated), len(names)))
    root[:, stated] = np.linalg.cholesky(information[np.ix_(stated, stated)]).T
    return mean, root

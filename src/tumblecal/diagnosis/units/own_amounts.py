"""The amount of one effect in every unit, given all other shared, varying and separate errors; and the mean of these amounts.

Each unit gives the normal equations G, g of the effect's coefficients. About a mean they scatter by a spread tau, whose
likelihood (with the mean integrated out, REML) is that of `spread`; the mean weighs each unit by (G^-1 + tau^2)^-1.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import gammaincc

from tumblecal.diagnosis.units.spread import widened
from tumblecal.diagnosis.units.unit import Reduced, SharedSignal, Unit
from tumblecal.diagnosis.units.weighed import Weighed, determined


# Spreads tried, in the noise of one unit's coefficients, and none.
SPREADS = np.concatenate([[0.0], np.geomspace(0.1, 1e4, 60)])
# A unit shows an effect where noise alone would show as much in one of all units less often than this.
_SHOWN = 0.01
# A coefficient of whose direction the data determine this share of the square is determined by itself.
_DETERMINED = 0.99
# Directions of a unit's information below this share of the largest contain only rounding errors.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class OwnAmounts:
    """Information of every unit on one effect.

    - `grams`, `towards`: each unit's normal equations, scaled coefficients, units of its noise. `axes`: the combinations of
      coefficients that the units determine, as columns.
    """

    signal: SharedSignal
    grams: Float[np.ndarray, "units coefficients coefficients"]
    towards: Float[np.ndarray, "units coefficients"]
    axes: Float[np.ndarray, "coefficients determined"]

    @cached_property
    def along(self) -> tuple[Float[np.ndarray, "units k k"], Float[np.ndarray, "units k"]]:
        """The normal equations of the determined combinations."""
        return np.einsum("ci,ucd,dj->uij", self.axes, self.grams, self.axes), self.towards @ self.axes

    @cached_property
    def seen_by(self) -> Bool[np.ndarray, " units"]:
        """Which units show every determined combination."""
        values = np.linalg.eigvalsh(self.along[0])
        return values[:, 0] > _ROUNDING * max(float(np.max(values)), 1e-300)

    @cached_property
    def determined(self) -> Bool[np.ndarray, " coefficients"]:
        """Which coefficients the units determine by themselves."""
        return np.sum(self.axes**2, axis=1) > _DETERMINED

    @cached_property
    def shown_in(self) -> tuple[int, ...]:
        """Numbers of the units that show it clearly, each by itself."""
        values, vectors = np.linalg.eigh(self.along[0])
        seen = values > _ROUNDING * np.max(values, initial=1e-300)
        squares = np.einsum("uij,ui->uj", vectors, self.along[1]) ** 2
        explained = np.sum(np.where(seen, squares / np.where(seen, values, 1.0), 0.0), axis=1)
        rank = np.maximum(np.sum(seen, axis=1), 1)
        return tuple(np.flatnonzero(gammaincc(rank / 2, explained / 2) < _SHOWN / len(values)).tolist())

    @cached_property
    def tau(self) -> float:
        """The spread between units about their mean, scaled coefficients: the most likely one."""
        likelihoods, taus = spread_likelihoods(*self.along)
        return float(taus[np.argmax(likelihoods[:, 0])])

    @cached_property
    def mean(self) -> tuple[Float[np.ndarray, " coefficients"], Float[np.ndarray, " coefficients"]]:
        """The mean of these units and its sd by their noise, scaled, without combinations that no unit determines."""
        grams, towards = self.along
        shrunk = np.linalg.inv(np.eye(grams.shape[1]) + self.tau**2 * grams)
        information = np.linalg.inv(np.sum(shrunk @ grams, axis=0))
        mean = information @ np.einsum("uij,uj->i", shrunk, towards)
        noise = information @ np.sum(shrunk @ grams @ shrunk.mT, axis=0) @ information
        return self.axes @ mean, np.sqrt(np.einsum("ci,ij,cj->c", self.axes, noise, self.axes))


def own_amounts(units: Sequence[Unit], weighed: Weighed, members: Sequence[int], signal: SharedSignal) -> OwnAmounts:
    """Amount of an effect in every unit.

    **Arguments:**

    - `units`: with all their information, including excluded units.
    - `weighed`, `members`: the selected hypothesis and its shared errors.
    """
    columns = list(signal.columns)
    beside = weighed.coefficients(members)
    beside[columns] = 0.0
    grams, towards = [], []
    for unit, own in zip(units, weighed.own, strict=True):
        others = tuple(k for k in own.members if unit.pool.causes[k].slot.id != signal.slot.id)
        reduced = unit.reduced(own._replace(members=others))
        reduced = Reduced(reduced.log_evidence, reduced.gram, reduced.towards - reduced.gram @ beside)
        for spread in weighed.spreads:
            if spread.signal.slot.id != signal.slot.id:
                reduced = widened(reduced, spread)
        grams.append(reduced.gram[np.ix_(columns, columns)])
        towards.append(reduced.towards[columns])
    axes, _ = determined(np.sum(grams, axis=0))
    return OwnAmounts(signal, np.stack(grams), np.stack(towards), axes)


def spread_likelihoods(
    grams: Float[np.ndarray, "units k k"], towards: Float[np.ndarray, "*draws units k"]
) -> tuple[Float[np.ndarray, "taus draws"], Float[np.ndarray, " taus"]]:
    """Restricted log likelihood of each spread about a free mean, for one set of amounts or many."""
    towards = towards.reshape(-1, *towards.shape[-2:])
    values, vectors = np.linalg.eigh(grams)
    values = np.maximum(values, 0.0)
    taus = SPREADS / np.sqrt(max(float(np.mean(np.max(values, axis=1))), 1e-300))
    along, listed = np.einsum("uij,dui->duj", vectors, towards), []
    for tau in taus.tolist():
        shrunk = 1.0 / (1.0 + tau**2 * values)
        information = np.einsum("uij,uj,ukj->ik", vectors, shrunk * values, vectors)
        total = np.einsum("uij,uj,duj->di", vectors, shrunk, along)
        explained = np.vecdot(total, np.linalg.solve(information, total.T).T)
        determinants = np.sum(np.log(shrunk)) - np.linalg.slogdet(information)[1]
        listed.append(0.5 * (determinants + tau**2 * np.einsum("uj,duj->d", shrunk, along**2) + explained))
    return np.stack(listed), taus

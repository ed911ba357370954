"""What a plan alone decides: which generic terms are distinct, and how the test's statistic falls when nothing is wrong.

Both are made once for a plan, from an instrument without errors measured at equal intervals, and serve every data set of
that plan: the answer for one file does not depend on the files before it.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from tumblecal.chain import Where
from tumblecal.diagnosis.candidates import Pool
from tumblecal.diagnosis.detect import null_distribution
from tumblecal.diagnosis.linear import Weighting, linearise
from tumblecal.diagnosis.model import Model
from tumblecal.diagnosis.noise import NoiseAlternative, alternatives, measuring_order
from tumblecal.diagnosis.pool import pooled


# Where the noise is not known, faults are counted against this share of the largest reading.
_TYPICAL_NOISE = 1e-4


@dataclass(frozen=True)
class Reference:
    """One plan: the generic terms kept (`generic`, numbers in their list), the pool and the noise alternatives."""

    generic: tuple[int, ...]
    pool: Pool
    noise: list[NoiseAlternative]
    known: bool

    @cached_property
    def null(self) -> Float[np.ndarray, " draws"]:
        """Sorted statistics of data in which nothing is wrong."""
        return null_distribution(self.pool, self.noise, self.known)


@dataclass
class References:
    """References by plan; a study or a row of files makes each only once."""

    _made: dict[tuple, Reference] = field(default_factory=dict)

    def of(self, model: Model, where: Where, how: Weighting) -> Reference:
        """The reference of the plan of some data."""
        even, plain = _evenly(where), _rounded(how)
        key = (id(model.chain), *_key(even, plain))
        if key not in self._made:
            model = model.started(even)
            readings = model.predict(even, model.start)
            linear = linearise(model, even, readings, plain, model.start)
            scale = 1.0 if plain.known else _TYPICAL_NOISE * float(np.max(plain.weights))
            names = tuple(map(str, range(len(readings))))
            pool, _, generic = pooled(model, linear, even, readings, names, plain, scale)
            self._made[key] = Reference(generic, pool, alternatives(linear, plain, even), plain.known)
        return self._made[key]


def _evenly(where: Where) -> Where:
    """The plan measured at equal intervals in the order in which it was, at a temperature that wanders a little, with
    approaches by chance where they differ."""
    count = len(np.asarray(where.alpha))
    rng = np.random.default_rng(count)
    place = np.argsort(np.argsort(measuring_order(where), kind="stable"), kind="stable")
    changed: dict[str, np.ndarray] = {}
    if where.time_s is not None:
        changed["time_s"] = 60.0 * place
    if where.approach is not None and np.ptp(np.asarray(where.approach)) > 0:
        changed["approach"] = rng.choice([-1.0, 1.0], count)
    if where.temperature_degc is not None:
        wander = 25.0 + np.cumsum(rng.normal(0, 0.15, count)) + rng.normal(0, 0.1, count)
        changed["temperature_degc"] = wander[place]
    return replace(where, **changed)


def _rounded(how: Weighting) -> Weighting:
    """Weights that differ only by how well each sd is known count as the same."""
    largest = float(np.max(how.weights))
    return replace(how, weights=np.maximum(np.round(how.weights / largest, 1), 0.1) * largest)


def _key(where: Where, how: Weighting) -> tuple:
    columns = (where.alpha, where.beta, where.time_s, where.approach)
    numbers = tuple(None if column is None else np.round(np.asarray(column), 3).tobytes() for column in columns)
    groups = tuple((name, np.asarray(index).tobytes()) for name, index in where.groups.items())
    relative = np.round(how.weights / np.max(how.weights), 1).tobytes()
    size = float(f"{np.max(how.weights):.2g}") if how.known else 0.0
    common = None if how.whiten is None else np.round(how.whiten, 2).tobytes()
    return (
        numbers,
        where.temperature_degc is None,
        groups,
        relative,
        size,
        how.known,
        how.prior_weights.tobytes(),
        common,
    )

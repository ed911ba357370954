"""Properties of a screen that depend only on the plan: the distinct generic terms, and the null distribution of the test."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from tumblecal.chain import Where
from tumblecal.chain.where import Column
from tumblecal.diagnosis.causes.pool import Pool, pooled
from tumblecal.diagnosis.detection.alternatives import alternatives
from tumblecal.diagnosis.detection.detect import kept_null
from tumblecal.diagnosis.priors import EVEN, FINE_LEVEL, SAME_INPUTS, TYPICAL_NOISE
from tumblecal.estimation.problem import Problem
from tumblecal.full_model.full_model import FullModel
from tumblecal.full_model.layout import Layout
from tumblecal.full_model.tangent import Tangent, tangent
from tumblecal.ground.showing import brief
from tumblecal.noise.covariance import Covariance


# Plans whose references are remembered.
_MOST_PLANS = 64


class _OfPlan(NamedTuple):
    """Ideal inputs, g, and as of `Reference`."""

    inputs: Float[np.ndarray, "positions 3"]
    generic: tuple[int, ...]
    null: Float[np.ndarray, " draws"]


@dataclass(frozen=True)
class Reference:
    """Properties of a plan: the distinct generic terms, and the null distribution of the test statistic. The causes that it is
    drawn with are not kept: of a thousand positions they need a GiB.

    - `model`, `problem`: the plan measured by an instrument without errors.
    """

    __repr__ = brief

    model: FullModel
    problem: Problem

    @cached_property
    def _of_plan(self) -> "_OfPlan":
        at, pool = _screened(self.model, self.problem)
        null = kept_null(pool, alternatives(at, pool.effect_blocks), self.problem.known)
        return _OfPlan(at.evaluation.inputs, pool.generic, null)

    @property
    def generic(self) -> tuple[int, ...]:
        """Numbers of the distinct generic terms."""
        return self._of_plan.generic

    @property
    def null(self) -> Float[np.ndarray, " draws"]:
        """Sorted statistics of data without errors."""
        return self._of_plan.null

    def serves(self, at: Tangent) -> bool:
        """Whether data of the plan differ from it by small angles only, so that their null distribution is the same: settings
        equally spaced, known noise with the same proportions."""
        reference, given = self.problem, at.problem
        if not (reference.known and given.known) or given.correlated:
            return False
        if np.ptp(np.log(given.sd / reference.sd)) > 1e-3:
            return False
        columns = (
            (getattr(each.where, name) for each in (reference, given))
            for name in ("time_s", "temperature_degc", "approach")
        )
        if not all(_same_but_for_scale(*pair) for pair in columns):
            return False
        return bool(np.max(np.abs(at.evaluation.inputs - self._of_plan.inputs)) < SAME_INPUTS)

    @cached_property
    def null_of_unknown(self) -> Float[np.ndarray, " draws"]:
        """The null distribution if the level of the noise is unknown."""
        if not self.problem.known:
            return self.null
        at, pool = _screened(self.model, self.problem, self.generic)
        return kept_null(pool, alternatives(at, pool.effect_blocks), False)


def _screened(model: FullModel, problem: Problem, generic: tuple[int, ...] | None = None) -> tuple[Tangent, Pool]:
    """A plan without errors around that instrument, and its causes."""
    at = tangent(model, problem, model.start)
    level = 1.0 if problem.known else TYPICAL_NOISE * float(np.max(1.0 / problem.sd))
    return at, pooled(at, level, generic)


@dataclass
class References:
    """References by plan; a study or a row of files makes each only once.

    They are made from an instrument without errors measured at equal intervals, and serve every data set of the plan: the
    answer for one file does not depend on the files before it.
    """

    _made: dict[tuple, Reference] = field(default_factory=dict)

    def of(self, model: FullModel, problem: Problem) -> Reference:
        """The reference of the plan of a problem."""
        key = (model.layout.key, *_key(problem))
        if key not in self._made:
            plain = _rounded(replace(problem, where=_evenly(problem.where)))
            model = model.started(plain.where)
            plain = replace(plain, readings=model.predict(plain.where, model.start))
            while len(self._made) >= _MOST_PLANS:
                self._made.pop(next(iter(self._made)))
            self._made[key] = Reference(model, plain)
        return self._made[key]

    def forget(self, layout: Layout) -> None:
        """Drop the references of one kind of plan, which refer to its compiled programs."""
        for key in [key for key, made in self._made.items() if made.model.layout is layout]:
            del self._made[key]


def _same_but_for_scale(one: Column | None, other: Column | None) -> bool:
    """Whether two columns are the same but for where they begin and their unit."""
    if one is None or other is None:
        return one is other
    first, second = (np.asarray(column) - np.min(column) for column in (one, other))
    return np.allclose(first * np.max(second), second * np.max(first), rtol=1e-6, atol=0.0)


def _evenly(where: Where) -> Where:
    """The plan measured at equal intervals in the order in which it was, at a temperature that wanders a little, with
    approaches by chance where they differ."""
    count = len(np.asarray(where.alpha))
    rng, turn = np.random.default_rng(count), _turns(where)
    changed: dict[str, np.ndarray] = {}
    if where.time_s is not None:
        changed["time_s"] = 60.0 * turn
    if _approaches_differ(where):
        changed["approach"] = rng.choice([-1.0, 1.0], count)
    if where.temperature_degc is not None:
        wander = 25.0 + np.cumsum(rng.normal(0, 0.15, count)) + rng.normal(0, 0.1, count)
        changed["temperature_degc"] = wander[turn]
    # The references of squares too are those of the plan, not of the file that was first.
    for mean, column in (("mean_time_s", "time_s"), ("mean_degc", "temperature_degc")):
        if column in changed:
            changed[mean] = np.full(count, np.mean(changed[column]))
    return replace(where, **changed)


def _turns(where: Where) -> Int[np.ndarray, " positions"]:
    """When each position's turn was."""
    return np.argsort(np.argsort(where.measuring_order, kind="stable"), kind="stable")


def _approaches_differ(where: Where) -> bool:
    return where.approach is not None and bool(np.ptp(np.asarray(where.approach)) > 0)


def _shares(problem: Problem) -> Float[np.ndarray, "positions 3"]:
    """Weights of the readings as shares of the largest, all the same where they may count as such."""
    shares = np.min(problem.sd) / problem.sd
    return np.ones_like(shares) if np.min(shares) > 1 / EVEN else np.maximum(np.round(shares, 1), 0.1)


def _level(problem: Problem) -> float:
    """The smallest sd; of known noise to a digit, and one for all that is fine, unless priors weigh against it."""
    least = float(np.min(problem.sd))
    free = problem.known and not np.any(problem.prior_weights)
    return float(f"{max(least, FINE_LEVEL):.1g}") if free else least


def _rounded(problem: Problem) -> Problem:
    """The problem with independent noise, rounded to a level and shares."""
    return problem.with_noise(Covariance.of_sd(_level(problem) / _shares(problem)), known=problem.known)


def _key(problem: Problem) -> tuple:
    """What a reference depends on: the plan, the relative weights, the size of the noise where it is known."""
    where = problem.where
    angles = tuple(np.round(np.asarray(column), 3).tobytes() for column in (where.alpha, where.beta))
    order = None if where.time_s is None else _turns(where).tobytes()
    approach = True if _approaches_differ(where) else where.approach is None or float(where.approach[0])
    groups = tuple((name, np.asarray(index).tobytes()) for name, index in where.groups.items())
    return (
        angles,
        order,
        approach,
        where.temperature_degc is None,
        groups,
        _shares(problem).tobytes(),
        float(f"{_level(problem):.2g}") if problem.known else 0.0,
        problem.known,
        np.asarray(problem.prior_weights).tobytes(),
    )

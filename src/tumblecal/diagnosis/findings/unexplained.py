"""An error that no entry of the catalogue explains: where it is, how large, and which closed form may describe it.

It is in the smallest region of angles or times without which the fit explains the rest. Regions are scanned with an offset on
each output (a scan statistic, Kulldorff 1997). Among those that explain about as much as the best, the smallest is selected
without whose positions no other error remains.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.chain import Where
from tumblecal.diagnosis.findings.candidate_law import Law, candidate_law
from tumblecal.diagnosis.findings.law_forms import Form, boxes, pulses, values_of
from tumblecal.diagnosis.findings.residual_space import ResidualSpace, log_odds
from tumblecal.diagnosis.priors import (
    BOTH_ENDS,
    EXPLAINED_REST,
    LARGEST_REGION,
    NEAR_REGION,
    OUTSIDE_REGION,
    REGIONS_COMPARED,
    SURE_OUTPUT,
    SURELY_TIME,
)
from tumblecal.effects import AXES
from tumblecal.estimation.fit import Fit
from tumblecal.full_model.tangent import Tangent
from tumblecal.ground.showing import brief


class Range(NamedTuple):
    """The errors of one output, g: the lowest and the highest."""

    axis: str
    low: float
    high: float

    @property
    def largest(self) -> float:
        """The largest size."""
        return max(abs(self.low), abs(self.high))

    @property
    def words(self) -> str:
        """Both ends, or the larger one."""
        low, high = (f"{end * 1e3:+.1g}" if abs(end) < 1e-3 else f"{end * 1e3:+.2g}" for end in (self.low, self.high))
        if min(self.high, -self.low) > BOTH_ENDS * self.largest:
            return f"{self.axis} {low} to {high} mg"
        return f"{self.axis} up to {high} mg" if self.high > -self.low else f"{self.axis} down to {low} mg"


@dataclass(frozen=True)
class Excess:
    """An error that nothing explains.

    - `region`: angles or times in words; "": everywhere. `positions`: those in it.
    - `ranges`: of the outputs in error there, the largest first.
    - `values`: measured minus predicted, g: in a region from a fit without it, otherwise the residuals of the fit.
    """

    __repr__ = brief

    region: str
    positions: Bool[np.ndarray, " positions"]
    ranges: tuple[Range, ...]
    values: Float[np.ndarray, "positions 3"]

    @property
    def largest(self) -> float:
        """The largest error, g."""
        return max((errors.largest for errors in self.ranges), default=0.0)

    @property
    def words(self) -> str:
        """Where, and how large."""
        sizes = ", ".join(errors.words for errors in self.ranges)
        if not self.region:
            return f"Excess at all angles and times{f': {sizes}' if sizes else ''}"
        return f"Excess at {self.region}{f': {sizes}' if sizes else ''}; not elsewhere"


@dataclass(frozen=True)
class Unnamed:
    """An error that no entry explains: `fit` is that of the model with the named causes, which leaves it."""

    __repr__ = brief

    fit: Fit
    law: Law | None
    excess: Excess

    @property
    def positions(self) -> list[str]:
        """Names of the positions in the region."""
        return [name for name, inside in zip(self.fit.problem.names, self.excess.positions, strict=True) if inside]


def unnamed(at: Tangent, fit: Fit) -> Unnamed:
    """Region of the residuals of a fit, and a candidate law for them.

    **Arguments:**

    - `at`: a linearisation near the fit.
    """
    whole, probe = ResidualSpace.of(fit), at.model.probe
    # The probe's first two angles turn as the spindle and the pitch axis do.
    head = at.evaluation.jacobian[:, :, probe][:, :, :2] / at.model.scales[probe][:2]
    law = candidate_law(whole, fit.problem.where, np.asarray(at.evaluation.inputs), head)
    return Unnamed(fit, law, excess(whole, fit, law))


def excess(whole: ResidualSpace, fit: Fit, law: Law | None) -> Excess:
    """Region in which the residuals of a fit are larger than the noise.

    **Arguments:**

    - `whole`: residual of the fit. `law`: law that explains it, if there is one.
    """
    where, residuals = fit.problem.where, np.asarray(fit.residuals)
    sizes = np.zeros(len(residuals)) if law is None else np.max(np.abs(law.signal), axis=1)
    for form, inside in _regions(whole, where):
        # Not the region, if there is a law that makes much of its error outside of it.
        if np.max(sizes[~inside], initial=0.0) > OUTSIDE_REGION * np.max(sizes):
            continue
        rest = whole.without(whole.of_positions(inside))
        if rest.p_value is None:
            explained = rest.dof > 0 and not np.any(_scanned(rest, where)[1] > 0)
        else:
            explained = rest.p_value > EXPLAINED_REST
        if explained:
            values, sd = whole.predicted_errors(inside)
            errors = residuals.copy()
            errors[inside] = values
            return Excess(form.words[0].replace("] [", ", ").strip("[]"), inside, _ranges(values, sd), errors)
    values = residuals if law is None else law.signal
    sd = np.sqrt(whole.variance) * np.asarray(fit.problem.sd)
    return Excess("", np.asarray(fit.retained).copy(), _ranges(values[fit.retained], sd[fit.retained]), residuals)


def _ranges(values: Float[np.ndarray, "inside 3"], sd: Float[np.ndarray, "inside 3"]) -> tuple[Range, ...]:
    together = np.abs(np.sum(values / sd**2, axis=0)) / np.sqrt(np.sum(1 / sd**2, axis=0))
    sure = np.maximum(np.max(np.abs(values) / sd, axis=0), together) > SURE_OUTPUT
    shown = sure if np.any(sure) else together == np.max(together)
    lows, highs = np.minimum(np.min(values, axis=0), 0.0).tolist(), np.maximum(np.max(values, axis=0), 0.0).tolist()
    listed = [Range(axis, lows[k], highs[k]) for k, axis in enumerate(AXES) if shown[k]]
    return tuple(sorted(listed, key=lambda errors: -errors.largest))


def _regions(whole: ResidualSpace, where: Where) -> list[tuple[Form, Bool[np.ndarray, " positions"]]]:
    """The regions in which an offset explains about as much as in the best, the smallest first, and their positions."""
    listed, scores, inside = _scanned(whole, where)
    best, counts = np.max(scores, initial=-np.inf), np.sum(inside, axis=1)
    if best <= 0:
        return []
    of_time = np.array([form.against == "time" for form in listed])
    if np.max(scores[~of_time], initial=-np.inf) > best - SURELY_TIME:
        # Pitch settings are measured one after the other: a range of times is then one of angles as well.
        scores = np.where(of_time, -np.inf, scores)
    near = [k for k in np.argsort(counts, kind="stable").tolist() if scores[k] > NEAR_REGION * best]
    near = sorted(near, key=lambda k: -scores[k])[:REGIONS_COMPARED]
    return [(listed[k], inside[k]) for k in sorted(near, key=lambda k: counts[k])]


def _scanned(
    whole: ResidualSpace, where: Where
) -> tuple[Sequence[Form], Float[np.ndarray, " regions"], Bool[np.ndarray, "regions positions"]]:
    """All regions, twice the log of what an offset on each output in it is more probable than nothing, and their positions."""
    listed = [*boxes(where), *(pulses(where) if where.time_s is not None else ())]
    count = len(np.asarray(where.alpha))
    values = values_of(listed, where, np.zeros((count, 3)))
    if not listed:
        return [], np.zeros(0), values > 0
    (scores,) = log_odds(whole, values[:, None], np.moveaxis(whole.responses, 2, 0), [range(3)])
    counts = values.sum(axis=1)
    fits = (counts > 0) & (counts <= LARGEST_REGION * count)
    return listed, np.where(fits, scores - 2 * np.log(len(listed)), -np.inf), values > 0

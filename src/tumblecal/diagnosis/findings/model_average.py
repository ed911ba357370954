"""Parameters averaged over the explanations that remain, weighted by their probabilities.

An estimate by the best explanation alone states an uncertainty as if this explanation were certain. The average (the DIA
estimator of Teunissen 2018, J. Geodesy 92, 59) is the mean of the mixture; `findings.in_use` computes it. A coefficient counts
as zero, and known, under an explanation that lacks it. An effect of temperature takes part in the mean only where the best
explanation has one: a calibration that needs the temperature is a different one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.diagnosis.causes.cause import Cause
from tumblecal.diagnosis.findings.determined import says_something
from tumblecal.diagnosis.priors import LEAST_AVERAGED_SHARE, MOST_AVERAGED
from tumblecal.diagnosis.refine.insert import fit_with
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.diagnosis.sets.cause_sets import sets_of
from tumblecal.diagnosis.sets.groups import grouped
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.plausibility import implausible
from tumblecal.full_model.effect_directions import UndetectedEffects
from tumblecal.ground.showing import brief


@dataclass(frozen=True)
class Weighed:
    """An explanation with its share of the average, its causes and their exact fit."""

    __repr__ = brief

    labels: tuple[str, ...]
    share: float
    members: tuple[Cause, ...]
    fit: Fit


@dataclass(frozen=True)
class Average:
    """The parameters averaged over explanations.

    - `weighed`: the explanations, most probable first. `names`: of the nominal parameters, then of every coefficient that
      one of them has. `values`, `covariance`: base units. `unidentifiable`: as of a fit.
    - `undetected`: contribution of undetected effects to the covariance.
    - `to_reference`: contribution of each coefficient of the full vector to the nominal parameters at the reference, as of
      `moved_to_reference`.
    """

    __repr__ = brief

    weighed: tuple[Weighed, ...]
    names: tuple[str, ...]
    values: Float[np.ndarray, " names"]
    covariance: Float[np.ndarray, "names names"]
    unidentifiable: Float[np.ndarray, "names directions"]
    undetected: UndetectedEffects
    to_reference: Float[np.ndarray, "nominal full"]

    @property
    def sd(self) -> Float[np.ndarray, " names"]:
        """Standard uncertainties."""
        return np.sqrt(np.diag(self.covariance))

    @cached_property
    def idle(self) -> Bool[np.ndarray, " nominal"]:
        """Mask of the nominal parameters on which no position in the fits depends, such as those of an excluded setting."""
        return ~np.any([one.fit.used[: len(self.to_reference)] for one in self.weighed], axis=0)

    @property
    def parts(self) -> dict[str, Float[np.ndarray, " names"]]:
        """The standard uncertainties by their contributions, which add in quadrature: of the noise under the leading
        explanation, of the choice of the explanation, of undetected effects."""
        fit, whole, noise = self.weighed[0].fit, np.diag(self.covariance), np.zeros(len(self.names))
        noise[[self.names.index(name) for name in fit.names]] = np.diag(fit.covariance)
        # A named and an undetected effect that are correlated may add less than the second alone.
        undetected = np.minimum(np.diag(self.undetected.covariance), whole)
        # Another explanation may leave less noise than the leading one.
        noise = np.minimum(noise, whole - undetected)
        explanations = whole - undetected - noise
        parts = {"noise": noise, "explanations": explanations, "undetected_effects": undetected}
        return {name: np.sqrt(np.maximum(variance, 0.0)) for name, variance in parts.items()}

    @property
    def as_fit(self) -> Fit:
        """The fit of the leading explanation with the averaged values and covariance of its parameters."""
        fit = self.weighed[0].fit
        places = [self.names.index(name) for name in fit.names]
        covariance, unidentifiable = self.covariance[np.ix_(places, places)], self.unidentifiable[places]
        return replace(fit, values=self.values[places], covariance=covariance, unidentifiable=unidentifiable)

    def value(self, name: str) -> float:
        """A parameter's mean, base units."""
        return float(self.values[self.names.index(name)])


def remaining_explanations(screened: Screened, extended: Fit | None = None) -> list[Weighed]:
    """The explanations that are probable enough, best first, with their exact fits; their shares add up to 1.

    **Arguments:**

    - `extended`: the fit of the causes of the leading explanation, if available.
    """
    groups, total = grouped(screened.search, screened.search.ranked())
    shares, sets = np.exp(groups.log_posterior - total), sets_of(groups.sets)
    if screened.detection.detected:
        # An explanation without a cause cannot explain a contradiction to the model.
        shares *= [bool(labels) for labels in groups.labels]
    probable = [
        k for k in np.argsort(-shares).tolist()[:MOST_AVERAGED] if shares[k] >= LEAST_AVERAGED_SHARE * np.max(shares)
    ]
    thermal, weighed = is_thermal(screened.members), list[Weighed]()
    for k in probable:
        labels, members = groups.labels[k], tuple([screened.search.pool.causes[cause] for cause in sets[k]])
        if is_thermal(members) and not thermal:
            continue
        leads = bool(screened.best.members) and labels == screened.best.labels
        fit = extended if leads and extended is not None else fit_with(screened.at, members)
        # An implausible explanation is excluded, unless it leads.
        if fit.code.good and says_something(fit, screened.at.model.nominal) and not (weighed and implausible(fit)):
            weighed.append(Weighed(labels, float(shares[k]), members, fit))
    whole = sum(explanation.share for explanation in weighed)
    return [replace(explanation, share=explanation.share / whole) for explanation in weighed]


def is_thermal(members: Sequence[Cause]) -> bool:
    """Whether an effect of temperature is among some causes."""
    return any(cause.slot.thermal for cause in members)

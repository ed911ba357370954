"""Parameters for several remaining explanations: the average, weighted by their probabilities.

An estimate by the best explanation alone states an uncertainty as if this explanation were certain. The average (the DIA
estimator of Teunissen 2018, J. Geodesy 92, 59) is the mean of the mixture: `x = sum p x_i`, and its covariance that of the
explanations plus their spread: `P = sum p (P_i + (x_i - x)(x_i - x)')`. A coefficient counts as zero, and known, under an
explanation that lacks it. An effect of temperature takes part in the mean only where the best explanation has one: a
calibration that needs the temperature is a different one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.causes.cause import Cause
from tumblecal.diagnosis.findings.determined import says_something
from tumblecal.diagnosis.findings.reference import at_reference
from tumblecal.diagnosis.findings.undetected_effects import UndetectedEffects
from tumblecal.diagnosis.refine.insert import fit_with
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.diagnosis.sets.cause_sets import sets_of
from tumblecal.diagnosis.sets.groups import grouped
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.plausibility import implausible
from tumblecal.ground.showing import brief


# Explanations less probable than this share of the most probable one take no part in the mean, and at most so many do; those
# less probable than the third count as not there.
_LEAST_SHARE, _MOST, _LEAST_LEFT = 0.05, 8, 0.01


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
    - `undetected`: contribution of undetected effects to the covariance; None if it is not included.
    - `to_reference`: contribution of each coefficient of the full vector to the nominal parameters at the reference, as of
      `moved_to_reference`; None if it is not included.
    """

    __repr__ = brief

    weighed: tuple[Weighed, ...]
    names: tuple[str, ...]
    values: Float[np.ndarray, " names"]
    covariance: Float[np.ndarray, "names names"]
    unidentifiable: Float[np.ndarray, "names directions"]
    undetected: UndetectedEffects | None = None
    to_reference: Float[np.ndarray, "nominal full"] | None = None

    @property
    def sd(self) -> Float[np.ndarray, " names"]:
        """Standard uncertainties."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def parts(self) -> dict[str, Float[np.ndarray, " names"]]:
        """The standard uncertainties by their contributions, which add in quadrature: of the noise under the leading
        explanation, of the choice of the explanation, of undetected effects."""
        fit, whole, noise = self.weighed[0].fit, np.diag(self.covariance), np.zeros(len(self.names))
        noise[[self.names.index(name) for name in fit.names]] = np.diag(fit.covariance)
        undetected = np.zeros(len(self.names)) if self.undetected is None else np.diag(self.undetected.covariance)
        # A named and an undetected effect that are correlated may add less than the second alone.
        undetected = np.minimum(undetected, whole)
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


class Left(NamedTuple):
    """A remaining explanation, with its probability among all evaluated ones, and its causes."""

    __repr__ = brief

    labels: tuple[str, ...]
    share: float
    members: tuple[Cause, ...]


def explanations_left(screened: Screened) -> list[Left]:
    """Explanations whose probability is at least a hundredth of that of the most probable one, best first."""
    groups, total = grouped(screened.search, screened.search.ranked())
    shares, sets = np.exp(groups.log_posterior - total), sets_of(groups.sets)
    if screened.detection.detected:
        # What contradicts the model is not explained by nothing.
        shares *= [bool(labels) for labels in groups.labels]
    order = [k for k in np.argsort(-shares).tolist() if shares[k] > _LEAST_LEFT * np.max(shares)]
    causes = screened.search.pool.causes
    return [Left(groups.labels[k], float(shares[k]), tuple(causes[cause] for cause in sets[k])) for k in order]


def averaged(
    screened: Screened,
    left: Sequence[Left],
    added: Float[np.ndarray, "nominal full"],
    acted_on: Fit | None = None,
) -> Average | None:
    """The parameters averaged over the explanations that are probable enough, at the reference of `findings.reference`; None
    if only one is, or if they concern the noise.

    **Arguments:**

    - `left`: as of `explanations_left`. `added`: as of `moved_to_reference`.
    - `acted_on`: the fit of the causes of the leading explanation, if available.
    """
    at, weighed, thermal = screened.at, [], is_thermal(screened.members)
    for labels, share, members in left[:_MOST]:
        if share < _LEAST_SHARE * left[0].share or (is_thermal(members) and not thermal):
            continue
        made = bool(screened.best.members) and labels == screened.best.labels
        fit = acted_on if made and acted_on is not None else fit_with(at, members)
        # An implausible explanation is excluded, unless it leads.
        if fit.code.good and says_something(fit) and not (weighed and implausible(fit)):
            weighed.append(Weighed(labels, share, members, at_reference(fit, at, added)))
    if len(weighed) < 2:
        return None
    whole = sum(own.share for own in weighed)
    return mixed([replace(own, share=own.share / whole) for own in weighed])


def is_thermal(members: Sequence[Cause]) -> bool:
    """Whether an effect of temperature is among some causes."""
    return any(cause.slot.thermal for cause in members)


def mixed(weighed: Sequence[Weighed]) -> Average:
    """The average over some explanations, whose shares come to 1."""
    names = tuple(dict.fromkeys(name for own in weighed for name in own.fit.names))
    values, within = np.zeros((len(weighed), len(names))), np.zeros((len(names), len(names)))
    shares, hidden = np.array([own.share for own in weighed]), [np.zeros((len(names), 0))]
    for row, own in enumerate(weighed):
        places = [names.index(name) for name in own.fit.names]
        values[row, places] = own.fit.values
        within[np.ix_(places, places)] += own.share * own.fit.covariance
        shifts = np.zeros((len(names), own.fit.unidentifiable.shape[1]))
        if shifts.size:
            shifts[places] = np.sqrt(own.share) * own.fit.unidentifiable
        hidden.append(shifts)
    mean = shares @ values
    off = values - mean
    return Average(tuple(weighed), names, mean, within + (off.T * shares) @ off, np.hstack(hidden))

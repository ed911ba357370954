"""Parameters for use of a calibration: at one reference, with one stated uncertainty.

The covariance of one fit is that of its noise. Here every effect of the catalogue is included, named or not
(`full_model.effect_posterior`). The mean of the named effects is removed from the parameters and, once an error was detected,
that of all effects that are no property of the sensor. The covariance is the mean square deviation from the written values,
over all explanations (Hoeting et al. 1999, Statistical Science 14, 382) and over the effects that were not detected.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.diagnosis.causes.cause import SIGNS, Cause
from tumblecal.diagnosis.findings.model_average import Average, Weighed, is_thermal, remaining_explanations
from tumblecal.diagnosis.priors import MOST_BEHIND
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.diagnosis.sets.cause_sets import sets_of
from tumblecal.diagnosis.sets.groups import grouped
from tumblecal.diagnosis.sets.prior import log_prior
from tumblecal.effects import Catalogue
from tumblecal.effects.effect import NO_FORMS, reason_not_held
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.identifiability import RANK_TOLERANCE
from tumblecal.full_model.effect_directions import (
    NOT_CONSIDERED,
    EffectDirections,
    UndetectedEffects,
    included_orders,
    of_every_sensor,
)
from tumblecal.full_model.effect_posterior import Candidates, effect_posterior
from tumblecal.full_model.priors import SIZE_PRIOR
from tumblecal.full_model.reference import at_reference, long_lived, moved_to_reference
from tumblecal.full_model.tangent import tangent


# The parameters by one linearisation: values, covariance, shifts of the values by each direction of an effect's coefficients,
# and mean products of these about the removed means.
_Estimate = tuple[
    Float[np.ndarray, " names"],
    Float[np.ndarray, "names names"],
    Float[np.ndarray, "names directions"],
    Float[np.ndarray, "directions directions"],
]


def in_use(
    screened: Screened, entries: Catalogue, directions: EffectDirections, extended: Fit, sigma: float, verdict: str
) -> Average:
    """For an ambiguous verdict the mean over the explanations, otherwise the leading explanation; with the covariance for use.

    **Arguments:**

    - `directions`: of all effects. `extended`: exact fit of the leading explanation. `sigma`: noise in units of the white
      rows.
    """
    at = screened.at
    added = moved_to_reference(at, {slot.id for slot in at.model.slots}, thermal=is_thermal(screened.members))
    weighed = remaining_explanations(screened, extended) if verdict == "ambiguous" else []
    if len(weighed) < 2:
        weighed = [Weighed(screened.best.labels, 1.0, screened.members, extended)]
    weighed = [replace(explanation, fit=at_reference(explanation.fit, at, added)) for explanation in weighed]
    members = [cause.slot for explanation in weighed for cause in explanation.members]
    directions = directions.only(~directions.of({*NOT_CONSIDERED, *included_orders(at.model.slots, members)}))
    named = directions.of({cause.slot.id for explanation in weighed for cause in explanation.members})
    removed = named
    if screened.detection.detected:
        # The effects that no calibration file contains, as they are no property of the sensor; a user's effect without `forms`
        # is not one of them.
        slots = [slot for slot in screened.at.model.slots if slot.id]
        reasons = {slot.id: reason_not_held(entries[slot.id], slot.links) for slot in slots}
        removed = named | directions.of({id for id, reason in reasons.items() if reason not in ("", NO_FORMS)})
    names = tuple(dict.fromkeys(name for explanation in weighed for name in explanation.fit.names))
    # What is no effect is undone in a fit: explanations with the same faults have one linearisation.
    by_faults: dict[tuple[str, ...], list[Weighed]] = {}
    for explanation in weighed:
        by_faults.setdefault(_faults(explanation.members), []).append(explanation)
    estimates = [
        _estimate(screened, group[0], weighed, names, directions, named, removed, added, sigma)
        for group in by_faults.values()
    ]
    shares = [sum(explanation.share for explanation in group) for group in by_faults.values()]
    values = np.tensordot(shares, [own for own, *_ in estimates], 1)
    covariance, undetected = np.zeros((len(names), len(names))), np.zeros((len(names), len(names)))
    for share, (own, of_own, shifts, products) in zip(shares, estimates, strict=True):
        further = shifts * ~named
        covariance += share * (of_own + np.outer(own - values, own - values))
        undetected += share * (further @ products @ further.T)
    _, _, shifts, products = estimates[0]
    absorbed = named & ~directions.shown
    return Average(
        weighed=tuple(weighed),
        names=names,
        values=values,
        covariance=covariance,
        unidentifiable=shifts[:, absorbed] * np.sqrt(np.diag(products)[absorbed]),
        undetected=UndetectedEffects(
            undetected, shifts, directions.steps, products, directions.numbers, directions.ids, named
        ),
        to_reference=added,
    )


def _faults(members: Sequence[Cause]) -> tuple[str, ...]:
    """The causes that are not effects of the catalogue."""
    return tuple(sorted(cause.label for cause in members if not cause.slot.columns))


def _estimate(
    screened: Screened,
    base: Weighed,
    weighed: Sequence[Weighed],
    names: Sequence[str],
    directions: EffectDirections,
    named: Bool[np.ndarray, " directions"],
    removed: Bool[np.ndarray, " directions"],
    added: Float[np.ndarray, "nominal full"],
    sigma: float,
) -> _Estimate:
    """The parameters if the faults of one explanation are undone, from the problem linearised at its fit, in noise standard
    deviations, without excluded positions.

    **Arguments:**

    - `base`: that explanation. `weighed`: all of them. `names`: of all their parameters.
    - `named`: of effects whose coefficients are written. `removed`: of effects whose mean is removed from the parameters.
    - `added`: contribution of each coefficient to the nominal parameters at the reference.
    """
    at, model, fit = screened.at, screened.at.model, base.fit
    if dying := [cause.slot for cause in base.members if cause.slot.shape]:
        # The time constants as fitted.
        at = tangent(model, at.problem, fit.vector)
        added = long_lived(at, dying, added)
    slots = [cause.slot for cause in base.members]
    # A time constant that was fitted is one more parameter.
    shapes = [
        column
        for slot in slots
        for column, name in zip(slot.all_columns, slot.names, strict=True)
        if column in slot.shape and fit.noise_covariance[(k := fit.names.index(name)), k] > 0
    ]
    columns, in_fit = [*range(model.nominal), *shapes], fit.jacobian.any(axis=1)
    jacobian, fitted = at.jacobian[in_fit] / sigma, fit.jacobian[in_fit] / sigma
    terms = fitted.shape[1] - sum(len(cause.terms) for cause in base.members)
    # The fitted parameters without the named effects' coefficients, which count as effects here, the nominal ones first.
    fitted = np.hstack([fitted[:, : model.nominal], jacobian[:, shapes], fitted[:, terms:]])
    vectors, singular, right = np.linalg.svd(fitted, full_matrices=False)
    seen = singular > RANK_TOLERANCE * singular[0]
    reached, estimator = vectors[:, seen], (right[seen, : len(columns)].T / singular[seen]) @ vectors[:, seen].T
    amplitudes = [column for slot in slots for column in slot.columns]
    rows = fit.rows[in_fit] / sigma + jacobian[:, amplitudes] @ (fit.vector / model.scales)[amplitudes]
    signals = jacobian @ directions.steps.T
    always = np.array([of_every_sensor(id) for id in directions.ids], bool)[directions.numbers]
    posterior = effect_posterior(
        signals - reached @ (reached.T @ signals),
        rows - reached @ (reached.T @ rows),
        directions.shown,
        always & directions.shown,
        _candidates(screened, base, directions),
        dof=len(rows) - reached.shape[1],
        known=screened.problem.known,
    )
    mean = posterior.mean * removed
    crossed = np.outer(posterior.mean, mean)
    products = posterior.second - crossed - crossed.T + np.outer(mean, mean)
    slots = [cause.slot for explanation in weighed for cause in explanation.members]
    names_of = dict(enumerate(model.names)) | {
        column: name for slot in slots for column, name in zip(slot.all_columns, slot.names, strict=True)
    }
    shifts, values = np.zeros((len(names), len(mean))), np.zeros(len(names))
    for explanation in weighed:
        # Time constants without a fit here.
        values[[names.index(name) for name in explanation.fit.names]] += explanation.share * explanation.fit.values
    places, scales = [names.index(names_of[column]) for column in columns], model.scales[columns]
    moved = -estimator @ signals
    moved[: model.nominal] += added @ directions.steps.T
    shifts[places] = moved * scales[:, None]
    step = scales * (estimator @ rows) + shifts[places] @ mean
    # A step along a time constant is meaningless if its amplitude differs.
    step[model.nominal :] = 0.0
    values[places] = fit.vector[columns] + step
    for column in (column for slot in slots for column in slot.columns):
        place = names.index(names_of[column])
        shifts[place] = model.scales[column] * directions.steps[:, column] * named
        values[place] = shifts[place] @ mean
    covariance = shifts @ products @ shifts.T
    spread = scales[:, None] * estimator
    covariance[np.ix_(places, places)] += spread @ spread.T
    return values, covariance, shifts, products


def _candidates(screened: Screened, base: Weighed, directions: EffectDirections) -> Candidates:
    """The explanations of the search that have the same faults and are not negligible, with `base` in any case."""
    search, faults = screened.search, _faults(base.members)
    groups, _ = grouped(search, search.ranked())
    labels, numbers = search.pool.labels, {id: number for number, id in enumerate(directions.ids)}
    acts = np.zeros(search.pool.size, bool)
    acts[[*search.pool.effects, *search.pool.numbers_of(SIGNS)]] = True
    ids, weights, met = list[list[str]](), list[float](), False
    listed = zip(groups.labels, sets_of(groups.sets), groups.log_prior.tolist(), groups.log_posterior, strict=True)
    for names, members, weight, posterior in listed:
        near = posterior > groups.log_posterior[0] - MOST_BEHIND or names == base.labels or not names
        if near and tuple(sorted(labels[k] for k in members if not acts[k])) == faults:
            met |= names == base.labels
            ids.append([labels[k] for k in members if acts[k]])
            weights.append(weight if names else float(np.log(SIZE_PRIOR[0])))
    if not met:
        known = base.labels == screened.best.labels and screened.best.members
        ids.append([cause.slot.id for cause in base.members if cause.slot.columns])
        weights.append(log_prior(search.pool, screened.best.members) if known else 0.0)
    there = np.zeros((len(ids), len(numbers)), bool)
    for row, effects in enumerate(ids):
        there[row, [numbers[id] for id in effects if id in numbers]] = True
    there = there[:, directions.numbers]
    return Candidates(there & directions.shown, there & ~directions.shown, np.array(weights))

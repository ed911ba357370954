"""Effects of the catalogue that a fit may have missed: a test of the model against them, and what the data still allow.

The test is the Bayes factor of "one effect of the catalogue" against "none" (`full_model.evidence`), which is valid for known
and for unknown noise. By Ville's inequality, noise alone exceeds a factor `c` with a probability of at most `1 / c`. The
coefficients that the data still allow follow from `full_model.effect_posterior`, with each single effect and none as
explanations.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.special import logsumexp

from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.effects import Catalogue
from tumblecal.estimation.contradicted import column_space
from tumblecal.estimation.fit import Fit
from tumblecal.full_model.effect_directions import (
    NOT_CONSIDERED,
    EffectDirections,
    UndetectedEffects,
    effect_directions,
    of_every_sensor,
)
from tumblecal.full_model.effect_posterior import Candidates, effect_posterior
from tumblecal.full_model.evidence import log_evidence, log_evidence_of_noise
from tumblecal.full_model.full_model import FullModel, model_of
from tumblecal.full_model.priors import EFFECT_WEIGHT, SIZE_PRIOR, VISIBLE
from tumblecal.full_model.reference import moved_to_reference
from tumblecal.full_model.tangent import Tangent, tangent
from tumblecal.full_model.visibility import Visibilities, least_signal, visibilities
from tumblecal.ground.precision import single_blas_thread


class MissedEffects(NamedTuple):
    """The outcome for one fit.

    - `p_value`: upper bound, that data without an effect contradict the model as much; None if the residuals can show none.
    - `undetected`: shifts of the parameters `SENSOR` (base units) by effects that the data allow. `model`: of its directions.
    """

    p_value: float | None
    undetected: UndetectedEffects
    model: FullModel


# Slots of effects with equally many coefficients, and their visible part.
_Groups = Sequence[tuple[Int[np.ndarray, " slots"], Visibilities]]


def missed_effects(fit: Fit, entries: Catalogue) -> MissedEffects:
    """Test an exact fit of one sensor against every effect that its columns allow, and bound what it may have missed.

    `entries`: the catalogue.
    """
    problem = fit.problem
    model = model_of(problem.chain, problem.where, entries)
    with single_blas_thread():
        at = tangent(model, problem, model.with_nominal(fit.chain.vector))
        nominal = at.jacobian[:, : model.nominal]
        basis = column_space(nominal)
        remaining = at.jacobian - basis @ (basis.T @ at.jacobian)
        rounding = least_signal(at)
        groups = [
            (numbers, visibilities(at.varying.T[columns], remaining.T[columns], VISIBLE, rounding))
            for numbers, columns in model.layout.by_width.values()
        ]
        z = at.residual - basis @ (basis.T @ at.residual)
        p_value = _tested(model, groups, z, fit)
        directions = effect_directions(at, groups, entries)
        directions = directions.only(~directions.of(NOT_CONSIDERED))
        undetected = _undetected(at, fit, directions, remaining, z, np.linalg.pinv(nominal, rcond=1e-9))
    return MissedEffects(p_value, undetected, model)


def _tested(model: FullModel, groups: _Groups, z: Float[np.ndarray, " rows"], fit: Fit) -> float | None:
    """The p-value of the test."""
    known, numbers, scores = fit.problem.known, list[int](), list[float]()
    total = float(z @ z)
    for slots, seen in groups:
        explained = np.sum((seen.signals @ z) ** 2 * seen.shown[:, : seen.signals.shape[1]], axis=1)
        ranks = seen.shown.sum(axis=1)
        shown = ranks > 0
        totals = np.full(int(np.sum(shown)), total)
        scores += log_evidence(totals, [(explained[shown], ranks[shown])], fit.dof, known).tolist()
        numbers += slots[shown].tolist()
    if not np.any(np.isfinite(scores)):
        return None
    weighted = np.array(scores) + model.layout.log_shares(np.array(numbers, int))
    log_factor = float(np.asarray(logsumexp(weighted))) - float(log_evidence_of_noise(np.array(total), fit.dof, known))
    return float(np.exp(-max(log_factor, 0.0)))


def _undetected(
    at: Tangent,
    fit: Fit,
    directions: EffectDirections,
    remaining: Float[np.ndarray, "rows full"],
    z: Float[np.ndarray, " rows"],
    estimator: Float[np.ndarray, "nominal rows"],
) -> UndetectedEffects:
    """Shifts of the sensor's parameters by the effects, with the mean products of their coefficients given the data."""
    model, sigma = at.model, 1.0 if fit.problem.known or not fit.level > 0 else fit.level
    always = np.isin(directions.numbers, [k for k, id in enumerate(directions.ids) if of_every_sensor(id)])
    posterior = effect_posterior(
        remaining @ directions.steps.T / sigma,
        z / sigma,
        directions.shown,
        always & directions.shown,
        _candidates(at, directions),
        dof=max(fit.dof, 1),
        known=fit.problem.known,
    )
    added = moved_to_reference(at, {slot.id for slot in model.slots}, thermal=False)
    moved = (added - estimator @ at.jacobian) @ directions.steps.T
    # A fixed parameter does not move.
    estimated = np.array(SENSOR)[:, None] == np.array(model.names)
    shifts = estimated @ (model.scales[: model.nominal, None] * moved)
    named = np.zeros(len(directions.numbers), bool)
    covariance = shifts @ posterior.second @ shifts.T
    steps, numbers, ids = directions.steps, directions.numbers, directions.ids
    return UndetectedEffects(covariance, shifts, steps, posterior.second, numbers, ids, named)


def _candidates(at: Tangent, directions: EffectDirections) -> Candidates:
    """No effect, and every single one that the residuals can show, with their priors."""
    weights = {slot.id: slot.weight for slot in at.model.slots}
    ids = [id for k, id in enumerate(directions.ids) if np.any(directions.shown[directions.numbers == k])]
    acting = np.stack([np.zeros(len(directions.numbers), bool), *[directions.of({id}) for id in ids]])
    shares = np.array([weights[id] for id in ids])
    singles = np.log(SIZE_PRIOR[1] * EFFECT_WEIGHT * shares / np.sum(shares))
    return Candidates(acting & directions.shown, acting & ~directions.shown, np.append(np.log(SIZE_PRIOR[0]), singles))

"""Criteria of effects for the search of a plan: sizes that are named, and errors in use by unknown effects.

An effect's coefficient has the standard deviation sd without other causes in the model, and a larger one together with another
effect of a similar signal. It is detected, and separated from the other, if it is so many of these (`_detected`, `_SEPARATED`).
Both are covariances of linear models with further columns, so each criterion is the largest of several.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from scipy.special import ndtri

from tumblecal.diagnosis.causes.identities import one_function_at_1_g
from tumblecal.diagnosis.findings.limits import noncentrality
from tumblecal.diagnosis.priors import EFFECT_TEST_WEIGHT, POWER, SURE
from tumblecal.full_model.layout import Slot
from tumblecal.full_model.priors import VISIBLE
from tumblecal.ground.errors import InputError
from tumblecal.plan.cells import Numbers
from tumblecal.plan.criterion import Combine, Criterion, Part
from tumblecal.plan.exchange import Term
from tumblecal.plan.forecast.effects_of_plan import EffectsOfPlan, effect_in_use, effects_of_cells, of_use, sensor_rows
from tumblecal.plan.information import LinearModel, one_visit
from tumblecal.plan.responses import Responses


__all__ = ["TERMS", "alias_term", "effects_of_cells", "naming_term"]

# Two explanations with equal priors, one of which leaves d^2 of the other's signal: their log odds are d^2/2 with the standard
# deviation d, and with probability `POWER` they must give a probability of `SURE`.
_QUANTILE = float(ndtri(POWER))
_SEPARATED = _QUANTILE + float(np.sqrt(_QUANTILE**2 + 2 * np.log(SURE / (1 - SURE))))
# Number of other effects from which each is separated.
_NEAREST = 4


def naming_term(of: EffectsOfPlan, responses: Responses, measured: Numbers, effects: Mapping[str, float]) -> Term:
    """About the smallest size of some effects that is identified with probability 0.8, relative to the wanted sizes; at 1 every
    effect of its size is.

    **Arguments:**

    - `of`: the effects at all cells of the `responses`, one after another. `measured`: cells that are measured already.
    - `effects`: wanted sizes by id, in the unit of the entry.

    **Raises:** `InputError` for an effect that no choice of positions shows, or that positions cannot be chosen for.
    """
    listed = list[tuple[LinearModel, Criterion]]()
    for id, size in effects.items():
        own = _signal(of, id)
        wanted = [(own, _detected(of))]
        nearest = _nearest(of, one_visit(responses, measured), id)
        wanted += [(np.concatenate([own, of.signals(slot)], axis=2), _SEPARATED) for slot in nearest]
        for columns, needed in wanted:
            row = np.eye(1, len(responses.names) + columns.shape[2], len(responses.names)) * needed / size
            listed.append(_criterion(responses.extended(columns), measured, row, "largest"))
    return Term(tuple(listed))


def alias_term(of: EffectsOfPlan, responses: Responses, measured: Numbers, effects: Mapping[str, float]) -> Term:
    """The largest error in use, mg, of some effects at their detection limits that the calibration does not know.

    **Arguments**, **Raises**: as of `naming_term`.
    """
    names, use, listed = responses.names, of_use(of.at.problem.where), list[tuple[LinearModel, Criterion]]()
    for id in effects:
        signal, effect = _signal(of, id), effect_in_use(of.entries, of.slot(id), use)
        error = np.column_stack([sensor_rows(names) * responses.scales, effect])
        rows = np.concatenate([1e3 * _detected(of) * error, np.eye(1, len(names) + 1, len(names))])
        listed.append(_criterion(responses.extended(signal), measured, rows, "alias"))
    return Term(tuple(listed))


TERMS = {"naming": naming_term, "alias": alias_term}


def _criterion(
    responses: Responses, measured: Numbers, rows: Float[np.ndarray, "k shared"], combine: Combine
) -> tuple[LinearModel, Criterion]:
    """The model of a search, and a criterion of functionals of its shared coefficients."""
    return one_visit(responses, measured), Criterion(combine, (Part(rows, combine),))


def _detected(of: EffectsOfPlan) -> float:
    """Standard deviations of a coefficient from which on an effect is detected with probability `POWER`."""
    odds = round(float(np.log(EFFECT_TEST_WEIGHT / len(of.ids))), 6)
    return float(np.sqrt(noncentrality(1, odds, 100, True)))


def _signal(of: EffectsOfPlan, id: str) -> Float[np.ndarray, "cells 3 1"]:
    """White signal of an effect of size 1 in its unit, every coefficient of this size."""
    slot = of.slot(id)
    if slot.links[0].looks_back:
        raise InputError(f"{id}: depends on the position before; positions cannot be chosen for it, only ordered")
    return of.signals(slot) @ of.unit_steps(slot)[:, None]


def _nearest(of: EffectsOfPlan, model: LinearModel, id: str) -> list[Slot]:
    """The effects that resemble one most on all cells."""
    own, count = of.slot(id), 3 * len(model.columns)
    nominal = [model.columns.reshape(count, -1), np.linalg.cholesky(model.information).T]
    basis = np.linalg.qr(np.concatenate(nominal))[0][:count]

    def shown(signals: Float[np.ndarray, "cells 3 columns"]) -> Float[np.ndarray, "rows columns"]:
        """What the nominal model leaves of signals."""
        white = signals.reshape(count, -1)
        return white - basis @ (basis.T @ white)

    signal = shown(_signal(of, id))
    if np.linalg.norm(signal) <= VISIBLE * np.linalg.norm(_signal(of, id)):
        raise InputError(f"{id}: no positions of this head show it; allow another mounting or a prior")
    others = list[tuple[float, Slot]]()
    for slot in of.model.slots:
        if slot.id != id and not slot.links[0].looks_back and not one_function_at_1_g((own,), (slot,)):
            block = shown(of.signals(slot))
            explained = block @ np.linalg.lstsq(block, signal, rcond=VISIBLE)[0]
            others.append((-float(np.linalg.norm(explained)), slot))
    return [slot for _, slot in sorted(others, key=lambda one: one[0])[:_NEAREST]]

"""Criteria of effects for the search of a plan: sizes that are named, and errors in use by unknown effects.

An effect's coefficient has the standard deviation sd without other causes in the model, and a larger one together with another
effect of a similar signal. It is detected, and separated from the other, if it is so many of these (`detected`, `_SEPARATED`).
Both are covariances of linear models with further columns, so each criterion is the largest of several.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from scipy.special import ndtri

from tumblecal.chain.rig import Rig
from tumblecal.diagnosis.causes.identities import one_function_at_1_g
from tumblecal.diagnosis.findings.limits import noncentrality
from tumblecal.diagnosis.priors import EFFECT_TEST_WEIGHT, POWER, SURE
from tumblecal.effects import Catalogue
from tumblecal.full_model.layout import Slot
from tumblecal.full_model.priors import VISIBLE
from tumblecal.ground.errors import InputError
from tumblecal.ground.showing import brief
from tumblecal.plan.criterion import Combine, Criterion, Part
from tumblecal.plan.exchange import Term
from tumblecal.plan.forecast.alias import effect_in_use, of_use, sensor_rows
from tumblecal.plan.forecast.effects_of_plan import EffectsOfPlan, effects_of_cells
from tumblecal.plan.information import LinearModel, one_visit
from tumblecal.plan.responses import Responses


# Two explanations with equal priors, one of which leaves d^2 of the other's signal: their log odds are d^2/2 with the standard
# deviation d, and with probability `POWER` they must give a probability of `SURE`.
_QUANTILE = float(ndtri(POWER))
_SEPARATED = _QUANTILE + float(np.sqrt(_QUANTILE**2 + 2 * np.log(SURE / (1 - SURE))))
# Number of other effects from which each is separated.
_NEAREST = 4


@dataclass(frozen=True)
class EffectsOfCells:
    """The effects of the catalogue at the cells of a head; effects of time as if the cells were measured in their order.

    `measured`: cells that are measured already. `minutes`: duration of the plan.
    """

    __repr__ = brief

    rig: Rig
    responses: Responses
    measured: Int[np.ndarray, " measured"]
    entries: Catalogue
    minutes: float

    @cached_property
    def effects(self) -> EffectsOfPlan:
        """At all cells, one after another."""
        return effects_of_cells(self.rig, self.responses.cells, self.entries, 60.0 * self.minutes)

    def slot(self, id: str) -> Slot:
        """The first link of an effect.

        **Raises:** `InputError` for one that no choice of positions can aim at.
        """
        found = self.effects.slot(id)
        if found.links[0].looks_back:
            raise InputError(f"{id}: depends on the position before; positions cannot be chosen for it, only ordered")
        return found

    def signal(self, id: str) -> Float[np.ndarray, "cells 3 1"]:
        """White signal of an effect of size 1 in its unit, every coefficient of this size."""
        slot = self.slot(id)
        return self.effects.signals(slot) @ self.effects.unit_steps(slot)[:, None]

    @property
    def detected(self) -> float:
        """Standard deviations of a coefficient from which on an effect is detected with probability `POWER`."""
        odds = round(float(np.log(EFFECT_TEST_WEIGHT / len(self.effects.ids))), 6)
        return float(np.sqrt(noncentrality(1, odds, 100, True)))

    def nearest(self, id: str) -> list[Slot]:
        """The effects that resemble one most on all cells.

        **Raises:** `InputError` for an effect that no cells show.
        """
        own, model, count = self.slot(id), one_visit(self.responses, self.measured), 3 * len(self.responses.cells)
        nominal = [model.columns.reshape(count, -1), np.linalg.cholesky(model.information).T]
        basis = np.linalg.qr(np.concatenate(nominal))[0][:count]

        def shown(signals: Float[np.ndarray, "cells 3 columns"]) -> Float[np.ndarray, "rows columns"]:
            """What the nominal model leaves of signals."""
            white = signals.reshape(count, -1)
            return white - basis @ (basis.T @ white)

        signal = shown(self.signal(id))
        if np.linalg.norm(signal) <= VISIBLE * np.linalg.norm(self.signal(id)):
            raise InputError(f"{id}: no positions of this head show it; allow another mounting or a prior")
        others = [slot for slot in self.effects.model.slots if slot.id != id and not slot.links[0].looks_back]
        others, explained = [slot for slot in others if not one_function_at_1_g((own,), (slot,))], list[float]()
        for slot in others:
            block = shown(self.effects.signals(slot))
            explained.append(float(np.linalg.norm(block @ np.linalg.lstsq(block, signal, rcond=VISIBLE)[0])))
        return [others[k] for k in np.argsort(-np.array(explained), kind="stable")[:_NEAREST]]

    def criterion(
        self, columns: Float[np.ndarray, "cells 3 further"], rows: Float[np.ndarray, "k shared"], combine: Combine
    ) -> tuple[LinearModel, Criterion]:
        """The model with further shared coefficients, by their white signals, and a criterion of functionals of all of them."""
        own, further = self.responses, columns.shape[2]
        extended = replace(
            own,
            names=(*own.names, *(f"further_{k}" for k in range(further))),
            scales=np.append(own.scales, np.ones(further)),
            columns=np.concatenate([own.columns, columns * own.sd], axis=2),
            information=np.pad(own.information, (0, further)),
        )
        return one_visit(extended, self.measured), Criterion(combine, (Part(rows, combine),))


def naming_term(of: EffectsOfCells, effects: Mapping[str, float]) -> Term:
    """About the smallest size of some effects that is identified with probability 0.8, relative to the wanted sizes; at 1 every
    effect of its size is.

    **Arguments:** `effects`: wanted sizes by id, in the unit of the entry.

    **Raises:** `InputError` for an effect that no choice of positions shows.
    """
    listed, shared = list[tuple[LinearModel, Criterion]](), len(of.responses.names)
    for id, size in effects.items():
        if not size > 0:
            raise InputError(f"{id}: size {size:g}: a size above 0 is needed")
        own = of.signal(id)
        wanted = [(own, of.detected)]
        wanted += [(np.concatenate([own, of.effects.signals(s)], axis=2), _SEPARATED) for s in of.nearest(id)]
        for columns, needed in wanted:
            row = np.eye(1, shared + columns.shape[2], shared) * needed / size
            listed.append(of.criterion(columns, row, "largest"))
    return Term(tuple(listed))


def alias_term(of: EffectsOfCells, ids: Iterable[str]) -> Term:
    """The largest error in use, mg, of some effects at their detection limits that the calibration does not know.

    **Raises:** `InputError` as `naming_term`.
    """
    names, use, listed = of.responses.names, of_use(of.effects.at.problem.where), list[tuple[LinearModel, Criterion]]()
    sensor = sensor_rows(names) * of.responses.scales
    for id in ids:
        error = np.column_stack([sensor, effect_in_use(of.entries, of.slot(id), use)])
        rows = np.concatenate([1e3 * of.detected * error, np.eye(1, len(names) + 1, len(names))])
        listed.append(of.criterion(of.signal(id), rows, "alias"))
    return Term(tuple(listed))

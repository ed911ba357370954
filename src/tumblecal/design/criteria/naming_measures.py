"""Measures of positions for the search of a plan: sizes of effects that are named, and errors in use by unknown effects.

An effect's coefficient has the standard deviation sd without other causes in the model, and a larger one together with another
effect of a similar signal. It is detected, and separated from the other, if it is so many of these (`_detected`, `_SEPARATED`).
Both are covariances of linear models, so each measure is the largest of several measures of criteria.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import block_diag
from scipy.special import ndtri

from tumblecal.chain import Where
from tumblecal.chain.rig import Rig
from tumblecal.design.criteria.combined_measures import largest_measures
from tumblecal.design.criteria.criterion import Criterion
from tumblecal.design.criteria.measure import Measures, measures
from tumblecal.design.forecast.alias import ATTITUDES, effect_in_use, of_use, sensor_rows
from tumblecal.design.model.one_visit import OneVisit, one_visit
from tumblecal.design.model.responses import Responses
from tumblecal.diagnosis.causes.identities import one_function_at_1_g
from tumblecal.diagnosis.findings.limits import noncentrality
from tumblecal.diagnosis.priors import EFFECT_TEST_WEIGHT, POWER, SURE
from tumblecal.effects import Catalogue
from tumblecal.effects.catalogue import entry
from tumblecal.full_model.full_model import FullModel, model_of
from tumblecal.full_model.layout import Slot
from tumblecal.full_model.priors import VISIBLE
from tumblecal.ground.errors import InputError
from tumblecal.ground.showing import brief
from tumblecal.ground.units import factor


# Two explanations with equal priors, one of which leaves d^2 of the other's signal: their log odds are d^2/2 with the standard
# deviation d, and with probability `POWER` they must give a probability of `SURE`.
_QUANTILE = float(ndtri(POWER))
_SEPARATED = _QUANTILE + float(np.sqrt(_QUANTILE**2 + 2 * np.log(SURE / (1 - SURE))))
# Other effects from which each is separated: the nearest ones on all cells and on each of so many random sets of cells.
_NEAREST, _SETS, _OF_SET = 2, 6, 24


@dataclass(frozen=True)
class Alias:
    """Largest error in use, mg, of an effect that is so many standard deviations (`limit`) of its coefficient, from the
    covariance of the errors in use and, last, of the coefficient."""

    rows: Float[np.ndarray, "k shared"]
    limit: float

    def changed(
        self, covariance: Float[np.ndarray, "k k"], parts: Float[np.ndarray, "3 k cells"], sign: int
    ) -> Float[np.ndarray, " cells"]:
        """Values after the change of the covariance by `sign` times the sum of the outer products of the parts."""
        shared = covariance[:, -1:] + sign * np.einsum("ikc,ic->kc", parts, parts[:, -1])
        return self.limit * np.max(np.abs(shared[:-1]), axis=0) / np.sqrt(np.maximum(shared[-1], 1e-300))

    def of_rows(self, covariance: Float[np.ndarray, "*n k k"]) -> Float[np.ndarray, "*n"]:
        """The value for a covariance of the functionals, or for each of several."""
        shared = covariance[..., -1]
        return self.limit * np.max(np.abs(shared[..., :-1]), axis=-1) / np.sqrt(shared[..., -1])


@dataclass(frozen=True)
class EffectsOfCells:
    """The effects of the catalogue at the cells of a head, for measures; effects of time as if the cells were measured in their
    order."""

    __repr__ = brief

    rig: Rig
    responses: Responses
    keep: Int[np.ndarray, " measured"]
    entries: Catalogue
    minutes: float

    @cached_property
    def model(self) -> OneVisit:
        """The model without effects."""
        return one_visit(self.responses, self.keep)

    @cached_property
    def _full(self) -> tuple[FullModel, Float[np.ndarray, "cells 3 full"]]:
        where = self.where
        model = model_of(self.rig.chain(where), where, self.entries)
        return model, model.evaluate(where, model.start).jacobian

    @cached_property
    def where(self) -> Where:
        """The settings of the cells."""
        where, count = self.responses.cells.where, len(self.responses.cells)
        time_s = np.linspace(0.0, 60.0 * self.minutes, count)
        return replace(where, time_s=time_s, mean_time_s=np.full(count, np.mean(time_s)))

    def slot(self, id: str) -> Slot:
        """The first link of an effect.

        **Raises:** `InputError` for one that no choice of positions can aim at.
        """
        model = self._full[0]
        found = next((slot for slot in model.slots if slot.id == id), None)
        if found is None:
            entry(self.entries, id)
            reason = model.not_testable.get(
                id, "it acts on the data or on the noise, not on the readings of a position"
            )
            raise InputError(f"{id}: a plan cannot be designed for it: {reason}")
        if found.links[0].looks_back:
            raise InputError(f"{id}: depends on the position before; positions cannot be chosen for it, only ordered")
        return found

    def signals(self, slot: Slot) -> Float[np.ndarray, "cells 3 columns"]:
        """Signals of an effect's coefficients, each in its scale, g."""
        return self._full[1][:, :, list(slot.columns)]

    def signal(self, id: str) -> Float[np.ndarray, "cells 3"]:
        """Signal of an effect of size 1 in its unit, every coefficient of this size."""
        slot, unit, effect = self.slot(id), self.entries[id].unit, self.entries[id]
        scales = self._full[0].scales[list(slot.columns)]
        units = dict(zip(slot.all_columns, slot.units, strict=True))
        sizes = [factor(unit, units[k]) if effect.shows(units[k]) else 0.0 for k in slot.columns]
        return self.signals(slot) @ (np.array(sizes) / scales)

    @property
    def detected(self) -> float:
        """Standard deviations of a coefficient from which on an effect is detected with probability `POWER`."""
        ids = {slot.id for slot in self._full[0].slots}
        return float(np.sqrt(noncentrality(1, round(float(np.log(EFFECT_TEST_WEIGHT / len(ids))), 6), 100, True)))

    def nearest(self, id: str) -> list[Slot]:
        """The effects that resemble one most on all cells, and on random sets of them.

        **Raises:** `InputError` for an effect that no cells show.
        """
        own, rng, count = self.slot(id), np.random.default_rng(0), len(self.responses.cells)
        sets = [np.arange(count), *(rng.permutation(count)[:_OF_SET] for _ in range(_SETS))]
        others = [slot for slot in self._full[0].slots if slot.id != id and not slot.links[0].looks_back]
        others = [slot for slot in others if not one_function_at_1_g((own,), (slot,))]
        chosen: dict[str, Slot] = {}
        for number, taken in enumerate(sets):
            rows = [self.model.columns[taken].reshape(3 * len(taken), -1), np.linalg.cholesky(self.model.information).T]
            basis = np.linalg.qr(np.concatenate(rows))[0][: 3 * len(taken)]
            signal = self.signal(id)[taken].ravel() / self.responses.sd
            rest = signal - basis @ (basis.T @ signal)
            if rest @ rest <= (VISIBLE * np.linalg.norm(signal)) ** 2:
                if not number:
                    raise InputError(f"{id}: no positions of this head show it; allow another mounting or a prior")
                continue
            left = [self._left(rest, basis, slot, taken) for slot in others]
            chosen |= {others[k].id: others[k] for k in np.argsort(left)[:_NEAREST]}
        return list(chosen.values())

    def _left(self, rest: np.ndarray, basis: np.ndarray, slot: Slot, taken: np.ndarray) -> float:
        """What another effect leaves of a signal, sum of squares."""
        columns = self.signals(slot)[taken].reshape(3 * len(taken), -1) / self.responses.sd
        beside = columns - basis @ (basis.T @ columns)
        left, singular, _ = np.linalg.svd(beside, full_matrices=False)
        seen = left[:, singular > VISIBLE * max(float(np.linalg.norm(columns)), 1e-300)]
        return float(rest @ rest - np.sum((seen.T @ rest) ** 2))

    def extended(self, columns: Float[np.ndarray, "cells 3 further"]) -> OneVisit:
        """The model with further shared coefficients, by their signals in g."""
        own, further = self.responses, columns.shape[2]
        return one_visit(
            replace(
                own,
                names=(*own.names, *(f"further_{k}" for k in range(further))),
                scales=np.append(own.scales, np.ones(further)),
                columns=np.concatenate([own.columns, columns], axis=2),
                information=np.asarray(block_diag(own.information, np.zeros((further, further)))),
            ),
            self.keep,
        )


def naming_measures(
    rig: Rig,
    responses: Responses,
    keep: Sequence[int] | np.ndarray,
    effects: Mapping[str, float],
    entries: Catalogue,
    minutes: float = 60.0,
) -> Measures:
    """Measures of naming: about the smallest size of the listed effects that is identified with probability 0.8, relative to
    the wanted sizes; at 1 every effect of its size is.

    **Arguments:**

    - `keep`: cells that are measured already, as of `one_visit`.
    - `effects`: wanted sizes by id, in the unit of the entry. `minutes`: duration of the plan, for effects of time.

    **Raises:** `InputError` for an effect that no choice of positions shows.
    """
    of = EffectsOfCells(rig, responses, np.asarray(keep, int), entries, minutes)
    listed: list[tuple[OneVisit, Criterion]] = []
    for id, size in effects.items():
        if not size > 0:
            raise InputError(f"{id}: size {size:g}: a size above 0 is needed")
        own = of.signal(id)[:, :, None]
        wanted = [(own, of.detected)]
        wanted += [(np.concatenate([own, of.signals(slot)], axis=2), _SEPARATED) for slot in of.nearest(id)]
        for columns, needed in wanted:
            extended = of.extended(columns)
            row = np.zeros((1, len(extended.names)))
            row[0, len(responses.names)] = needed / size
            listed.append((extended, Criterion(f"naming {id}", row, "largest")))
    return largest_measures([measures(extended, criterion) for extended, criterion in listed])


def alias_measures(
    rig: Rig,
    responses: Responses,
    keep: Sequence[int] | np.ndarray,
    ids: Iterable[str],
    entries: Catalogue,
    minutes: float = 60.0,
) -> Measures:
    """Measures of alias: the largest error in use, mg, of some effects at their detection limits that the calibration does not
    know; arguments and errors as of `naming_measures`."""
    of = EffectsOfCells(rig, responses, np.asarray(keep, int), entries, minutes)
    sensor, use = 1e3 * sensor_rows(responses.names, ATTITUDES) * responses.scales, of_use(of.where)
    listed: list[tuple[OneVisit, Alias]] = []
    for id in ids:
        extended = of.extended(of.signal(id)[:, :, None])
        rows = np.zeros((len(sensor) + 1, len(extended.names)))
        rows[:-1, : sensor.shape[1]] = sensor
        rows[:-1, len(responses.names)] = 1e3 * effect_in_use(entries, of.slot(id), use)
        rows[-1, len(responses.names)] = 1.0
        listed.append((extended, Alias(rows, of.detected)))
    return largest_measures([measures(extended, criterion) for extended, criterion in listed])

"""Forecast of a diagnosis: which effects a plan will detect, name and identify, from which sizes on, and which it cannot.

The residuals of each size are drawn in the residual space and decided as the diagnosis decides (`decisions`). The same draws
serve all sizes, so rates rise smoothly with the size.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.special import ndtri

from tumblecal.chain.rig import Rig
from tumblecal.diagnosis.findings.limits import noncentrality
from tumblecal.diagnosis.priors import INDISTINGUISHABLE, POWER
from tumblecal.effects import Catalogue
from tumblecal.full_model.full_model import FullModel
from tumblecal.full_model.priors import VISIBLE
from tumblecal.ground.errors import InputError
from tumblecal.plan.cells import cells_of
from tumblecal.plan.forecast.decisions import decisions, detections, identities
from tumblecal.plan.forecast.effects_of_plan import EffectsOfPlan, effects_of_cells, effects_of_plan
from tumblecal.plan.forecast.record import Alias, EffectForecast, Limit, NamingForecast


# Sizes are tried in steps of this factor, up to this norm of the visible signal (sigma).
_STEP, _LARGEST = 1.2, 400.0
# Detection limits are found from draws so far (sigma) below the closed form, which is that much too high; so many of each.
_BELOW, _DRAWS_OF_LIMITS = 0.3, 200
# Draws for each effect of a plan, and of one that is compared.
_DRAWS, _DRAWS_COMPARED = 500, 200
# Cells of a head that stand for all of it.
_MOST_CELLS = 150
_QUANTILE = float(ndtri(POWER))


def forecasts(
    rig: Rig, compared: Sequence[Rig], entries: Catalogue, effects: Mapping[str, float], seed: int = 0
) -> tuple[NamingForecast, list[tuple[tuple[EffectForecast, ...], tuple[str, ...]]]]:
    """Forecast of the diagnosis of a rig's plan by its chain with its priors, the noise known; and of compared plans: the
    effects asked for, and ids of those that the nominal parameters absorb.

    **Arguments:**

    - `rig`, `compared`: of `planned_rig` for a schedule.
    - `effects`: sizes by id, each in the unit of its entry; every coefficient has this size.

    **Raises:** `InputError` for an unknown effect, one that this plan cannot test, or a size that is not above 0.
    """
    of, others = effects_of_plan(rig, entries), list[tuple[tuple[EffectForecast, ...], tuple[str, ...]]]()
    predicted = forecast_of(of, effects, seed=seed)
    for each in compared:
        one = effects_of_plan(each, entries, of.model)
        named = forecasts_of_effects(one, effects, _DRAWS_COMPARED, seed)
        others.append((named, tuple(id for id in one.ids if not detectable(one, id))))
    return replace(predicted, hidden_on_head=hidden_on_head(rig, predicted.undetectable, entries, of.model)), others


def forecast_of(
    of: EffectsOfPlan, effects: Mapping[str, float], *, draws: int = _DRAWS, seed: int = 0
) -> NamingForecast:
    """The forecast of a plan's effects, whatever its head can show."""
    for id, size in effects.items():
        of.slot(id)
        if not size > 0:
            raise InputError(f"{id}: size {size:g}: a size above 0 is needed")
    limits = {id: detection_limit(of, id, min(draws, _DRAWS_OF_LIMITS), seed) for id in of.ids}
    usual = {id: of.entries[id].typical for id, limit in limits.items() if limit is None}
    listed = {id: Limit(limit, of.entries[id].unit) for id, limit in limits.items()}
    alias, of_undetectable = (
        max(
            (
                Alias(id, size, of.entries[id].unit, size * float(np.max(np.abs(of.error_in_use(id)))))
                for id, size in sizes
            ),
            key=lambda alias: alias.error_g,
            default=None,
        )
        for sizes in ([(id, limit) for id, limit in limits.items() if limit is not None], usual.items())
    )
    named = forecasts_of_effects(of, effects, draws, seed, limits)
    return NamingForecast(named, listed, tuple(usual), alias, of_undetectable, draws, dict(of.model.not_testable))


def hidden_on_head(rig: Rig, ids: Sequence[str], entries: Catalogue, like: FullModel | None = None) -> tuple[str, ...]:
    """Those of some effects that no positions on a rig's head show, by many of its cells; `like`: the model of a plan."""
    if rig.ability is None or not ids:
        return ()
    cells = cells_of(rig.ability)
    if len(cells) > _MOST_CELLS:
        cells = cells.chosen(np.sort(np.random.default_rng(0).permutation(len(cells))[:_MOST_CELLS]))
    seconds = rig.ability.times.dwell_s * len(cells)
    every = effects_of_cells(rig, cells, {id: entries[id] for id in ids}, seconds, like)
    return tuple(id for id in every.ids if every.visible(id) <= VISIBLE)


def detectable(of: EffectsOfPlan, id: str) -> bool:
    """Whether the nominal parameters leave a visible part of an effect's signal."""
    return bool(len(of.causes(id))) and of.visible(id) > VISIBLE


def detection_limit(of: EffectsOfPlan, id: str, draws: int, seed: int) -> float | None:
    """Size in the effect's unit that is detected with probability 0.8; None for an undetectable one.

    The closed form of the diagnosis counts the effect's signal alone, and others that resemble it lower the limit. The root of
    the test statistic follows the norm of the signal with a standard deviation of one: draws at one norm give the limit.
    """
    if not detectable(of, id):
        return None
    own, shown = of.causes(id), of.shown(id)
    norm = float(np.linalg.norm(shown))
    odds = round(float(of.pool.test_log_weights[own].max()) - max(of.threshold, -2.0), 6)
    alone = float(np.sqrt(noncentrality(int(of.pool.ranks[own[0]]), odds, of.pool.dof, True))) - _BELOW
    found = detections(of, _noise(of, draws, seed) + alone / norm * shown)
    return (alone - _normal_quantile(float(np.mean(found)), draws) + _QUANTILE) / norm


def forecasts_of_effects(
    of: EffectsOfPlan,
    effects: Mapping[str, float],
    draws: int,
    seed: int,
    limits: Mapping[str, float | None] | None = None,
) -> tuple[EffectForecast, ...]:
    """Forecast for some effects of sizes in their units; `limits`: about where each is detected, None for undetectable ones."""
    listed, noise = list[EffectForecast](), _noise(of, draws, seed)
    for id, size in effects.items():
        limit = detection_limit(of, id, 1, seed) if limits is None else limits[id]
        rates, least, same, inseparable = (
            Rates(of, id, noise),
            list[float | None](),
            tuple[str, ...](),
            tuple[str, ...](),
        )
        if limit is not None:
            same = tuple(dict.fromkeys(of.pool.labels[k] for k in identities(of, int(of.causes(id)[0]))))
            least = [rates.smallest(number, limit) for number in range(3)]
            inseparable = tuple(label for label in not_separated(of, id, max(size, limit)) if label not in (id, *same))
        detected, named, identified = rates(size)
        detection_limit_of, smallest_named, smallest_identified = least or [None] * 3
        listed.append(
            EffectForecast(
                id=id,
                unit=of.entries[id].unit,
                size=size,
                visible_fraction=of.visible(id),
                detected=detected,
                named=named,
                identified=identified,
                detection_limit=detection_limit_of,
                smallest_named=smallest_named,
                smallest_identified=smallest_identified,
                identical=same,
                not_separated=inseparable,
            )
        )
    return tuple(listed)


def not_separated(of: EffectsOfPlan, id: str, size: float) -> tuple[str, ...]:
    """Effects that make the signal of one of a size to within what the diagnosis takes for indistinguishable; itself too."""
    signal, found = size * of.shown(id), dict[str, None]()
    for k in of.pool.effects.tolist():
        rest = signal - of.block(k) @ (signal @ of.block(k))
        if rest @ rest < INDISTINGUISHABLE**2:
            found[of.pool.labels[k]] = None
    return tuple(found)


class Rates:
    """Shares of draws that are detected, named and identified, by the size of an effect in its unit."""

    def __init__(self, of: EffectsOfPlan, id: str, noise: Float[np.ndarray, "draws nu"]):
        self._of, self._id, self._noise, self._shares = of, id, noise, dict[float, list[float]]()

    def __call__(self, size: float) -> list[float]:
        """The shares at a size."""
        if size not in self._shares:
            decided = decisions(self._of, self._id, self._noise + size * self._of.shown(self._id))
            self._shares[size] = np.mean(decided, axis=1).tolist()
        return self._shares[size]

    def smallest(self, number: int, start: float) -> float | None:
        """The smallest size with a share of at least `POWER`, in steps from `start` on and interpolated; None if no size that
        shows by up to `_LARGEST` has it."""
        largest, size = _LARGEST / float(np.linalg.norm(self._of.shown(self._id))), start
        while self(size)[number] < POWER:
            size *= _STEP
            if size > largest:
                return None
        while self(size / _STEP)[number] >= POWER:
            size /= _STEP
        low, high = (_normal_quantile(self(own)[number], len(self._noise)) for own in (size / _STEP, size))
        share = (_QUANTILE - low) / max(high - low, 1e-9)
        return size * _STEP ** (min(max(share, 0.0), 1.0) - 1.0)


def _noise(of: EffectsOfPlan, draws: int, seed: int) -> Float[np.ndarray, "draws nu"]:
    """White noise in the residual space, the same for all effects of a plan."""
    return np.random.default_rng(seed).standard_normal((draws, of.pool.dof))


def _normal_quantile(share: float, draws: int) -> float:
    """Standard normal quantile of the probability of what happened in a share of some draws."""
    return float(ndtri((share * draws + 0.5) / (draws + 1)))

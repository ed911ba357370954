"""What cannot be said: the smallest effects that these data would show, and what invisible ones could do."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from scipy import special

from tumblecal.diagnosis.evidence import log_evidence
from tumblecal.diagnosis.screening.screen import Screened
from tumblecal.diagnosis.tuning import POWER, VISIBLE
from tumblecal.effects import Catalogue
from tumblecal.ground.units import factor


@dataclass(frozen=True)
class DetectionLimit:
    """Smallest size of each coefficient alone that is found with 80 % probability; None: not visible by itself."""

    coefficients: dict[str, float | None]
    unit: str
    visible_fraction: float


@dataclass(frozen=True)
class Invisible:
    """An effect, or a direction of one, that the nominal parameters absorb.

    `harm`: for an effect of size `size` in `unit`, the shift of each nominal parameter, with its share in sd.
    """

    direction: dict[str, float]
    size: float
    unit: str
    absorbed_by: tuple[str, ...]
    harm: dict[str, dict[str, Any]]


def limits(screened: Screened, entries: Catalogue, sigma: float) -> dict[str, DetectionLimit]:
    """Detection limits of all visible effects, at 80 % power and the test's family-wise size.

    **Arguments:**

    - `sigma`: noise in units of the white rows.
    """
    detection, scales = screened.detection, screened.at.model.scales.tolist()
    pool = screened.pool
    weights = {pool.labels[k]: float(pool.test_log_weights[k]) for k in pool.effects.tolist()}
    threshold = max(detection.threshold, -2.0)
    listed: dict[str, DetectionLimit] = {}
    for visible in screened.pool.seen:
        rank, slot = visible.block.shape[1], visible.slot
        if not rank or slot.id in listed or slot.id not in weights:
            continue
        odds = round(weights[slot.id] - threshold, 6)
        norm = math.sqrt(_noncentrality(rank, odds, detection.dof, screened.problem.known)) * sigma
        unit = entries[slot.id].unit
        projected, wholes = visible.projected.tolist(), visible.whole.tolist()
        shares = [own / max(whole, 1e-300) for own, whole in zip(projected, wholes, strict=True)]
        sizes = {
            name: norm / own * scales[column] / factor(unit, base) if share > VISIBLE and norm < np.inf else None
            for name, column, base, own, share in zip(
                slot.names, slot.columns, slot.units, projected, shares, strict=False
            )
        }
        listed[slot.id] = DetectionLimit(sizes, unit, max(shares))
    return listed


# No effect that is looked for explains more (sigma^2).
_MOST_EXPLAINED = 1e4


@lru_cache(maxsize=4096)
def _noncentrality(rank: int, odds: float, dof: int, known: bool) -> float:
    """Squared norm (in sigma) at which one effect of this rank passes the threshold with 80 % probability; infinite where so
    few degrees of freedom are left that none does.

    `odds`: logarithm of the effect's weight in the test less the test's threshold.
    """

    def excess(explained: float) -> float:
        total = np.array(dof - rank + explained)
        with_it = log_evidence(total, [(np.array(explained), rank)], dof, known)
        return float(with_it - log_evidence(total, [], dof, known)) + odds

    if excess(_MOST_EXPLAINED) <= 0.0:
        return float("inf")
    needed = _root(excess, 0.0, _MOST_EXPLAINED)

    def missing(size: float) -> float:
        if known:
            return 1.0 - float(special.chndtr(needed, rank, size)) - POWER
        return 1.0 - float(special.ncfdtr(rank, dof - rank, size, needed / rank)) - POWER

    return _root(missing, 1e-3, 4 * needed + 50)


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    from scipy import optimize  # a third of a second, which a study does without

    return float(optimize.brentq(function, low, high))  # type: ignore[arg-type]


def invisible(screened: Screened, entries: Catalogue, sigma: float) -> dict[str, Invisible]:
    """Effects (or directions of them) that the nominal model absorbs, and the harm they could do unseen."""
    at, model = screened.at, screened.at.model
    names, units, scales = model.names, model.units, model.scales
    inverse = np.linalg.pinv(at.jacobian[:, : model.nominal], rcond=1e-9)
    sd = np.sqrt(np.sum(inverse**2, axis=1)) * sigma
    asked = ~model.layout.of_positions
    listed: dict[str, Invisible] = {}
    for visible in screened.pool.seen:
        slot, hidden = visible.slot, visible.absorbed_most(at.jacobian)
        if hidden is None or slot.id in listed:
            continue
        direction, effect = hidden
        unit, typical, largest = entries[slot.id].unit, entries[slot.id].typical, np.max(np.abs(direction))
        in_base = typical * factor(unit, slot.units[0])
        shift = inverse @ effect * (in_base / scales[slot.columns[0]] / largest)
        in_sd, shifts = shift / sd, (shift * scales[: model.nominal]).tolist()
        ratio = np.where(asked, np.abs(in_sd), -1.0)
        order = np.argsort(-ratio)[: int(np.sum(ratio > 0.1 * np.max(ratio)))].tolist()
        harm = {names[k]: {"shift": shifts[k], "unit": units[k], "in_sd": float(in_sd[k])} for k in order}
        listed[slot.id] = Invisible(
            direction={
                name: value
                for name, value in zip(slot.names, (direction / largest).tolist(), strict=False)
                if abs(value) > 0.05
            },
            size=typical,
            unit=unit,
            absorbed_by=tuple(names[k] for k in order),
            harm=harm,
        )
    return listed

"""What cannot be said: the smallest effects that these data would show, and what invisible ones could do."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import optimize, stats

from tumblecal.chain.units import factor
from tumblecal.diagnosis.candidates import VISIBLE, Visibility
from tumblecal.diagnosis.detect import Detection
from tumblecal.diagnosis.evidence import log_evidence
from tumblecal.diagnosis.linear import Linear
from tumblecal.diagnosis.model import Model
from tumblecal.effects import Catalogue


POWER = 0.8


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
    harm: dict[str, dict[str, float]]


def limits(
    model: Model,
    seen: list[Visibility],
    entries: Catalogue,
    detection: Detection,
    log_weights: dict[str, float],
    known: bool,
    sigma: float,
) -> dict[str, DetectionLimit]:
    """Detection limits of all visible effects, at 80 % power and the test's family-wise size."""
    found = {}
    for one in seen:
        if not one.block.shape[1] or one.slot.id in found:
            continue
        rank, weight = one.block.shape[1], log_weights[one.slot.id]
        threshold = max(detection.threshold, -2.0)
        norm = np.sqrt(_noncentrality(rank, round(weight - threshold, 6), detection.dof, known)) * sigma
        unit = entries[one.slot.id].unit
        share = one.projected / np.maximum(one.whole, 1e-300)
        sizes = {
            name: (
                float(norm / one.projected[k] * model.scales[column] / factor(unit, one.slot.units[k]))
                if share[k] > VISIBLE
                else None
            )
            for k, (name, column) in enumerate(zip(one.slot.names, one.slot.columns, strict=False))
        }
        found[one.slot.id] = DetectionLimit(sizes, unit, float(np.max(share)))
    return found


@lru_cache(maxsize=4096)
def _noncentrality(rank: int, odds: float, dof: int, known: bool) -> float:
    """Squared norm (in sigma) at which one effect of this rank passes the threshold with 80 % probability.

    `odds`: logarithm of the effect's weight in the test less the test's threshold.
    """

    def excess(explained: float) -> float:
        total = np.array(dof - rank + explained)
        with_it = log_evidence(total, [(np.array(explained), rank)], dof, known)
        return float(with_it - log_evidence(total, [], dof, known)) + odds

    needed = _root(excess, 0.0, 1e4)

    def missing(size: float) -> float:
        if known:
            return float(stats.ncx2.sf(needed, rank, size)) - POWER
        return float(stats.ncf.sf(needed / rank, rank, dof - rank, size)) - POWER

    return _root(missing, 1e-3, 4 * needed + 50)


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    return float(optimize.brentq(function, low, high))  # type: ignore[arg-type]


def invisible(
    model: Model, linear: Linear, seen: list[Visibility], entries: Catalogue, sigma: float
) -> dict[str, Invisible]:
    """Effects (or directions of them) that the nominal model absorbs, and the harm they could do unseen."""
    jacobian = linear.jacobian[:, : model.nominal]
    inverse = np.linalg.pinv(jacobian, rcond=1e-9)
    sd = np.sqrt(np.sum(inverse**2, axis=1)) * sigma
    found = {}
    for one in seen:
        hidden = _hidden_direction(linear, one)
        if hidden is None or one.slot.id in found:
            continue
        direction, effect = hidden
        unit, typical = entries[one.slot.id].unit, entries[one.slot.id].typical
        in_base = typical * factor(unit, one.slot.units[0])
        scale = in_base / model.scales[one.slot.columns[0]] / np.max(np.abs(direction))
        shift = inverse @ effect * scale
        ratio = np.abs(shift) / sd
        order = [k for k in np.argsort(-ratio) if ratio[k] > 0.1 * np.max(ratio)]
        harm = {
            model.names[k]: {
                "shift": float(shift[k] * model.scales[k]),
                "unit": model.units[k],  # type: ignore[dict-item]
                "in_sd": float(shift[k] / sd[k]),
            }
            for k in order
        }
        found[one.slot.id] = Invisible(
            direction={
                name: float(value / np.max(np.abs(direction)))
                for name, value in zip(one.slot.names, direction, strict=False)
                if abs(value) > 0.05 * np.max(np.abs(direction))
            },
            size=typical,
            unit=unit,
            absorbed_by=tuple(model.names[k] for k in order),
            harm=harm,
        )
    return found


def _hidden_direction(linear: Linear, one: Visibility) -> tuple[np.ndarray, np.ndarray] | None:
    """The coefficients' direction that is absorbed most, and its signal; None when every direction is visible."""
    if not one.hidden.shape[1]:
        return None
    signals = linear.jacobian[:, list(one.slot.columns)] @ one.hidden
    most = int(np.argmax(np.linalg.norm(signals, axis=0)))
    # Its sign is free: the largest coefficient is positive.
    sign = np.sign(one.hidden[np.argmax(np.abs(one.hidden[:, most])), most])
    return one.hidden[:, most] * sign, signals[:, most] * sign

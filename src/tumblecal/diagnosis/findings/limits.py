"""Detection limits of effects, and the influence on the parameters of effects that are not detected."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from pydantic import Field
from scipy import special

from tumblecal.diagnosis.priors import POWER
from tumblecal.diagnosis.refine.insert import directions_of
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.effects import Catalogue
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.identifiability import RANK_TOLERANCE
from tumblecal.full_model.effect_directions import EffectDirections, included_orders
from tumblecal.full_model.evidence import log_evidence
from tumblecal.full_model.layout import Slot
from tumblecal.full_model.priors import VISIBLE
from tumblecal.ground.showing import brief
from tumblecal.ground.units import factor


# So many effects are listed with a parameter.
_MOST_LISTED = 2


@dataclass(frozen=True)
class DetectionLimit:
    """Smallest size of each coefficient alone that is found with 80 % probability; None: not visible by itself."""

    coefficients: Annotated[dict[str, float | None], Field(serialization_alias="limits")]
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
    pool, seen, known = screened.pool, screened.seen, screened.problem.known
    weights = {pool.labels[k]: float(pool.test_log_weights[k]) for k in pool.effects.tolist()}
    threshold = max(detection.threshold, -2.0)
    listed: dict[str, DetectionLimit] = {}
    for slot, rank, (projected, wholes) in zip(seen.slots, seen.ranks.tolist(), seen.sizes, strict=True):
        if not rank or slot.id in listed or slot.id not in weights:
            continue
        odds = round(weights[slot.id] - threshold, 6)
        norm = math.sqrt(noncentrality(rank, odds, detection.dof, known)) * sigma
        entry = entries[slot.id]
        unit = entry.unit
        shares = [size / max(whole, 1e-300) for size, whole in zip(projected, wholes, strict=True)]
        sizes = {
            name: norm / size * scales[column] / factor(unit, base) if share > VISIBLE and norm < math.inf else None
            for name, column, base, size, share in zip(
                slot.names, slot.columns, slot.units, projected, shares, strict=False
            )
            if entry.shows(base)
        }
        listed[slot.id] = DetectionLimit(sizes, unit, max(shares))
    return listed


# No effect that is looked for explains more (sigma^2).
_MOST_EXPLAINED = 1e4
# From 1e4 to rounding.
_ROUNDS = 10


@lru_cache(maxsize=4096)
def noncentrality(rank: int, odds: float, dof: int, known: bool) -> float:
    """Squared norm (in sigma) at which one effect of this rank passes the threshold with 80 % probability; infinite where so
    few degrees of freedom remain that none does.

    `odds`: logarithm of the effect's weight in the test less the test's threshold.
    """

    def excess(explained: Float[np.ndarray, " sizes"]) -> Float[np.ndarray, " sizes"]:
        total = dof - rank + explained
        return log_evidence(total, [(explained, rank)], dof, known) - log_evidence(total, [], dof, known) + odds

    if excess(np.array([_MOST_EXPLAINED]))[0] <= 0.0:
        return math.inf
    needed = _root(excess, 0.0, _MOST_EXPLAINED)

    def missing(size: Float[np.ndarray, " sizes"]) -> Float[np.ndarray, " sizes"]:
        if known:
            return 1.0 - special.chndtr(needed, rank, size) - POWER
        return 1.0 - special.ncfdtr(rank, dof - rank, size, needed / rank) - POWER

    return _root(missing, 1e-3, 4 * needed + 50)


def _root(
    function: Callable[[Float[np.ndarray, " sizes"]], Float[np.ndarray, " sizes"]], low: float, high: float
) -> float:
    """Zero of an increasing function of arrays between two bounds: the interval with the zero is divided by 32 in each round.
    `scipy.optimize` has it too, but takes a quarter of a second to import."""
    for _ in range(_ROUNDS):
        grid = np.linspace(low, high, 33)
        above = int(np.argmax(function(grid) > 0.0))
        low, high = grid[max(above - 1, 0)], grid[above]
    return 0.5 * float(low + high)


def invisible(screened: Screened, entries: Catalogue, sigma: float) -> dict[str, Invisible]:
    """Effects (or directions of them) that the nominal model absorbs, and the harm they could do unseen."""
    at, model, seen = screened.at, screened.at.model, screened.seen
    inverse = np.linalg.pinv(at.jacobian[:, : model.nominal], rcond=1e-9)
    sd = np.sqrt(np.sum(inverse**2, axis=1)) * sigma
    hidden: dict[str, tuple[Slot, list[float], np.ndarray]] = {}
    for visible in map(seen.of, seen.absorbed.tolist()):
        if (slot := visible.slot).id not in hidden:
            direction, effect = visible.absorbed_most(at.jacobian)
            entry, largest = entries[slot.id], np.max(np.abs(direction))
            of_scale = entry.typical * factor(entry.unit, slot.units[0]) / model.scales[slot.columns[0]] / largest
            hidden[slot.id] = slot, (direction / largest).tolist(), effect * of_scale
    effects = np.array([effect for _, _, effect in hidden.values()]).reshape(-1, len(at.jacobian))
    moved = effects @ inverse.T
    in_sd, shifts = moved / sd, (moved * model.scales[: model.nominal]).tolist()
    ratio = np.where(model.layout.of_positions, -1.0, np.abs(in_sd))
    order, counts = np.argsort(-ratio, axis=1), np.sum(ratio > 0.1 * np.max(ratio, axis=1, keepdims=True), axis=1)
    listed: dict[str, Invisible] = {}
    for row, (id, (slot, direction, _)) in enumerate(hidden.items()):
        names = {k: model.names[k] for k in order[row, : counts[row]].tolist()}
        listed[id] = Invisible(
            direction={name: share for name, share in zip(slot.names, direction, strict=False) if abs(share) > 0.05},
            size=entries[id].typical,
            unit=entries[id].unit,
            absorbed_by=tuple(names.values()),
            harm={
                name: {"shift": shifts[row][k], "unit": model.units[k], "in_sd": float(in_sd[row, k])}
                for k, name in names.items()
            },
        )
    return listed


@dataclass(frozen=True)
class Unseen:
    """Standard deviation of a parameter in `unit`: `sd` if the extended model is correct; `sd_with_unseen`, its root mean
    square error if further effects may be present; `effects`: those with the largest contributions."""

    sd: float
    sd_with_unseen: float
    unit: str
    effects: tuple[str, ...]


class UndetectedShifts(NamedTuple):
    """Shifts of the nominal parameters (in their scales) by undetected effects: `moved` by each of their directions of typical
    size; `second`: mean products of the coefficients, given the data; `numbers`: whose each direction is among `ids`."""

    __repr__ = brief

    moved: Float[np.ndarray, "nominal directions"]
    second: Float[np.ndarray, "directions directions"]
    numbers: Int[np.ndarray, " directions"]
    ids: tuple[str, ...]

    @property
    def covariance(self) -> Float[np.ndarray, "nominal nominal"]:
        """Mean square of the shifts, about the parameters as they are."""
        return self.moved @ self.second @ self.moved.T


def undetected_shifts(
    screened: Screened, directions: EffectDirections, extended: Fit, sigma: float
) -> UndetectedShifts:
    """The shifts by every visible effect that is not in the explanation.

    Its coefficient is drawn from a normal distribution of the catalogue's typical size about zero. Given the data, the mean
    square error of the parameters is then that of the extended model plus the contribution of the conditional mean and
    covariance of the coefficients (Gaussian linear model with random effects; Rasmussen and Williams, Gaussian Processes for
    Machine Learning, 2.7). Their undetectable part is in `invisible`.

    **Arguments:**

    - `directions`: of the effects to consider. `sigma`: noise in units of the white rows.
    """
    at, fitted = screened.at, extended.jacobian / sigma
    members = [cause.slot for cause in screened.members]
    present = {*(slot.id for slot in members), *included_orders(at.model.slots, members)}
    directions = directions.only(directions.shown & ~directions.of(present))
    signals = at.varying @ directions.steps.T / sigma
    # Excluded positions contribute nothing.
    signals[~fitted.any(axis=1)] = 0.0
    # The fit's first columns are these directions of the full vector.
    free = directions_of(at, screened.members)
    moved = free[: at.model.nominal] @ (np.linalg.pinv(fitted, rcond=RANK_TOLERANCE)[: free.shape[1]] @ signals)
    residual = signals - extended.column_space @ (extended.column_space.T @ signals)
    # In typical sizes the coefficients' prior is the unit matrix.
    covariance = np.linalg.inv(np.eye(residual.shape[1]) + residual.T @ residual)
    mean = covariance @ (residual.T @ (extended.rows / sigma))
    return UndetectedShifts(moved, covariance + np.outer(mean, mean), directions.numbers, directions.ids)


def unseen(screened: Screened, directions: EffectDirections, extended: Fit, sigma: float) -> dict[str, Unseen]:
    """For each nominal parameter (without those of one position each), its uncertainty including undetected effects, by
    `undetected_shifts`; `sigma`: noise in units of the white rows."""
    shifts, model = undetected_shifts(screened, directions, extended, sigma), screened.at.model
    of_effect = shifts.numbers[:, None] == np.arange(len(shifts.ids))
    by_effect = shifts.moved**2 @ (np.diag(shifts.second)[:, None] * of_effect)
    most = np.argsort(-by_effect, axis=1)[:, :_MOST_LISTED].tolist()
    sd = extended.sd[: model.nominal]
    wider = np.hypot(sd, model.scales[: model.nominal] * np.sqrt(np.diag(shifts.covariance)))
    return {
        name: Unseen(float(sd[k]), float(wider[k]), model.units[k], tuple([shifts.ids[number] for number in most[k]]))
        for k, name in enumerate(model.names)
        if not model.layout.of_positions[k]
    }

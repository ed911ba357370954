"""Detection limits of effects, and the influence on the parameters of effects that are not detected."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Any

import numpy as np
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
from tumblecal.full_model.priors import VISIBLE
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
        entry, odds = entries[slot.id], round(weights[slot.id] - threshold, 6)
        norm = math.sqrt(noncentrality(rank, odds, detection.dof, known)) * sigma
        shares, sizes = [size / max(whole, 1e-300) for size, whole in zip(projected, wholes, strict=True)], {}
        each = zip(slot.names, slot.columns, slot.units, projected, shares, strict=False)
        for name, column, base, size, share in each:
            if entry.shows(base):
                visible = share > VISIBLE and norm < math.inf
                sizes[name] = norm / size * scales[column] / factor(entry.unit, base) if visible else None
        listed[slot.id] = DetectionLimit(sizes, entry.unit, max(shares))
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
    low, high = 0.0, _MOST_EXPLAINED
    # The interval with the zero is divided by 32 in each round; `scipy.optimize` takes a quarter of a second to import.
    for _ in range(_ROUNDS):
        grid = np.linspace(low, high, 33)
        total = dof - rank + grid
        with_it = log_evidence(total, [(grid, rank)], dof, known)
        passes = with_it - log_evidence(total, [], dof, known) + odds > 0.0
        if not passes[-1]:
            return math.inf
        above = int(np.argmax(passes))
        low, high = grid[max(above - 1, 0)], grid[above]
    needed = 0.5 * float(low + high)
    if known:
        return float(special.chndtrinc(needed, rank, 1.0 - POWER))
    return float(special.ncfdtrinc(rank, dof - rank, 1.0 - POWER, needed / rank))


def invisible(screened: Screened, entries: Catalogue, sigma: float) -> dict[str, Invisible]:
    """Effects (or directions of them) that the nominal model absorbs, and the harm they could do unseen."""
    at, model, seen, listed = screened.at, screened.at.model, screened.seen, dict[str, Invisible]()
    inverse = np.linalg.pinv(at.jacobian[:, : model.nominal], rcond=1e-9)
    sd = np.sqrt(np.sum(inverse**2, axis=1)) * sigma
    for visible in map(seen.of, seen.absorbed.tolist()):
        slot, entry = visible.slot, entries[visible.slot.id]
        if slot.id in listed:
            continue
        direction, effect = visible.absorbed_most(at.jacobian)
        largest = np.max(np.abs(direction))
        of_scale = entry.typical * factor(entry.unit, slot.units[0]) / model.scales[slot.columns[0]] / largest
        moved = inverse @ (effect * of_scale)
        in_sd, shifts = moved / sd, moved * model.scales[: model.nominal]
        ratio = np.where(model.layout.of_positions, -1.0, np.abs(in_sd))
        harmed = [k for k in np.argsort(-ratio).tolist() if ratio[k] > 0.1 * np.max(ratio)]
        shares = zip(slot.names, (direction / largest).tolist(), strict=False)
        listed[slot.id] = Invisible(
            direction={name: share for name, share in shares if abs(share) > 0.05},
            size=entry.typical,
            unit=entry.unit,
            absorbed_by=tuple([model.names[k] for k in harmed]),
            harm={
                model.names[k]: {"shift": float(shifts[k]), "unit": model.units[k], "in_sd": float(in_sd[k])}
                for k in harmed
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


def unseen(screened: Screened, directions: EffectDirections, extended: Fit, sigma: float) -> dict[str, Unseen]:
    """For each nominal parameter (without those of one position each), its uncertainty including every visible effect that is
    not in the explanation.

    The coefficient of such an effect is drawn from a normal distribution of the catalogue's typical size about zero. Given the
    data, the mean square error of the parameters is then that of the extended model plus the contribution of the conditional
    mean and covariance of the coefficients (Gaussian linear model with random effects; Rasmussen and Williams, Gaussian
    Processes for Machine Learning, 2.7). Their undetectable part is in `invisible`.

    **Arguments:**

    - `directions`: of the effects to consider. `sigma`: noise in units of the white rows.
    """
    at, model, fitted = screened.at, screened.at.model, extended.jacobian / sigma
    members = [cause.slot for cause in screened.members]
    present = {*(slot.id for slot in members), *included_orders(model.slots, members)}
    directions = directions.only(directions.shown & ~directions.of(present))
    signals = at.varying @ directions.steps.T / sigma
    # Excluded positions contribute nothing.
    signals[~fitted.any(axis=1)] = 0.0
    # The fit's first columns are these directions of the full vector.
    free = directions_of(at, screened.members)
    moved = free[: model.nominal] @ (np.linalg.pinv(fitted, rcond=RANK_TOLERANCE)[: free.shape[1]] @ signals)
    residual = signals - extended.column_space @ (extended.column_space.T @ signals)
    # In typical sizes the coefficients' prior is the unit matrix.
    covariance = np.linalg.inv(np.eye(residual.shape[1]) + residual.T @ residual)
    mean = covariance @ (residual.T @ (extended.rows / sigma))
    second = covariance + np.outer(mean, mean)
    by_effect = moved**2 @ (np.diag(second)[:, None] * (directions.numbers[:, None] == np.arange(len(directions.ids))))
    most = np.argsort(-by_effect, axis=1)[:, :_MOST_LISTED].tolist()
    sd = extended.sd[: model.nominal]
    wider = np.hypot(sd, model.scales[: model.nominal] * np.sqrt(np.sum(moved @ second * moved, axis=1)))
    return {
        name: Unseen(float(sd[k]), float(wider[k]), model.units[k], tuple([directions.ids[own] for own in most[k]]))
        for k, name in enumerate(model.names)
        if not model.layout.of_positions[k]
    }

"""Angles of chosen positions between the grid of a head, by the gradient of the criterion (white noise)."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.chain.rig import Rig
from tumblecal.design.criteria.criterion import Criterion
from tumblecal.design.criteria.weighted import Weighted
from tumblecal.design.model.cells import Cells
from tumblecal.design.model.planned_rig import planned_rig
from tumblecal.design.model.responses import Responses
from tumblecal.design.model.schedule import Schedule, continued
from tumblecal.design.positions.relaxation import POWER
from tumblecal.estimation.problem import Problem
from tumblecal.estimation.visits import with_repeatability
from tumblecal.ground.errors import InputError
from tumblecal.planning.continuous_angles import optimise_plan


# Angles are rounded to this many decimals of a degree.
_DECIMALS = 2


def continuous_cells(
    rig: Rig,
    responses: Responses,
    ability: HeadAbility,
    criterion: Criterion | Weighted,
    taken: Int[np.ndarray, " positions"],
    *,
    after: Schedule | None = None,
    steps: int = 100,
) -> Cells:
    """Positions with the spindle angles, and the pitch settings, that reduce the criterion most, as far as the head sets
    any angle; mountings, temperatures, order and the number of pitch settings stay.

    **Arguments:** `taken`: cells of the responses, in measuring order. `after`: positions that are measured already; they stay.

    **Raises:** `InputError` for a head that sets only the listed angles.
    """
    if not (ability.alpha_continuous or ability.beta_continuous):
        raise InputError(f"{rig.source}: [head]: neither alpha_continuous nor beta_continuous is true")
    cells = responses.cells.chosen(taken)
    measured = 0 if after is None else len(after)
    names = tuple(str(number + 1) for number in range(measured + len(taken)))
    planned = planned_rig(rig, responses, continued(responses.cells, after, taken, ability.times), ability, names)
    where = planned.where
    chain = planned.chain(where)
    spread = ability.repeatability if planned.ability is None else planned.ability.repeatability
    problem = Problem.from_arrays(
        chain,
        where,
        np.asarray(chain(where)),
        noise_sd=responses.sd,
        priors=with_repeatability(planned.priors, spread, chain, where),
    )
    rows = criterion.rows / responses.scales
    limits = ability.beta_deg if ability.beta_continuous else None
    moved = optimise_plan(
        problem,
        parameters=responses.names,
        criterion=lambda covariance: _log(criterion, jnp.asarray(rows) @ covariance @ rows.T),
        beta_deg=None if limits is None else (min(limits), max(limits)),
        move_alpha=ability.alpha_continuous,
        fixed=np.arange(len(where.alpha)) < measured,
        steps=steps,
    ).where
    alpha, beta = (np.round(np.degrees(np.asarray(angle)[measured:]), _DECIMALS) for angle in (moved.alpha, moved.beta))
    return replace(
        cells,
        alpha_deg=np.mod(alpha, 360.0) if ability.alpha_continuous else cells.alpha_deg,
        beta_deg=beta if ability.beta_continuous else cells.beta_deg,
    )


def _log(criterion: Criterion | Weighted, of_rows: Float[Array, "k k"]) -> Float[Array, ""]:
    """Logarithm of the criterion, the largest variance as a power mean."""
    if isinstance(criterion, Weighted):
        total = jnp.zeros(())
        for one, at, share in criterion.parts:
            total += share * jnp.exp(_log(one, of_rows[at, at]))
        return jnp.log(total)
    if criterion.combine == "volume":
        return jnp.linalg.slogdet(of_rows)[1] / (2 * len(criterion.rows))
    variances, power = jnp.diag(of_rows), 1.0 if criterion.combine == "mean" else POWER
    largest = jnp.max(variances)
    return jnp.log(largest) / 2 + jnp.log(jnp.mean((variances / largest) ** power)) / (2 * power)

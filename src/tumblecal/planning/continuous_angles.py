"""The angles of a plan by the gradient of its uncertainties."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from tumblecal.chain import Where
from tumblecal.estimation.problem import Problem
from tumblecal.estimation.programs import compiler_options
from tumblecal.ground.errors import InputError
from tumblecal.ground.showing import brief


# Of the covariance of the parameters (free, free), base units, to a number that is to be small.
Criterion = Callable[[Float[Array, "free free"]], Float[Array, ""]]


@dataclass(frozen=True)
class OptimisedPlan:
    """A plan with optimised angles: settings, standard deviations (free,) of the parameters before and after, and steps.

    Examples:
        >>> import numpy as np
        >>> from tumblecal import Problem
        >>> from tumblecal.chain import nominal_chain, settings
        >>> from tumblecal.planning import OptimisedPlan, optimise_plan
        >>> where = settings(np.tile(np.arange(8) * np.pi / 4, 3), np.repeat([0.0, 0.5, 1.0], 8))
        >>> plan = optimise_plan(Problem.from_arrays(nominal_chain(where), where, np.zeros((24, 3)), noise_sd=1e-4), steps=5)
        >>> isinstance(plan, OptimisedPlan), plan.where.alpha.shape, plan.sd_after.shape
        (True, (24,), (15,))
    """

    __repr__ = brief

    where: Where
    names: tuple[str, ...]
    sd_before: Float[np.ndarray, " free"]
    sd_after: Float[np.ndarray, " free"]
    steps: int


def optimise_plan(
    problem: Problem,
    *,
    parameters: Sequence[str] | None = None,
    criterion: Criterion | None = None,
    beta_deg: tuple[float, float] | None = (-90.0, 90.0),
    move_alpha: bool = True,
    fixed: Bool[np.ndarray, " positions"] | None = None,
    steps: int = 200,
) -> OptimisedPlan:
    """Move the spindle angle of each position and the angle of each pitch setting to the least uncertainty (L-BFGS-B).

    The number of positions, the pitch settings to which they belong, and their order stay. The derivatives are exact.

    **Arguments:**

    - `problem`: chain at the expected parameters, plan to start from, stated noise, priors.
    - `parameters`: names of those that matter; if omitted, all but the pitch errors dbeta. `criterion`: of the covariance of
      these; the logarithm of its determinant (D) if omitted.
    - `beta_deg`: range of the pitch angles; None: they stay. `move_alpha`: whether the spindle angles may change. `fixed`:
      positions that stay, with their pitch settings. `steps`: largest number of iterations.

    **Raises:** `InputError` for an unknown parameter, or noise that is not stated.

    Examples:
        >>> import numpy as np
        >>> from tumblecal import Problem
        >>> from tumblecal.chain import nominal_chain, settings
        >>> from tumblecal.planning import optimise_plan
        >>> where = settings(np.tile(np.arange(8) * np.pi / 4, 3), np.repeat([0.0, 0.5, 1.0], 8))
        >>> problem = Problem.from_arrays(nominal_chain(where), where, np.zeros((24, 3)), noise_sd=1e-4)
        >>> better = optimise_plan(problem)
        >>> bool(better.sd_after[0] < 0.5 * better.sd_before[0])  # dK_x
        True
    """
    if not problem.known:
        raise InputError("the noise is unknown: an optimal plan needs a problem with a stated noise")
    chain, where, bare = problem.chain, problem.where, problem.bare
    wanted = _indices(chain.names, parameters)
    setting, count = np.asarray(where.index("pitch")), len(where.alpha)
    criterion = (lambda covariance: jnp.linalg.slogdet(covariance)[1]) if criterion is None else criterion
    scales, vector = jnp.asarray(chain.scales), jnp.asarray(chain.vector)

    def moved(angles: Array) -> Where:
        return replace(where, alpha=angles[:count], beta=angles[count:][setting])

    def covariance(angles: Array) -> Array:
        at = replace(bare, where=moved(angles))
        jacobian = jax.jacfwd(lambda scaled: at.residual(scaled * scales))(vector / scales)
        return jnp.linalg.inv(jacobian.T @ jacobian)

    def cost(angles: Array) -> Array:
        return criterion(covariance(angles)[jnp.ix_(wanted, wanted)] * jnp.outer(scales[wanted], scales[wanted]))

    from scipy.optimize import minimize

    value_and_slope = jax.jit(jax.value_and_grad(cost), compiler_options=compiler_options())
    begin = np.concatenate(
        [np.asarray(where.alpha), [np.asarray(where.beta)[setting == k][0] for k in np.unique(setting)]]
    )
    lowest, highest = begin.copy(), begin.copy()
    if move_alpha:
        lowest[:count], highest[:count] = -np.inf, np.inf
    if beta_deg is not None:
        lowest[count:], highest[count:] = np.radians(beta_deg)
    if fixed is not None:
        stays = np.concatenate([fixed, np.isin(np.unique(setting), setting[fixed])])
        lowest[stays], highest[stays] = begin[stays], begin[stays]
    found = minimize(
        lambda angles: tuple(np.asarray(part, float) for part in value_and_slope(angles)),
        np.clip(begin, lowest, highest),
        jac=True,
        method="L-BFGS-B",
        bounds=np.column_stack([lowest, highest]),
        options={"maxiter": steps},
    )
    spread = [np.sqrt(np.diag(np.asarray(covariance(jnp.asarray(own))))) * chain.scales for own in (begin, found.x)]
    best = moved(found.x)
    best = replace(best, alpha=np.mod(np.asarray(best.alpha), 2 * np.pi), beta=np.asarray(best.beta))
    return OptimisedPlan(best, chain.names, spread[0], spread[1], int(found.nit))


def _indices(names: tuple[str, ...], parameters: Sequence[str] | None) -> np.ndarray:
    """Indices of the parameters that matter.

    **Raises:** `InputError` for an unknown one.
    """
    if parameters is None:
        sensor = [k for k, name in enumerate(names) if not name.startswith("dbeta")]
        return np.array(sensor, int)
    for name in parameters:
        if name not in names:
            raise InputError(f"no parameter {name!r}; there are {', '.join(names)}")
    return np.array([names.index(name) for name in parameters], int)

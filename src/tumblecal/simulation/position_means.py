"""Simulated position means: the chain's readings plus white noise, by an explicit key."""

import jax
import numpy as np
from jaxtyping import Array, Float

from tumblecal.chain import Chain, Where
from tumblecal.chain.rig import Rig
from tumblecal.data import PositionSet
from tumblecal.estimation.programs import compiler_options
from tumblecal.estimation.slow_noise import slow_noise_of
from tumblecal.ground.errors import InputError
from tumblecal.simulation.experiment import square_root


def position_means(
    chain: Chain, where: Where, noise_sd: float | Float[Array, "positions 3"], key: Array
) -> Float[Array, "positions 3"]:
    """Readings of one run through a plan.

    **Arguments:**

    - `chain`, `where`: the instrument and the positions.
    - `noise_sd`: sd of a position mean, g.
    - `key`: a JAX random key.

    **Returns:** readings, g.
    """
    return _with_noise(chain(where), noise_sd, key)


def _with_noise(readings: Array, noise_sd: float | Float[Array, "positions 3"], key: Array) -> Array:
    return readings + noise_sd * jax.random.normal(key, readings.shape)


def simulated(rig: Rig, seed: int, noise_sd: float | None = None) -> PositionSet:
    """A position set of a rig at its true values.

    **Arguments:**

    - `rig`: plan, links, truth, noise.
    - `seed`: of the noise; the same seed gives the same bits.
    - `noise_sd`: takes precedence over that of the rig, g.

    **Raises:** `InputError` if neither states the noise.

    Examples:
        >>> import tumblecal
        >>> data = tumblecal.simulate(tumblecal.read_rig("paper24"), seed=1)
        >>> len(data), data.comments["noise_sd_g"]
        (24, '0.00015')
    """
    noise_sd = rig.noise_sd_g if noise_sd is None else noise_sd
    if noise_sd is None:
        raise InputError(f'{rig.source}: noise.sd is missing; add [noise] sd = "0.1 mg" or give --noise-sd')
    where, plan = rig.where, rig.plan
    # The chain as one program: a first simulation would compile its hundred steps one by one.
    exact = jax.jit(Chain.__call__, compiler_options=compiler_options())(rig.true_chain(where), where)
    key = jax.random.key(seed)
    readings = _with_noise(exact, noise_sd, key)
    if rig.ability is not None and rig.ability.slow_noise.any:
        if plan.time_s is None:
            raise InputError(
                f"{rig.source}: [head.noise] needs the times of the positions; add plan.interval_s, or time_s"
            )
        slow = slow_noise_of(rig.ability, where)
        assert slow is not None
        root = np.stack([square_root(part) for part in slow])
        readings += np.einsum("apq,qa->pa", root, jax.random.normal(jax.random.fold_in(key, 1), readings.shape))
    return PositionSet(
        names=plan.names,
        alpha_deg=np.asarray(plan.alpha_deg, float),
        beta_deg=np.asarray(plan.beta_deg, float),
        readings=np.asarray(readings),
        run=plan.runs if len(set(plan.runs)) > 1 else None,
        mount=plan.mounts if set(plan.mounts) != {"1"} else None,
        time_s=None if plan.time_s is None else np.asarray(plan.time_s),
        temperature_degc=None if plan.temperature_degc is None else np.asarray(plan.temperature_degc),
        approach=None if plan.approach is None else np.asarray(plan.approach),
        comments={"simulated_from": rig.source, "seed": str(seed), "noise_sd_g": repr(float(noise_sd))},
        source=rig.source,
    )

"""Samplers that a user gives: of true parameters and of noise."""

from collections.abc import Callable
from typing import TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from tumblecal.ground.errors import InputError


# Draws one vector of parameters (free,), base units, or the noise of one set of readings (positions, 3), g, from a key.
Sampler: TypeAlias = Callable[[Array], Array]


def draws(sampler: Sampler, key: Array, lanes: int) -> Float[Array, "*shape lanes"]:
    """One draw for each lane."""
    return jax.vmap(lambda one: jnp.asarray(sampler(one)), out_axes=-1)(jax.random.split(key, lanes))


def check_sampler(sampler: Sampler | None, shape: tuple[int, ...], name: str) -> None:
    """Reject a sampler that returns another shape, or other numbers for the same key: compiled, it would draw once."""
    if sampler is None:
        return
    first, second = (np.asarray(sampler(jax.random.key(0))) for _ in range(2))
    if first.shape != shape:
        raise InputError(f"{name}: the sampler returns an array of the shape {first.shape}, not {shape}")
    if not np.array_equal(first, second, equal_nan=True):
        raise InputError(
            f"{name}: the sampler returns different arrays for the same key; draw with jax.random from its key"
        )

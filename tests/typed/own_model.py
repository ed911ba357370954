"""A user's script: a forward model of one's own."""

from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np

import tumblecal
from tumblecal import PositionSet
from tumblecal.chain import Unknown, Where, forward_chain


tumblecal.enable_float64()


def circle(p: Mapping[str, jax.Array], where: Where) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Readings on a circle."""
    angle = where.alpha + p["zero"]
    return jnp.cos(angle), (1 + p["scale"]) * jnp.sin(angle), p["offset"] + 0.0 * angle


chain = forward_chain(circle, {"zero": Unknown(unit="rad"), "scale": Unknown(), "offset": Unknown(unit="g")})
alpha = np.arange(24) * 15.0
readings = np.column_stack([np.cos(np.radians(alpha)), np.sin(np.radians(alpha)), np.zeros(24)])
noise = 1e-4 * np.random.default_rng(0).normal(size=readings.shape)
data = PositionSet.from_arrays(readings + noise, alpha, np.zeros(24), unit="deg", sd=1e-4)
print(tumblecal.diagnose(data, chain=chain).verdict)

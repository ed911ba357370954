"""Terms of the readings whose signals are given by columns, not by settings: direction and rate of the temperature, time."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from tumblecal.chain import Link, Parameter, Place
from tumblecal.chain.link import State
from tumblecal.chain.where import Where


class GivenSignals(Link):
    """Readings plus a sum of coefficients times given signals, one coefficient for each signal."""

    place: ClassVar[Place] = Place.READING
    size: Parameter
    signals: Float[Array | np.ndarray, "signals positions 3"]

    def __call__(self, state: State, where: Where) -> State:
        """The state with the signals added to the readings."""
        added = sum(size * signal for size, signal in zip(self.size.at(where), self.signals, strict=True))
        reading = tuple(value + jnp.asarray(added)[:, axis] for axis, value in enumerate(state.reading))
        return eqx.tree_at(lambda s: s.reading, state, reading)

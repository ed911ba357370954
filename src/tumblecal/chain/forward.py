"""A user's own model of the readings as a link: a pure function of parameters and settings."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from tumblecal.chain.chain import Chain
from tumblecal.chain.frames import Vector
from tumblecal.chain.link import Link, Place, State
from tumblecal.chain.parameter import Parameter, coefficients
from tumblecal.chain.where import Where


class Unknown(NamedTuple):
    """A parameter of a user's model: start value and typical size in `unit` (a base unit: rad, g, 1, s).

    Examples:
        >>> from tumblecal.chain import Unknown
        >>> Unknown(0.2, "rad").scale
        0.001
    """

    value: float = 0.0
    unit: str = "1"
    scale: float = 1e-3


# Parameters by name, each (positions,) or a number, and the settings, to the three readings (positions,).
Model = Callable[[Mapping[str, Array], Where], Vector]


class Forward(Link):
    """The readings by a function in place of gravity, head and sensor.

    Effects of the catalogue on an index act on its angles, those of the sensor on its readings as on inputs.

    Examples:
        >>> from tumblecal.chain import Forward, Unknown, forward_chain
        >>> chain = forward_chain(lambda p, where: (where.alpha, p["y"], p["y"]), {"y": Unknown()})
        >>> isinstance(chain.links[0], Forward)
        True
    """

    place: ClassVar[Place] = Place.OUTPUT
    leaves: tuple[Parameter, ...]
    function: Model = eqx.field(static=True)

    def __call__(self, state: State, where: Where) -> State:
        """The state with these readings, which are the ideal inputs too."""
        # Effects on the angles act before: the function sees the true angles.
        there = replace(where, alpha=state.alpha, beta=state.beta)
        reading = self.function({leaf.name: jnp.asarray(leaf.at(where)[0]) for leaf in self.leaves}, there)
        return State(state.alpha, state.beta, reading, reading)


def forward_chain(function: Model, unknowns: Mapping[str, Unknown]) -> Chain:
    """A chain that predicts the readings by a function of its own.

    **Arguments:**

    - `function`: from the parameters by name and the settings to three arrays (positions,); pure, written with `jax.numpy`, for
      each position by itself.
    - `unknowns`: the parameters.

    **Returns:** the chain; `Problem.from_arrays`, `fit`, `fit_many` and `diagnose` take it like any other. No set-up errors are
    looked for, because these are found by comparison with gravity.

    Examples:
        >>> import jax.numpy as jnp
        >>> from tumblecal.chain import Unknown, forward_chain, settings
        >>> def circle(p, where):
        ...     angle = where.alpha + p["zero"]
        ...     return jnp.cos(angle), jnp.sin(angle), p["offset"] + 0.0 * angle
        >>> chain = forward_chain(circle, {"zero": Unknown(unit="rad"), "offset": Unknown(unit="g")})
        >>> chain.names, chain(settings([0.0, 1.0], [0.0, 0.0])).shape
        (('zero', 'offset'), (2, 3))
    """
    leaves = []
    for name, (value, unit, scale) in unknowns.items():
        leaf = coefficients(name, unit=unit, scale=scale)
        leaves.append(replace(leaf, value=leaf.value + value))
    return Chain((Forward(tuple(leaves), function),))

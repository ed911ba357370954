"""Links of the chain, and the state that they transform."""

import enum
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from tumblecal.chain.frames import Vector
from tumblecal.chain.where import Where


class Place(enum.IntEnum):
    """Places along the chain, from the ground to the reading. `chain + link` puts a link after the last of its place.

    Examples:
        >>> from tumblecal.chain import Place
        >>> Place.MOUNT < Place.TRIAD < Place.OUTPUT
        True
    """

    GRAVITY = 10
    BASE = 20
    PITCH_SCALE = 25
    PITCH = 30
    HEAD = 40
    INDEX = 50
    WOBBLE = 60
    SPINDLE = 70
    FIXTURE = 80
    MOUNT = 90
    TRIAD = 100
    OUTPUT = 110
    READING = 120


class State(eqx.Module):
    """The state along the chain, for all positions at once.

    `alpha`, `beta`: true angles, rad. `f`: specific force in the current frame, g; after the triad it is u, the ideal input
    along each sensitive axis. `reading`: output of the instrument, g.

    Examples:
        >>> from tumblecal.chain import nominal_chain, settings
        >>> where = settings([0.0], [0.0])
        >>> [round(float(component[0]), 6) for component in nominal_chain(where).state(where).f]
        [0.0, 0.0, 1.0]
    """

    alpha: Float[Array, " positions"]
    beta: Float[Array, " positions"]
    f: Vector
    reading: Vector


def start(where: Where) -> State:
    """The state at the ground: gravity's reaction (0, 0, 1) g in the local level frame, commanded angles."""
    alpha, beta = jnp.asarray(where.alpha), jnp.asarray(where.beta)
    nothing = jnp.zeros_like(alpha)
    return State(alpha, beta, (nothing, nothing, jnp.ones_like(alpha)), (nothing, nothing, nothing))


class Link(eqx.Module):
    """One step of the chain; final subclasses have `Parameter` leaves and convert one state to the next.

    Examples:
        >>> import equinox as eqx
        >>> from tumblecal.chain import Link, Parameter, Place, coefficients, nominal_chain, settings
        >>> class ConstantOnX(Link):
        ...     place = Place.READING
        ...     size: Parameter
        ...
        ...     def __call__(self, state, where):
        ...         x, y, z = state.reading
        ...         return eqx.tree_at(lambda s: s.reading, state, (x + self.size.at(where)[0], y, z))
        >>> where = settings([0.0], [0.0])
        >>> chain = nominal_chain(where) + ConstantOnX(coefficients("constant", unit="g"))
        >>> float(chain.named({"constant": 0.002})(where)[0, 0])
        0.002
    """

    place: ClassVar[Place]
    # Whether it needs `Where.inputs_before`.
    looks_back: ClassVar[bool] = False

    def __call__(self, state: State, where: Where) -> State:
        """The state after this link."""
        raise NotImplementedError


def turned(state: State, f: Vector) -> State:
    """`state` with its specific force in the next frame."""
    return State(state.alpha, state.beta, f, state.reading)

"""Effects of the readout that no small coefficient describes: range, steps, dead zone. They can be simulated.

The diagnosis finds them as what they look like (`found_as`): beside that, in data of a few dozen positions, they cannot
be told.
"""

from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp

from tumblecal.chain import Link, Parameter, Place, State, Where, coefficients
from tumblecal.effects.effect import OF_RESOLUTION, Effect
from tumblecal.ground.axes import AXES


class Readout(Link):
    """`A_axis` becomes `output(A_axis, size)`; nothing changes while the size is zero."""

    place: ClassVar[Place] = Place.READING
    size: Parameter
    axis: int = eqx.field(static=True)
    output: Callable[[Any, Any], Any] = eqx.field(static=True)

    def __call__(self, state: State, where: Where) -> State:
        (size,) = self.size.at(where)
        positive_size = jnp.where(size > 0, size, 1.0)
        put_out = jnp.where(size > 0, self.output(state.reading[self.axis], positive_size), state.reading[self.axis])
        reading = tuple(put_out if k == self.axis else value for k, value in enumerate(state.reading))
        return eqx.tree_at(lambda s: s.reading, state, reading)


def _clipped(value, per_range):
    return jnp.clip(value, -1.0 / per_range, 1.0 / per_range)


def _stepped(value, step):
    return step * jnp.round(value / step)


def _dead(value, width):
    return jnp.sign(value) * jnp.maximum(jnp.abs(value) - width, 0.0)


def _axis_entries(own: int, axis: str) -> tuple[Effect, ...]:
    def made(id: str, base: str, output: Callable[[Any, Any], Any]) -> Callable[[Where], tuple[Link, ...]]:
        return lambda where: (Readout(coefficients(id, unit=base, scale=1e-3), own, output),)

    source = "IEEE 1293 (dynamic range, resolution, dead band)"
    return (
        Effect(
            f"clipping.{axis}",
            "A kept within +-1/K",
            "1/g",
            1.0,
            f"The {axis} axis ends at its range: larger readings all look alike.",
            "Choose a larger range; leave out the positions at the end of the range.",
            source,
            made(f"clipping.{axis}", "1/g", _clipped),
            not_held=OF_RESOLUTION,
            found_as=f"itself, or refused, where several readings end at one value; else third_order.{axis} or positions off",
        ),
        Effect(
            f"quantisation.{axis}",
            "A rounded to steps of q",
            "mg",
            0.5,
            f"The readings of the {axis} axis come in steps larger than the noise.",
            "Log more digits, average with the noise let in, or choose a smaller range.",
            source,
            made(f"quantisation.{axis}", "g", _stepped),
            not_held=OF_RESOLUTION,
            found_as="noise larger than stated",
        ),
        Effect(
            f"dead_zone.{axis}",
            "A nearer to zero by w, zero within +-w",
            "mg",
            0.2,
            f"The {axis} axis does not answer to inputs close to zero.",
            "Measure a few positions close to zero input; look for a dead zone in the converter.",
            source,
            made(f"dead_zone.{axis}", "g", _dead),
            not_held=OF_RESOLUTION,
            found_as=f"bias_asymmetry.{axis}",
        ),
    )


ENTRIES = tuple(entry for own, axis in enumerate(AXES) for entry in _axis_entries(own, axis))

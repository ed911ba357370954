"""Effects of the readout that no small coefficient describes: range, steps, dead zone. They can be simulated.

The diagnosis reports them as the effect in `found_as`, from which they are indistinguishable in data of a few dozen positions.
"""

from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp

from tumblecal.chain import Link, Parameter, Place, State, Where, coefficients
from tumblecal.effects.effect import OF_RESOLUTION, Effect
from tumblecal.ground.axes import AXES


class Readout(Link):
    """`A_axis` becomes `output(A_axis, size)`; unchanged for size zero."""

    place: ClassVar[Place] = Place.READING
    size: Parameter
    axis: int = eqx.field(static=True)
    output: Callable[[Any, Any], Any] = eqx.field(static=True)

    def __call__(self, state: State, where: Where) -> State:
        (size,) = self.size.at(where)
        positive_size = jnp.where(size > 0, size, 1.0)
        value_out = jnp.where(size > 0, self.output(state.reading[self.axis], positive_size), state.reading[self.axis])
        reading = tuple(value_out if k == self.axis else value for k, value in enumerate(state.reading))
        return eqx.tree_at(lambda s: s.reading, state, reading)


def _clipped(value, per_range):
    return jnp.clip(value, -1.0 / per_range, 1.0 / per_range)


def _stepped(value, step):
    return step * jnp.round(value / step)


def _dead(value, width):
    return jnp.sign(value) * jnp.maximum(jnp.abs(value) - width, 0.0)


def _axis_entries(number: int, axis: str) -> tuple[Effect, ...]:
    def made(id: str, base: str, output: Callable[[Any, Any], Any]) -> Callable[[Where], tuple[Link, ...]]:
        return lambda where: (Readout(coefficients(id, unit=base, scale=1e-3), number, output),)

    source = "IEEE 1293 (dynamic range, resolution, dead band)"
    return (
        Effect(
            f"clipping.{axis}",
            "A limited to +-1/K",
            "1/g",
            1.0,
            f"The {axis} axis saturates at the end of its range: larger readings are all equal.",
            "Choose a larger range; remove the positions at the end of the range.",
            source,
            made(f"clipping.{axis}", "1/g", _clipped),
            not_held=OF_RESOLUTION,
            found_as=f"itself or an error, if several readings are equal; otherwise third_order.{axis} or outlier positions",
        ),
        Effect(
            f"quantisation.{axis}",
            "A rounded to steps of q",
            "mg",
            0.5,
            f"The resolution of the {axis} axis is coarser than the noise.",
            "Log more digits, average samples without prior filtering of the noise, or choose a smaller range.",
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
            f"The {axis} axis does not respond to inputs close to zero.",
            "Measure a few positions close to zero input; look for a dead zone in the converter.",
            source,
            made(f"dead_zone.{axis}", "g", _dead),
            not_held=OF_RESOLUTION,
            found_as=f"bias_asymmetry.{axis}",
        ),
    )


ENTRIES = tuple(entry for number, axis in enumerate(AXES) for entry in _axis_entries(number, axis))

"""The link of what dies away in time: warm-up after switching on, settling after a change of setting."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from tumblecal.chain import Link, Parameter, Place, State, Where, coefficients
from tumblecal.ground.axes import AXES


class Decay(Link):
    """`A += amplitude * exp(-t / tau)` per axis with one tau; `since` says from when t counts, s."""

    place: ClassVar[Place] = Place.READING
    amplitude: Parameter
    tau: Parameter
    since: Callable[[Where], Any] = eqx.field(static=True)

    def __call__(self, state: State, where: Where) -> State:
        decay = jnp.exp(-self.since(where) / self.tau.at(where)[0])
        reading = tuple(
            value + amplitude * decay for value, amplitude in zip(state.reading, self.amplitude.at(where), strict=True)
        )
        return eqx.tree_at(lambda s: s.reading, state, reading)


def decays(id: str, since: Callable[[Where], Any], first_taus: Sequence[float]) -> tuple[Link, ...]:
    """A link for each time constant (s) that is tried first; coefficients named after `id`."""
    links = []
    for first in first_taus:
        tau = replace(coefficients(f"{id}_tau", unit="s", scale=first), value=np.array([[first]]))
        links.append(Decay(coefficients(id, AXES, unit="g", scale=1e-3), tau, since))
    return tuple(links)

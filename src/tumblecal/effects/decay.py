"""The link of exponential decay in time: warm-up after power-on, settling after a change of setting."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from tumblecal.chain import Link, Parameter, Place, State, Where, coefficients
from tumblecal.effects.effect import of_clocks
from tumblecal.ground.axes import AXES


class Decay(Link):
    """`A += amplitude * exp(-t / tau)` per axis with one tau; `since` gives t, s.

    Each of several clocks has separate amplitudes, because the decay over a pause of unknown length is unknown.
    """

    place: ClassVar[Place] = Place.READING
    amplitude: Parameter
    tau: Parameter
    since: Callable[[Where], Any] = eqx.field(static=True)

    def __call__(self, state: State, where: Where) -> State:
        decay = jnp.exp(-self.since(where) / self.tau.at(where)[0])
        amplitudes = self.amplitude.at(where)
        if len(amplitudes) > len(AXES):
            shares = [jnp.where(clock, 1.0, 0.0) for clock in of_clocks(where)]
            amplitudes = [
                sum(share * amplitude for share, amplitude in zip(shares, amplitudes[axis :: len(AXES)], strict=True))
                for axis in range(len(AXES))
            ]
        reading = tuple(value + amplitude * decay for value, amplitude in zip(state.reading, amplitudes, strict=True))
        return eqx.tree_at(lambda s: s.reading, state, reading)


def decays(id: str, since: Callable[[Where], Any], first_taus: Sequence[float], *, clocks: int = 1) -> tuple[Link, ...]:
    """A link for each start value of the time constant (s); the coefficients, also those of later `clocks`, are named
    after `id`."""
    links = []
    names = [*AXES, *(f"{axis}_after_pause_{number}" for number in range(1, clocks) for axis in AXES)]
    for first in first_taus:
        tau = replace(coefficients(f"{id}_tau", unit="s", scale=first), value=np.array([[first]]))
        links.append(Decay(coefficients(id, names, unit="g", scale=1e-3), tau, since))
    return tuple(links)

"""Linear drift in time, also over pauses of unknown length.

If the times are from several clocks, the lengths of the pauses between them are unknown. The change over each pause is then a
separate coefficient: `rate * t + change`, with t since the first position by the same clock. The rate does not depend on the
length of a pause.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from tumblecal.chain import Link, Parameter, Place, State, Where, coefficients
from tumblecal.chain.frames import Vector
from tumblecal.effects.added_terms import base_unit, output_effect
from tumblecal.effects.effect import Effect, elapsed, of_clocks
from tumblecal.ground.axes import AXES


# Factor of a drifting coefficient: a function of the ideal inputs u.
Factor = Callable[[Vector], Any]
# Length of a pause for the typical size of a change, s.
_TYPICAL_PAUSE_S = 3600.0


def changes(id: str, components: Sequence[str], *, unit: str, scale: float, where: Where) -> Parameter:
    """The changes of drifting coefficients from the first clock to each later one, one clock after the other.

    **Arguments:**

    - `components`: names of the coefficients. `unit`, `scale`: of their rates, base units.
    """
    names = [[f"pause_{number}", name] for number in range(1, where.clocks) for name in components]
    # `g/s` becomes `g`, `1/s` becomes `1`.
    of_change = unit.removesuffix("/s")
    return coefficients(
        f"{id}_after",
        ["_".join(filter(None, parts)) for parts in names],
        unit=of_change,
        scale=scale * _TYPICAL_PAUSE_S,
    )


def changed(values: Sequence[Any], amounts: int, where: Where) -> list[Any]:
    """For each drifting coefficient, its change from the first clock to the clock of every position; zero for the first
    clock."""
    later = of_clocks(where)[1:]
    return [
        sum(jnp.where(here, values[number * amounts + k], 0.0) for number, here in enumerate(later))
        for k in range(amounts)
    ]


class OutputDrift(Link):
    """`A_axis += sum of (rate * t + change) * factor(u)`, t since the first position by the same clock."""

    place: ClassVar[Place] = Place.READING
    rate: Parameter
    change: Parameter
    axis: int = eqx.field(static=True)
    factors: tuple[Factor, ...] = eqx.field(static=True)

    def __call__(self, state: State, where: Where) -> State:
        time, rates = elapsed(where), self.rate.at(where)
        since_first = changed(self.change.at(where), len(rates), where)
        added = sum(
            (rate * time + change) * factor(state.f)
            for rate, change, factor in zip(rates, since_first, self.factors, strict=True)
        )
        reading = tuple(value + added if k == self.axis else value for k, value in enumerate(state.reading))
        return eqx.tree_at(lambda s: s.reading, state, reading)


def drift_effect(id: str, axis: str, factors: Sequence[Factor], *, unit: str, typical: float, **stated: Any) -> Effect:
    """An effect on one output whose terms grow linearly in time.

    **Arguments:**

    - `factors`: one function of u for each coefficient, which is multiplied with the time.
    - `unit`: of the rates, such as `mg/h`; `stated`: the rest, as of `output_effect`.
    """
    terms = [lambda u, where, factor=factor: factor(u) * elapsed(where) for factor in factors]
    one_clock = output_effect(id, axis, terms, unit=unit, typical=typical, needs=("time_s",), pauses="any", **stated)
    base, scale = base_unit(unit)

    def make(where: Where) -> tuple[Link, ...]:
        assert one_clock.make is not None
        if where.clocks == 1:
            return one_clock.make(where)
        components, size = tuple(stated.get("components", ("",))), typical * scale
        rate = coefficients(id, components, unit=base, scale=size)
        change = changes(id, components, unit=base, scale=size, where=where)
        return (OutputDrift(rate, change, AXES.index(axis), tuple(factors)),)

    return replace(one_clock, make=make)


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

"""The chain: a tuple of links from the ground to the reading, and its free leaves as one vector."""

import dataclasses
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from tumblecal.chain.link import Link, Place, State, start
from tumblecal.chain.nominal import HAND_HELD, LINKS, NOMINAL, Leaf, Mount, SmallAngleMount, nominal_link
from tumblecal.chain.parameter import Parameter, parameters_of, with_parameters, with_values
from tumblecal.chain.where import Where
from tumblecal.ground.errors import InputError
from tumblecal.ground.precision import require_float64
from tumblecal.ground.showing import Screen, Shown
from tumblecal.ground.temperature_functions import TemperatureFunctions
from tumblecal.ground.units import shown


if TYPE_CHECKING:
    import polars as pl


# The sensor's parameters are listed first, in the paper's order; leaves of other links follow in the order of the chain.
LISTED_FIRST = ("dK", "bias", "dtheta", "gamma", "dbeta")


class Chain(Shown, eqx.Module):
    """A tuple of links; a call gives the readings (positions, 3) in g at the settings of a set of positions.

    `chain + link` is the chain with one more link at the place of that link.

    Examples:
        >>> from tumblecal.chain import nominal_chain, settings
        >>> where = settings(alpha=[0.0, 1.5], beta=[0.0, 0.8])  # rad
        >>> chain = nominal_chain(where).named({"bias_z": 1e-3})
        >>> chain(where).shape, round(float(chain(where)[0, 2]), 6)
        ((2, 3), 1.001)
        >>> chain.names[-2:], chain.units[-2:]
        (('dbeta_0', 'dbeta_1'), ('rad', 'rad'))
    """

    links: tuple[Link, ...]

    def __check_init__(self) -> None:
        require_float64()

    def __call__(self, where: Where) -> Float[Array, "positions 3"]:
        """Predicted readings, g."""
        return jnp.stack(self.state(where).reading, axis=-1)

    def state(self, where: Where) -> State:
        """The state after the last link."""
        if any(link.looks_back for link in self.links):
            # Evaluated separately at the settings of the previous position, so that derivatives of positions stay independent.
            before = where.at_rows(where.earlier("run.mount"))
            inputs = passed(tuple(link for link in self.links if link.place < Place.OUTPUT), before).f
            where = dataclasses.replace(where, inputs_before=inputs)
        return passed(self.links, where)

    @property
    def orientations(self) -> Float[Array | np.ndarray, "mounts 3 3"] | None:
        """The intended orientation of each mounting; None if all are aligned with the head."""
        stated = (link.nominal for link in self.links if isinstance(link, Mount | SmallAngleMount))
        return next((nominal for nominal in stated if nominal is not None), None)

    def __add__(self, link: Link) -> "Chain":
        """The chain with `link` after the last link of the same or an earlier place.

        Examples:
            >>> from tumblecal.chain import nominal_chain, settings
            >>> from tumblecal.effects import catalogue
            >>> where = settings([0.0, 1.5], [0.0, 0.8])
            >>> (link,) = catalogue()["second_order.z"].make(where)
            >>> (nominal_chain(where) + link).names[-1]
            'second_order.z'
        """
        position = sum(1 for other in self.links if other.place <= link.place)
        return Chain((*self.links[:position], link, *self.links[position:]))

    def screen(self) -> Screen:
        """Its links, and every parameter with its value."""
        links = ", ".join(type(link).__name__ for link in self.links)
        rows = [(name, f"{value:.6g}", unit, "yes" if free else "no") for name, value, unit, free in self._listed()]
        return Screen(f"Chain of {links}", ("parameter", "value", "unit", "free"), rows)

    def table(self) -> "pl.DataFrame":
        """All parameters: `parameter`, `value` in `unit` (mrad, mg, 1e-3), and whether it is `free`."""
        import polars as pl

        return pl.DataFrame(self._listed(), schema=["parameter", "value", "unit", "free"], orient="row")

    def _listed(self) -> list[tuple[str, float, str, bool]]:
        listed = []
        # In the order of `vector`; then those that are not estimated.
        for leaf in (*self.free, *(leaf for leaf in self.parameters if not leaf.free)):
            unit, factor = shown(leaf.unit)
            # A traced leaf, or one with a copy of each number for every position, has no single value.
            known = isinstance(leaf.value, np.ndarray | jax.Array) and not isinstance(leaf.value, Tracer)
            values = (
                np.ravel(leaf.value) * factor if known and leaf.value.ndim == 2 else np.full(len(leaf.names), np.nan)
            )
            listed += [(name, float(value), unit, leaf.free) for name, value in zip(leaf.names, values, strict=True)]
        return listed

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """All leaves, in the chain's order."""
        return parameters_of(self)

    @cached_property
    def free(self) -> tuple[Parameter, ...]:
        """The leaves to be estimated, the sensor's first (dK, bias, dtheta, gamma, dbeta, then effects)."""
        rank = {name: number for number, name in enumerate(LISTED_FIRST)}
        leaves = [leaf for leaf in self.parameters if leaf.free]
        return tuple(sorted(leaves, key=lambda leaf: rank.get(leaf.name, len(rank))))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the entries of `vector`."""
        return tuple(name for leaf in self.free for name in leaf.names)

    @cached_property
    def of_positions(self) -> frozenset[str]:
        """Names of the entries that belong to one position each: unknown attitudes, which are nuisance parameters."""
        return frozenset(name for leaf in self.free if leaf.by == "position" for name in leaf.names)

    @cached_property
    def units(self) -> tuple[str, ...]:
        """Units of the entries of `vector`."""
        return tuple(leaf.unit for leaf in self.free for _ in leaf.names)

    @property
    def scales(self) -> Float[np.ndarray, " free"]:
        """Typical sizes of the entries of `vector`."""
        return np.array([leaf.scale for leaf in self.free for _ in leaf.names], float)

    @property
    def vector(self) -> Float[np.ndarray, " free"]:
        """The free leaves as one vector."""
        return np.concatenate([np.zeros(0), *(np.asarray(leaf.value).ravel() for leaf in self.free)])

    def at(self, vector: Float[Array | np.ndarray, " free *positions"]) -> "Chain":
        """The chain with its free leaves taken from `vector`.

        A matrix gives every position a separate copy of each number. The derivatives by the copies of a position are
        its rows of the Jacobian, so that three backward passes give all rows.

        Examples:
            >>> from tumblecal.chain import nominal_chain, settings
            >>> chain = nominal_chain(settings([0.0], [0.0]))
            >>> chain.at(chain.vector + 1e-3).vector.tolist() == [1e-3] * len(chain.names)
            True
        """
        return with_values(self, self.free, vector)

    def named(self, values: dict[str, float]) -> "Chain":
        """The chain with the parameters in `values` (by name, base units) set, free or not.

        **Raises:** `KeyError` for a name that the chain lacks.

        Examples:
            >>> from tumblecal.chain import nominal_chain, settings
            >>> chain = nominal_chain(settings([0.0], [0.0])).named({"gamma_21": 2e-4})
            >>> float(chain.vector[chain.names.index("gamma_21")])
            0.0002
        """
        remaining = dict(values)

        def replaced(leaf: Parameter) -> Parameter:
            numbers = np.array(leaf.value, float).ravel()
            for number, name in enumerate(leaf.names):
                numbers[number] = remaining.pop(name, numbers[number])
            return dataclasses.replace(leaf, value=numbers.reshape(leaf.value.shape))

        chain = with_parameters(self, replaced)
        if remaining:
            names = ", ".join(name for leaf in self.parameters for name in leaf.names)
            raise KeyError(f"the chain has no parameter {', '.join(remaining)}; it has {names}")
        return chain

    def started(self) -> "Chain":
        """With amplitudes of typical size as a start for time constants, which have no influence at amplitude zero."""
        starts = dict[str, float]()
        for link in self.links:
            leaves = Chain((link,)).free
            if any(leaf.unit == "s" for leaf in leaves):
                zero = [leaf for leaf in leaves if leaf.unit != "s" and not np.any(leaf.value)]
                starts |= {name: leaf.scale for leaf in zero for name in leaf.names}
        return self.named(starts) if starts else self

    def fixed(self, names: set[str]) -> "Chain":
        """The chain with the leaves in `names` (leaf names such as `dbeta`) fixed at their values.

        Examples:
            >>> from tumblecal.chain import nominal_chain, settings
            >>> nominal_chain(settings([0.0], [0.0])).fixed({"dtheta", "gamma", "dbeta"}).names
            ('dK_x', 'dK_y', 'dK_z', 'bias_x', 'bias_y', 'bias_z')
        """
        return with_parameters(self, lambda leaf: dataclasses.replace(leaf, free=False) if leaf.name in names else leaf)


def passed(links: tuple[Link, ...], where: Where) -> State:
    """The state after the last of some links, from the ground on."""
    state = start(where)
    for link in links:
        state = link(state, where)
    return state


def hand_held_chain(where: Where, *, temperature: Mapping[str, TemperatureFunctions] | None = None) -> Chain:
    """The model of a set of unknown attitudes: the sensor's nine parameters, and two tilts for each position.

    The angles of head and mount are fixed at zero, because the tilts absorb them.

    **Arguments:**

    - `where`: the positions' settings. `temperature`: the functions of temperature that a leaf of the sensor follows, by name.

    Examples:
        >>> from tumblecal.chain import hand_held_chain, settings
        >>> len(hand_held_chain(settings([0.0, 1.5], [0.0, 0.8])).names)  # 9, and two tilts for each position
        13
    """
    fixed = {"dbeta": Leaf("pitch", free=False), "dtheta": Leaf(free=False)}
    leaves = _following(fixed, HAND_HELD, temperature or {})
    return Chain(tuple(nominal_link(name, where, leaves) for name in HAND_HELD))


def nominal_chain(
    where: Where,
    *,
    dbeta_by: str = "pitch",
    dtheta_by: str | None = None,
    bias_by: str | None = None,
    scale_by: str | None = None,
    mount_nominal: np.ndarray | None = None,
    small_angle: bool = False,
    temperature: Mapping[str, TemperatureFunctions] | None = None,
) -> Chain:
    """The nominal model: 12 + K parameters for K pitch settings.

    **Arguments:**

    - `where`: the positions' settings; they determine the number of dbeta.
    - `dbeta_by`, `dtheta_by`, `bias_by`, `scale_by`: index columns of those leaves; None means shared.
    - `mount_nominal`: intended orientation of each mounting, 3x3 each.
    - `small_angle`: the paper's first-order mount in place of the exact one.
    - `temperature`: the functions of temperature that a leaf follows, by its name.

    **Raises:** `InputError` for an index column, or temperatures, that the data lack, and for a leaf that the model lacks.

    Examples:
        >>> from tumblecal.chain import nominal_chain, settings
        >>> len(nominal_chain(settings([0.0, 1.5, 3.0], [0.0, 0.8, 1.6])).names)  # 12 + 3 pitch settings
        15
    """
    leaves = {"dbeta": Leaf(dbeta_by), "dtheta": Leaf(dtheta_by), "bias": Leaf(bias_by), "dK": Leaf(scale_by)}
    leaves = _following(leaves, NOMINAL, temperature or {})
    names = ("small_angle_mount" if small_angle and name == "mount" else name for name in NOMINAL)
    return Chain(tuple(nominal_link(name, where, leaves, lambda: mount_nominal) for name in names))


def _following(
    leaves: Mapping[str, Leaf], links: Sequence[str], temperature: Mapping[str, TemperatureFunctions]
) -> dict[str, Leaf]:
    """The leaves with those in `temperature` following their functions."""
    usual = {name: leaf.usual for link in links for name, leaf in LINKS[link].leaves.items()}
    if unknown := sorted(set(temperature) - set(usual)):
        raise InputError(
            f"no leaf {', '.join(unknown)} that could follow temperature; the leaves are {', '.join(usual)}"
        )
    chosen = usual | dict(leaves)
    return chosen | {
        name: dataclasses.replace(chosen[name], follows=functions) for name, functions in temperature.items()
    }

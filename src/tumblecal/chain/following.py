"""A leaf that follows temperature: its value at the reference temperature, and its change with the temperature."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from tumblecal.chain.frames import Component
from tumblecal.chain.parameter import Parameter, coefficients
from tumblecal.chain.where import Where
from tumblecal.ground.errors import InputError
from tumblecal.ground.temperature_functions import TemperatureFunctions, function_rows


# End of the name of the change of a leaf: `bias_T` of `bias`.
CHANGE = "_T"


class Following(eqx.Module):
    """A leaf as `p(T) = p(T0) + sum of c_k o_k(T)`, with the orthonormal combinations o_k of its functions.

    - `reference`: the values at the reference temperature T0, with the leaf's own name, groups and components.
    - `change`: the coefficients c_k, shared by all groups: `bias_T_x1`, `bias_T_y1`, `bias_T_z1`, `bias_T_x2`, ...
    - `reference_degc`, `range_degc`, `knots_degc`, `combination`: numbers of the functions; arrays, so that compiled programs
      serve every range. `order`: of the polynomial.

    Examples:
        >>> import numpy as np
        >>> from tumblecal.chain import nominal_chain, settings
        >>> from tumblecal.ground.temperature_functions import TemperatureFunctions
        >>> linear = TemperatureFunctions(1, reference_degc=25.0, range_degc=(0.0, 50.0))
        >>> where = settings([0.0, 0.0], [0.0, 0.0], temperature_degc=[25.0, 45.0])
        >>> chain = nominal_chain(where, temperature={"bias": linear})
        >>> chain.names[-3:]
        ('bias_T_x1', 'bias_T_y1', 'bias_T_z1')
        >>> per_degc = linear.of_coefficients(np.array([1e-4]))[0]  # 0.1 mg/degC
        >>> chain.named({"bias_T_x1": per_degc})(where)[:, 0].round(6).tolist()
        [0.0, 0.002]
    """

    reference: Parameter
    change: Parameter
    reference_degc: Float[Array | np.ndarray, ""]
    range_degc: Float[Array | np.ndarray, " 2"]
    knots_degc: Float[Array | np.ndarray, " knots"]
    combination: Float[Array | np.ndarray, "count count"]
    order: int = eqx.field(static=True)

    def at(self, where: Where) -> tuple[Component, ...]:
        """The components for every position.

        **Raises:** `InputError` for data without temperatures.
        """
        require_temperature(self.reference.name, where)
        degc = jnp.asarray(where.temperature_degc)
        knots = [self.knots_degc[number] for number in range(self.knots_degc.shape[0])]
        rows = function_rows(degc, self.order, self.reference_degc, knots)
        functions = jnp.asarray(self.combination) @ jnp.stack(rows)
        values, changes = self.reference.at(where), self.change.at(where)
        return tuple(
            value + sum(functions[k] * changes[k * len(values) + number] for k in range(len(rows)))
            for number, value in enumerate(values)
        )

    @property
    def functions(self) -> TemperatureFunctions:
        """The functions of temperature (not in a traced program)."""
        low, high = (float(degc) for degc in self.range_degc)
        knots = tuple(float(knot) for knot in self.knots_degc)
        return TemperatureFunctions(self.order, float(self.reference_degc), (low, high), knots)


def following(leaf: Parameter, functions: TemperatureFunctions, where: Where) -> Parameter | Following:
    """The leaf with a change by these functions, estimated; the leaf itself for functions of order 0.

    **Raises:** `InputError` for data without temperatures, and for a leaf with a value for each position.
    """
    if not functions.count:
        return leaf
    require_temperature(leaf.name, where)
    if leaf.by == "position":
        raise InputError(f"{leaf.name} has a value for each position, so it cannot follow temperature")
    # `x1`; `21_1` after a digit.
    stems = [f"{component}{'_' if component[-1:].isdigit() else ''}" for component in leaf.components]
    change = coefficients(
        leaf.name + CHANGE,
        [f"{stem}{k}" for k in range(1, functions.count + 1) for stem in stems],
        unit=leaf.unit,
        scale=leaf.scale,
    )
    return Following(
        leaf,
        change,
        np.array(functions.reference_degc, float),
        np.array(functions.range_degc, float),
        np.array(functions.knots_degc, float),
        functions.combination,
        functions.order,
    )


def followings_of(tree: object) -> tuple[Following, ...]:
    """All leaves of a chain or a link that follow temperature, in their order.

    Examples:
        >>> from tumblecal.chain import followings_of, nominal_chain, settings
        >>> from tumblecal.ground.temperature_functions import TemperatureFunctions
        >>> where = settings([0.0, 0.0], [0.0, 0.0], temperature_degc=[0.0, 50.0])
        >>> chain = nominal_chain(where, temperature={"bias": TemperatureFunctions(1, 25.0, (0.0, 50.0))})
        >>> [(leaf.reference.name, leaf.functions.order) for leaf in followings_of(chain)]
        [('bias', 1)]
    """
    nodes = jax.tree.leaves(tree, is_leaf=_follows)
    return tuple(node for node in nodes if isinstance(node, Following))


def require_temperature(name: str, where: Where) -> None:
    """Reject data without temperatures for a leaf that follows them.

    **Raises:** `InputError` that names the missing column.
    """
    if where.temperature_degc is None:
        raise InputError(f"{name} follows temperature, but the data have no column temperature_degc")


def _follows(node: Any) -> bool:
    return isinstance(node, Following)

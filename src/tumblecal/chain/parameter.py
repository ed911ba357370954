"""A leaf of the chain: numbers with a name and a unit, shared by all data or one per group of them."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from tumblecal.chain.frames import Component
from tumblecal.chain.where import Where, check_index, register_unchecked


Tree = TypeVar("Tree")


@dataclasses.dataclass(frozen=True, eq=False)
class Parameter:
    """Named numbers in a link.

    `value` has one row for each group of the index column `by` (a single row if `by` is None: shared by all data) and one
    column for each component. `free` leaves are estimated, the others are fixed. `scale` is a typical size, used only for
    conditioning.

    Examples:
        >>> from tumblecal.chain import coefficients, settings
        >>> where = settings([0.0, 0.0, 1.5], [0.0, 0.8, 0.8])
        >>> leaf = coefficients("dbeta", unit="rad", by="pitch", where=where)
        >>> leaf.names, leaf.value.shape
        (('dbeta_0', 'dbeta_1'), (2, 1))
    """

    value: Float[Array | np.ndarray, "groups components *positions"]
    name: str
    components: tuple[str, ...]
    unit: str
    by: str | None
    suffixes: tuple[str, ...]
    free: bool
    scale: float

    def at(self, where: Where) -> tuple[Component, ...]:
        """The components for every position: scalars if shared, otherwise arrays over positions.

        A `value` with a third axis contains a copy of every number for each position (see `Chain.at`).
        """
        if self.by is None:
            return _unstacked(self.value, np.shape(self.value)[2:])
        index = where.index(self.by)
        # A fixed leaf is a plain numpy array, which a traced index cannot index.
        value = jnp.asarray(self.value)
        of_positions = value[index, :, np.arange(len(index))] if value.ndim == 3 else value[index]
        return _unstacked(of_positions, of_positions.shape[:1])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all entries in the order of `value.ravel()`: `dK_x`, `dbeta_0`, `bias_x@run=2`."""
        return tuple(
            f"{self.name}{'_' + component if component else ''}{suffix}"
            for suffix in self.suffixes
            for component in self.components
        )


register_unchecked(Parameter, ("value",), ("name", "components", "unit", "by", "suffixes", "free", "scale"))


def _unstacked(values: Array | np.ndarray, shape: tuple[int, ...]) -> tuple[Component, ...]:
    """The arrays along the second axis, each of this shape, by one operation of the trace and its derivative."""
    if isinstance(values, np.ndarray):
        return tuple(part.reshape(shape) for part in np.split(values, values.shape[1], 1))
    parts = jax.lax.split(values, (1,) * values.shape[1], 1) if values.shape[1] > 1 else (values,)
    return tuple(jax.lax.reshape(part, shape) for part in parts)


def parameters_of(tree: object) -> tuple[Parameter, ...]:
    """All leaves of a chain, a link or several links, in their order.

    Examples:
        >>> from tumblecal.chain import nominal_chain, parameters_of, settings
        >>> sorted(leaf.name for leaf in parameters_of(nominal_chain(settings([0.0], [0.0]))))
        ['bias', 'dK', 'dbeta', 'dtheta', 'gamma', 'levelling']
    """
    nodes = jax.tree.leaves(tree, is_leaf=lambda node: isinstance(node, Parameter))
    return tuple(node for node in nodes if isinstance(node, Parameter))


def with_parameters(tree: Tree, changed: Callable[[Parameter], Parameter]) -> Tree:
    """A chain or a link with each of its leaves changed.

    Examples:
        >>> from dataclasses import replace
        >>> from tumblecal.chain import nominal_chain, settings, with_parameters
        >>> chain = nominal_chain(settings([0.0], [0.0]))
        >>> with_parameters(chain, lambda leaf: replace(leaf, free=leaf.name == "bias")).names
        ('bias_x', 'bias_y', 'bias_z')
    """
    return jax.tree.map(
        lambda node: changed(node) if isinstance(node, Parameter) else node,
        tree,
        is_leaf=lambda node: isinstance(node, Parameter),
    )


def with_values(
    tree: Tree, leaves: Sequence[Parameter], vector: Float[Array | np.ndarray, " entries *positions"]
) -> Tree:
    """A chain or a link with the values of some leaves taken, in turn, from the entries of a vector.

    **Raises:** `ValueError` for a vector of the wrong length.

    Examples:
        >>> import numpy as np
        >>> from tumblecal.chain import coefficients, parameters_of, with_values
        >>> leaf = coefficients("bias", ("x", "y", "z"), unit="g")
        >>> with_values(leaf, parameters_of(leaf), np.array([1e-3, 2e-3, 3e-3])).value.tolist()
        [[0.001, 0.002, 0.003]]
    """
    count = sum(leaf.value.size for leaf in leaves)
    if count != vector.shape[0]:
        raise ValueError(f"the leaves have {count} free parameters, the vector {vector.shape[0]}")
    split = np.split if isinstance(vector, np.ndarray) else jnp.split
    parts = split(vector, np.cumsum([leaf.value.size for leaf in leaves])[:-1])
    values = {
        id(leaf): part.reshape(*leaf.value.shape, *vector.shape[1:]) for leaf, part in zip(leaves, parts, strict=False)
    }
    return with_parameters(
        tree, lambda leaf: dataclasses.replace(leaf, value=values[id(leaf)]) if id(leaf) in values else leaf
    )


def coefficients(
    name: str,
    components: Sequence[str] = ("",),
    *,
    unit: str,
    by: str | None = None,
    where: Where | None = None,
    free: bool = True,
    scale: float = 1e-3,
) -> Parameter:
    """A leaf whose coefficients are zero.

    **Arguments:**

    - `name`, `components`: `"dK"` with `("x", "y", "z")` gives dK_x, dK_y, dK_z.
    - `unit`: of the values (base units: rad, g, 1 and their products).
    - `by`: index column of the data (`"pitch"`, `"mount"`, `"run"`, `"run.pitch"`, ...), or None: shared.
    - `where`: the data's settings; needed with `by`.
    - `free`: whether it is estimated.
    - `scale`: typical size.

    **Raises:** `InputError` for an index column that the data lack; `ValueError` for `by` without `where`.

    Examples:
        >>> from tumblecal.chain import coefficients
        >>> coefficients("dK", ("x", "y", "z"), unit="1").names
        ('dK_x', 'dK_y', 'dK_z')
    """
    suffixes: tuple[str, ...] = ("",)
    if by is not None:
        if where is None:
            raise ValueError(f"{name}: a parameter indexed by {by!r} needs the data's settings")
        check_index(by, where)
        suffixes = where.names(by)
    return Parameter(
        value=np.zeros((len(suffixes), len(components))),
        name=name,
        components=tuple(components),
        unit=unit,
        by=by,
        suffixes=suffixes,
        free=free,
        scale=scale,
    )

"""Effects of the catalogue put into a simulated chain at a stated size."""

from collections.abc import Mapping, Sequence

import numpy as np

from tumblecal.chain import Link, Where, parameters_of, with_values
from tumblecal.effects.added_terms import base_unit
from tumblecal.effects.catalogue import Catalogue, catalogue, entry, links
from tumblecal.ground.errors import InputError
from tumblecal.ground.option_texts import faults_of


def with_sizes(link: Link, values: Sequence[float] | np.ndarray) -> Link:
    """`link` with its free numbers (base units) set, in their order; a single value applies to all."""
    leaves = [leaf for leaf in parameters_of(link) if leaf.free]
    count = sum(leaf.value.size for leaf in leaves)
    numbers = np.full(count, values[0]) if len(values) == 1 else np.asarray(values, float)
    if len(numbers) != count:
        names = ", ".join(name for leaf in leaves for name in leaf.names)
        raise InputError(f"{len(values)} values for {count} coefficients ({names})")
    return with_values(link, leaves, numbers)


def injected_links(
    sizes: Mapping[str, Sequence[float]], where: Where, entries: Catalogue | None = None
) -> tuple[Link, ...]:
    """Links for effects at given sizes.

    **Arguments:**

    - `sizes`: by effect id, in the unit in which the catalogue shows it; one value or one per coefficient.
    - `where`: the positions.
    - `entries`: the catalogue, with the user's effects if any.

    **Raises:** `InputError` for an unknown effect, one that is no link of the chain, or a wrong number of values.
    """
    entries, made = catalogue() if entries is None else entries, []
    for name, values in sizes.items():
        effect = entry(entries, name)
        factor = base_unit(effect.unit)[1]
        with faults_of(f"inject.{name}"):
            made.append(with_sizes(links(entries, (name,), where)[name][0], [value * factor for value in values]))
    return tuple(made)

"""The candidates of one data set: effects, faults, jumps at a position, and terms without a name, in one table."""

from tumblecal.diagnosis.causes.effects import effect_causes, seen_effects
from tumblecal.diagnosis.causes.faults import clipped, mislabels, outliers, swaps
from tumblecal.diagnosis.causes.table import Pool as Pool
from tumblecal.diagnosis.causes.terms import generic_causes, jumps, shape_causes
from tumblecal.full_model.tangent import Tangent


def pooled(
    at: Tangent,
    level: float,
    generic: tuple[int, ...] | None = None,
    visible: frozenset[str] | None = None,
) -> Pool:
    """Effects of the catalogue, faults of single positions, jumps at one, and generic terms.

    **Arguments:**

    - `level`: sd of the white rows; faults smaller than a few of it are no candidates.
    - `generic`: numbers of the generic terms to use; if omitted, they are selected here.
    - `visible`: the effects that are visible without any error, as in `causes.effects`.
    """
    seen = seen_effects(at)
    effects = effect_causes(at, seen, visible)
    # Nothing of a head can be seen of unknown attitudes.
    of_head = [] if at.model.hand_held else [swaps(at, level), mislabels(at, level)]
    terms, generic = generic_causes(at, effects, generic)
    parts = [effects, outliers(at), *of_head, *clipped(at), *jumps(at), terms, *shape_causes(at)]
    return Pool.joined(parts, at.dof, seen_effects=seen, generic=generic)

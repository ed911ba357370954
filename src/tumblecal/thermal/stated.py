"""What a user states of the dependence on temperature."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from tumblecal.data.calibration import Calibration, read_calibration
from tumblecal.ground.errors import InputError
from tumblecal.ground.option_texts import numbers, pairs
from tumblecal.ground.temperature_functions import HIGHEST_ORDER


# Names of leaves in options, and in the model.
_LEAVES = {"bias": "bias", "scale": "dK", "orthogonality": "gamma", "mount": "dtheta"}


@dataclass(frozen=True)
class Stated:
    """What the user states; the rest is chosen.

    - `orders`: highest order by leaf (0: constant). `knots_degc`: knots by leaf. `reference_degc`: of all functions.
    - `base`: a calibration of the unit, for parameters that the attitudes do not determine. Its temperature is the reference
      if it was measured.
    """

    orders: Mapping[str, int] = field(default_factory=dict)
    knots_degc: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    reference_degc: float | None = None
    base: Calibration | None = None


def read_stated(order: str, knots: Sequence[str], reference_degc: float | None, path: Path | None) -> Stated:
    """The statements of options; `path`: of the base.

    **Raises:** `InputError` for an option that cannot be read.
    """
    orders = pairs("--order", order, "bias=3,scale=1", _LEAVES)
    of_leaves = pairs("--knots", knots, "bias=0,20,40", _LEAVES)
    if both := [leaf for leaf in of_leaves if leaf in orders]:
        raise InputError(f"--order and --knots both state {both[0]}; give one of them")
    if wrong := {*orders.values()} - {*map(str, range(HIGHEST_ORDER + 1))}:
        raise InputError(f"--order {order}: {min(wrong)!r} is not an order from 0 to {HIGHEST_ORDER}")
    base = None if path is None else read_calibration(path)
    if path is not None and base is not None:
        base.use.require(path, anyway=False)
    return Stated(
        {_LEAVES[leaf]: int(given) for leaf, given in orders.items()},
        {_LEAVES[leaf]: numbers(f"--knots {leaf}", text, "0,20,40") for leaf, text in of_leaves.items()},
        reference_degc,
        base,
    )

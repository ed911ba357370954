"""Functions of temperature that a parameter may follow: a polynomial, or a spline.

A parameter p follows the temperature T as `p(T) = p(T0) + sum of c_k h_k(T)`, with

- `h_k(T) = (T - T0)^k` for k = 1 to the order, and
- `h(T) = max(T - knot, 0)^3 - max(T0 - knot, 0)^3` for each knot of a cubic spline (truncated powers);
  with the power 1 for a linear spline, which interpolates a table.

All functions are zero at the reference T0, so the parameter itself is its value at T0. A fit uses combinations that are
orthonormal over the measured range (root mean square 1, equal weight over temperature), because powers of the temperature are
nearly dependent. The k-th combination contains only the first k functions, so models of lower order are nested.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from tumblecal.ground.errors import InputError


HIGHEST_ORDER = 5
SPLINE_ORDER, _LINEAR = 3, 1
# A reference outside these temperatures is a typing error.
_LOWEST_DEGC, _HIGHEST_DEGC = -273.15, 1000.0
# Temperatures of the range at which functions are orthonormal.
_GRID = 201
# Two knots, or a knot and an end of the range, that are closer than this share of the range determine no cubic between them.
_CLOSEST_KNOTS = 0.02


@dataclass(frozen=True)
class TemperatureFunctions:
    """The functions of one parameter, for temperatures in degC.

    **Arguments:**

    - `order`: of the polynomial, 0 (constant) to 5; with knots 3 (cubic spline) or 1 (linear spline).
    - `reference_degc`: where all functions are zero. `range_degc`: lowest and highest measured temperature.
    - `knots_degc`: interior knots of a spline, increasing; none: a polynomial.

    **Raises:** `InputError` for an order outside 0 to 5, an empty range, an impossible reference, or knots that are not
    increasing within the range.

    Examples:
        >>> cubic = TemperatureFunctions(3, reference_degc=25.0, range_degc=(0.0, 60.0))
        >>> cubic.count, cubic.values(np.array([25.0, 27.0])).T.tolist()
        (3, [[0.0, 0.0, 0.0], [2.0, 4.0, 8.0]])
        >>> grid = np.linspace(0.0, 60.0, 201)
        >>> bool(np.allclose(cubic.orthonormal(grid) @ cubic.orthonormal(grid).T / 201, np.eye(3)))
        True
    """

    order: int
    reference_degc: float
    range_degc: tuple[float, float]
    knots_degc: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        low, high = self.range_degc
        if not 0 <= self.order <= HIGHEST_ORDER:
            raise InputError(f"order {self.order} of a temperature polynomial: it must be 0 to {HIGHEST_ORDER}")
        if not _LOWEST_DEGC <= self.reference_degc <= _HIGHEST_DEGC:
            limits = f"{_LOWEST_DEGC:g} to {_HIGHEST_DEGC:g} degC"
            raise InputError(f"reference temperature {self.reference_degc:g} degC: it must be from {limits}")
        if not low < high:
            raise InputError(
                f"temperature range {low:g} to {high:g} degC: the lowest temperature must be below the highest"
            )
        if self.knots_degc and self.order not in (SPLINE_ORDER, _LINEAR):
            raise InputError(
                f"knots with order {self.order}: a cubic spline has order 3; remove the order or the knots"
            )
        gaps = np.diff([low, *self.knots_degc, high])
        closest = _CLOSEST_KNOTS * (high - low) if self.order == SPLINE_ORDER else np.finfo(float).tiny
        if self.knots_degc and not np.min(gaps) >= closest:
            stated = ", ".join(f"{knot:g}" for knot in self.knots_degc)
            raise InputError(f"knots {stated} degC: they must increase within the range {low:g} to {high:g} degC")

    @property
    def count(self) -> int:
        """The number of functions."""
        return self.order + len(self.knots_degc)

    @property
    def units(self) -> tuple[str, ...]:
        """The divisor of the unit of each coefficient: `/degC`, `/degC^2`, ..."""
        return unit_divisors(self.order, len(self.knots_degc))

    @property
    def coefficient_ends(self) -> tuple[str, ...]:
        """Ends of the names of the coefficients: `/degC`, `/degC^2`, ..., and `/degC^3@20.0` for a knot at 20 degC."""
        ends = [""] * self.order + [f"@{knot!r}" for knot in self.knots_degc]
        return tuple(unit + end for unit, end in zip(self.units, ends, strict=True))

    @property
    def words(self) -> str:
        """`order 3`, or a spline with its knots."""
        return form_words(self.order, self.knots_degc)

    def values(self, degc: Any) -> Any:
        """The functions (count, rows) at temperatures (rows), of numpy or JAX."""
        return _stacked(degc, function_rows(degc, self.order, self.reference_degc, self.knots_degc))

    def orthonormal(self, degc: Any) -> Any:
        """The orthonormal combinations (count, rows) at temperatures (rows), of numpy or JAX."""
        rows = function_rows(degc, self.order, self.reference_degc, self.knots_degc)
        mixed = [
            sum(float(factor) * row for factor, row in zip(line[: k + 1], rows, strict=False))
            for k, line in enumerate(self.combination)
        ]
        return _stacked(degc, mixed)

    @cached_property
    def combination(self) -> Float[np.ndarray, "count count"]:
        """Lower-triangular L: `orthonormal = L values`, so `a @ orthonormal` has the coefficients `a @ L` of `values`."""
        if not self.count:
            return np.zeros((0, 0))
        grid = np.linspace(*self.range_degc, _GRID)
        values = self.values(grid).T / np.sqrt(_GRID)
        size = np.linalg.norm(values, axis=0)
        upper = np.linalg.qr(values / size, mode="r")
        # A positive diagonal: the k-th combination increases with the k-th function.
        upper = np.sign(np.diag(upper))[:, None] * upper * size
        return np.linalg.inv(upper).T

    def of_coefficients(self, physical: Float[np.ndarray, " count *columns"]) -> Float[np.ndarray, " count *columns"]:
        """The coefficients of the orthonormal combinations that equal these physical coefficients."""
        return np.linalg.solve(self.combination.T, physical) if self.count else physical


def unit_divisors(order: int, knots: int) -> tuple[str, ...]:
    """The divisor of the unit of each coefficient of a polynomial, or of a spline with this many knots."""
    powers = [*range(1, order + 1), *([order] * knots)]
    return tuple("/degC" if power == 1 else f"/degC^{power}" for power in powers)


def form_words(order: int, knots_degc: Sequence[float]) -> str:
    """`order 3`, or a spline with its knots."""
    kind = "linear" if order == _LINEAR else "cubic"
    knots = ", ".join(f"{knot:g}" for knot in knots_degc)
    return (
        f"a {kind} spline with {'a knot' if len(knots_degc) == 1 else 'knots'} at {knots} degC"
        if knots
        else f"order {order}"
    )


def function_rows(degc: Any, order: int, reference_degc: Any, knots_degc: Sequence[Any]) -> list[Any]:
    """The functions, one by one, at temperatures (rows); numbers of numpy or JAX."""
    above = degc - reference_degc
    powers = [above**power for power in range(1, order + 1)]
    return powers + [_truncated(degc - knot, order) - _truncated(reference_degc - knot, order) for knot in knots_degc]


def _truncated(above: Any, power: int) -> Any:
    # A power of the larger of this and 0, for numbers of numpy, JAX and Python.
    return ((above + abs(above)) / 2) ** power


def _stacked(degc: Any, rows: list[Any]) -> Any:
    if isinstance(degc, np.ndarray):
        return np.array(rows).reshape(len(rows), *degc.shape)
    import jax.numpy as jnp

    return jnp.stack(rows) if rows else jnp.zeros((0, *degc.shape))

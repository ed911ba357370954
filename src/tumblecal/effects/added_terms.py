"""Effects that add terms to an output or to an angle of the head, and their links."""

from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp

from tumblecal.chain import Link, Parameter, Place, State, Where, coefficients
from tumblecal.chain.frames import Vector
from tumblecal.effects.effect import Effect
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.units import factor


# A term of an output: its value for every position, from the ideal inputs u = (u_x, u_y, u_z) in g and the settings.
Term = Callable[[Vector, Where], Any]
# A term of an angle: its value for every position, from the commanded angle in rad and the settings.
AngleFunction = Callable[[Any, Where], Any]


class OutputTerm(Link):
    """Terms added to one output: `A_axis += sum of coefficient * term(u, where)`.

    Examples:
        >>> from tumblecal.chain import coefficients, nominal_chain, settings
        >>> from tumblecal.effects import OutputTerm
        >>> where = settings([0.0], [0.0])
        >>> square = OutputTerm(coefficients("k2", unit="1/g"), axis=2, terms=(lambda u, where: u[2] ** 2,))
        >>> round(float((nominal_chain(where) + square).named({"k2": 5e-4})(where)[0, 2]), 7)
        1.0005
    """

    place: ClassVar[Place] = Place.READING
    size: Parameter
    axis: int = eqx.field(static=True)
    terms: tuple[Term, ...] = eqx.field(static=True)

    def __call__(self, state: State, where: Where) -> State:
        added = sum(size * term(state.f, where) for size, term in zip(self.size.at(where), self.terms, strict=True))
        reading = tuple(value + added if k == self.axis else value for k, value in enumerate(state.reading))
        return eqx.tree_at(lambda s: s.reading, state, reading)


class OutputTermLookingBack(OutputTerm):
    """Terms that also use `where.inputs_before`."""

    looks_back: ClassVar[bool] = True


def output_effect(
    id: str,
    axis: str,
    terms: Term | Sequence[Term],
    *,
    unit: str,
    typical: float,
    physics: str,
    cause: str,
    advice: str = "",
    source: str = "user",
    symbol: str = "",
    needs: Sequence[str] = (),
    components: Sequence[str] = ("",),
    kinked: bool = False,
    forms: Sequence[dict[str, Any]] = (),
    weight: float = 1.0,
    looks_back: bool = False,
    pauses: str = "",
    not_held: str = "",
    of_time: int = 0,
) -> Effect:
    """An effect that adds terms to the output of one axis.

    **Arguments:**

    - `id`: public name, which by convention ends in the axis.
    - `axis`: `"x"`, `"y"` or `"z"`.
    - `terms`: one function of `(u, where)` for each coefficient; u is the tuple of ideal inputs in g.
    - `looks_back`: whether the terms use `where.inputs_before`, the inputs at the previous position.
    - `pauses`: pauses of unknown length that the terms allow: "", "between runs" or "any".
    - `of_time`: the power of time, for a term that is one.
    - `unit`: of the coefficients, such as `mg/g^2`; the rest as in `Effect`.

    **Returns:** the catalogue entry.

    **Raises:** `InputError` for another axis, or terms without names.

    Examples:
        >>> from tumblecal.effects import output_effect
        >>> output_effect(
        ...     "fourth_order.y", "y", lambda u, where: u[1] ** 4, unit="mg/g^4", typical=0.2,
        ...     physics="K4 u^4", cause="Fourth-order nonlinearity of the y axis.",
        ... )
        Effect(fourth_order.y, mg/g^4: Fourth-order nonlinearity of the y axis.)
    """
    if axis not in AXES:
        raise InputError(f"effect {id!r}: axis {axis!r} is not one of x, y, z")
    functions, kind = _functions(id, terms, components), OutputTermLookingBack if looks_back else OutputTerm
    base, scale = base_unit(unit)

    def make(where: Where) -> tuple[Link, ...]:
        size = coefficients(id, tuple(components), unit=base, scale=typical * scale)
        return (kind(size, AXES.index(axis), functions),)

    described = id, physics, unit, typical, cause, advice, source
    shown = {"kinked": kinked, "forms": tuple(forms), "weight": weight, "looks_back": looks_back, "pauses": pauses}
    return Effect(*described, make, symbol, tuple(needs), **shown, not_held=not_held, of_time=of_time)


class AngleTerm(Link):
    """Terms added to an angle of the head: `angle += sum of coefficient * term(angle, where)`, commanded angle in rad."""

    size: Parameter
    terms: tuple[AngleFunction, ...] = eqx.field(static=True)

    def _error(self, commanded, where: Where):
        commanded = jnp.asarray(commanded)
        return sum(size * term(commanded, where) for size, term in zip(self.size.at(where), self.terms, strict=True))


class SpindleAngleTerm(AngleTerm):
    """Terms added to alpha, where the index acts."""

    place: ClassVar[Place] = Place.INDEX

    def __call__(self, state: State, where: Where) -> State:
        return State(state.alpha + self._error(where.alpha, where), state.beta, state.f, state.reading)


class PitchAngleTerm(AngleTerm):
    """Terms added to beta, before the pitch axis turns."""

    place: ClassVar[Place] = Place.PITCH_SCALE

    def __call__(self, state: State, where: Where) -> State:
        return State(state.alpha, state.beta + self._error(where.beta, where), state.f, state.reading)


def angle_effect(
    id: str,
    angle: str,
    terms: AngleFunction | Sequence[AngleFunction],
    *,
    unit: str,
    typical: float,
    physics: str,
    cause: str,
    advice: str = "",
    source: str = "user",
    needs: Sequence[str] = (),
    components: Sequence[str] = ("",),
) -> Effect:
    """An effect that adds terms to an angle of the head.

    **Arguments:**

    - `id`: public name.
    - `angle`: `"alpha"` (spindle) or `"beta"` (pitch).
    - `terms`: one function of `(commanded angle in rad, where)` for each coefficient.
    - `unit`: of the coefficients, such as `mrad`; the rest as in `Effect`.

    **Returns:** the catalogue entry.

    **Raises:** `InputError` for another angle, or terms without names.

    Examples:
        >>> import jax.numpy as jnp
        >>> from tumblecal.chain import settings
        >>> from tumblecal.effects import angle_effect
        >>> third = angle_effect(
        ...     "index_third", "alpha", lambda alpha, where: jnp.cos(3 * alpha), unit="mrad", typical=0.1,
        ...     physics="alpha + c cos(3 alpha)", cause="The index has three errors per turn.",
        ... )
        >>> [link.size.names for link in third.make(settings([0.0], [0.0]))]
        [('index_third',)]
    """
    kinds = {"alpha": SpindleAngleTerm, "beta": PitchAngleTerm}
    if angle not in kinds:
        raise InputError(f"effect {id!r}: angle {angle!r} is not one of alpha (spindle), beta (pitch)")
    functions = _functions(id, terms, components)
    base, scale = base_unit(unit)

    def make(where: Where) -> tuple[Link, ...]:
        return (kinds[angle](coefficients(id, tuple(components), unit=base, scale=typical * scale), functions),)

    return Effect(id, physics, unit, typical, cause, advice, source, make, needs=tuple(needs))


def _functions(id: str, terms, components: Sequence[str]) -> tuple[Callable[..., Any], ...]:
    functions = (terms,) if callable(terms) else tuple(terms)
    if len(functions) != len(components) or not functions:
        raise InputError(f"effect {id!r}: {len(functions)} terms, {len(components)} components; name one for each term")
    return functions


def base_unit(unit: str) -> tuple[str, float]:
    """The unit in which the chain stores a coefficient shown in `unit`, and the factor to it.

    **Example:** `base_unit("mg/g^2") == ("g/g^2", 1e-3)`; `(mg/g)/h` is stored in `1/s`.
    """
    base = unit.replace("(mg/g)", "1").replace("mrad", "rad").replace("mg", "g").replace("1e-3", "1")
    parts = base.split("/")
    parts = [{"h": "s", "min": "s"}.get(part, part) for part in parts]
    base = "/".join(parts)
    return base, factor(unit, base)

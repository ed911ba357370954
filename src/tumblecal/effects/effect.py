"""Catalogue entries, and the link that most entries of the sensor need."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from tumblecal.chain import Link, Parameter, Place, State, Where, coefficients
from tumblecal.chain.frames import Vector
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.units import converts, factor


# Prior weight of an entry that is the cause less often than those of the model equation and of the head.
RARE = 0.25
# The same for a higher order without the lower one, which produces nearly the same signal.
HIGHER_ORDER = 0.15

# Pauses of unknown length that an effect of time allows: its time is separate in each run.
BETWEEN_RUNS = "between runs"

# A term of an output: its value for every position, from the ideal inputs u = (u_x, u_y, u_z) in g and the settings.
Term = Callable[[Vector, Where], Any]
# A term of an angle: its value for every position, from the commanded angle in rad and the settings.
AngleFunction = Callable[[Any, Where], Any]

# Reference of a form relative to the mean temperature of the data.
MEAN = "mean"
# Reasons why a calibration file has no term for an effect: it gives the force in the frame of the triad, at any time
# and attitude.
OF_HEAD = "it acts in the dividing head, not in the sensor"
OF_RUN = "it is relative to the start of this measurement and has no value at another time"
OF_GROUPS = "it has a value for each pitch setting or run of this measurement, and none for other readings"
OF_PATH = "it depends on the position measured before, which single readings do not state"
OF_MOUNT = (
    "it turns the triad in its mount: force in the frame of the triad is correct without it; only `alignment` changes"
)
OF_RESOLUTION = "the readout loses information by rounding or clipping; no correction restores it"
NO_FORMS = "its entry states no `forms`, so its term in a calibration file is not known"

# Name of one label of a column.
_ONE_OF = {"pitch": "pitch setting", "mount": "mounting"}


@dataclass(frozen=True)
class Effect:
    """One entry of the catalogue.

    - `id`: public name; `.x` at its end means one per axis.
    - `physics`: formula in words of the chain.
    - `unit`: unit in which the coefficients are shown.
    - `typical`: a size that occurs in practice, in `unit`; the consequences of undetectable effects are stated for it.
    - `cause`: the cause in plain words. `advice`: remedy on the bench.
    - `source`: definition of the term.
    - `make`: links with zero coefficients for given settings, or None for an effect on the data (exchanged positions) or on the
      noise. Several links are variants that differ in the start of a shape parameter, such as a time constant.
    - `symbol`: IEEE 1293 symbol, if there is one. `needs`: optional data columns that it needs.
    - `kinked`: it jumps with the sign of an input, so its signal must be found by exact fits, not by derivatives alone.
    - `forms`: the term of each coefficient in a calibration file (`data.calibration_terms`), without its coefficient, and with
      `reference_degc` a number or `MEAN`, that of the data; none: the file cannot include it, for the reason `not_held`.
    - `weight`: prior weight relative to an entry of weight 1; `shares`: of it, for each variant (none: equal).
    - `looks_back`: it uses the inputs at the previous position, so the attitudes must be known.
    - `largest`: the size (base unit) of a coefficient beyond which it is no cause: it would be noticed in the set-up.
    - `found_as`: the finding of the diagnosis for an entry that it does not test.
    - `pauses`: for an effect of time, the pauses of unknown length that it allows: "" none, "between runs", or "any".
    - `of_time`: the power of time with which it changes the bias of its axis; 0 for any other function.

    Examples:
        >>> from tumblecal.effects import catalogue
        >>> effect = catalogue()["index_eccentricity"]
        >>> effect.unit, effect.typical, effect.needs
        ('mrad', 0.1, ())
    """

    def __repr__(self) -> str:
        return f"Effect({self.id}, {self.unit}: {self.cause})"

    id: str
    physics: str
    unit: str
    typical: float
    cause: str
    advice: str
    source: str
    make: Callable[[Where], tuple[Link, ...]] | None = None
    symbol: str = ""
    needs: tuple[str, ...] = ()
    kind: str = "physics"
    kinked: bool = False
    forms: tuple[dict[str, Any], ...] = ()
    weight: float = 1.0
    shares: tuple[float, ...] = ()
    found_as: str = ""
    not_held: str = ""
    looks_back: bool = False
    largest: float = math.inf
    pauses: str = ""
    of_time: int = 0

    def lacking(self, where: Where) -> str:
        """The needs that the data lack, as in "the data have no column time_s and only one run"; "" if none. A single
        run, or pitch setting, counts as lacking."""
        columns = [name for name in self.needs if name not in where.groups and getattr(where, name) is None]
        single = [name for name in self.needs if name in where.groups and len(where.names(name)) < 2]
        words = [f"no column {' and '.join(columns)}"] if columns else []
        words += [f"only one {_ONE_OF.get(name, name)}" for name in single]
        return " and ".join([*words, *(["pauses of unknown length"] if self._depends_on_a_pause(where) else [])])

    def _depends_on_a_pause(self, where: Where) -> bool:
        if "time_s" not in self.needs or where.clocks == 1 or self.pauses == "any":
            return False
        within = len({*zip(*(np.asarray(where.index(by)).tolist() for by in ("run", "clock")), strict=True)})
        return self.pauses != BETWEEN_RUNS or within > len(where.names("run"))

    @property
    def polynomial(self) -> tuple[tuple[str, str] | tuple[()], int]:
        """Output, variable (an input, `degc`, `time`) and power of an effect that is a power; `()` and 0 for any other."""
        if self.of_time:
            return (self.id.rpartition(".")[2], "time"), self.of_time
        form = self.forms[0] if len(self.forms) == 1 else {}
        # `data.calibration_terms` checks whether a user's form is valid.
        inputs, degc = form.get("powers"), form.get("degc_power", form.get("per_degc"))
        powers = dict(zip([*AXES, "degc"], [*inputs, degc] if isinstance(inputs, list) else [], strict=False))
        powered = [(name, power) for name, power in powers.items() if isinstance(power, int) and power]
        if form.get("kind", "product") != "product" or form.get("per_hour") or len(powered) != 1:
            return (), 0
        ((variable, power),) = powered
        return (str(form.get("axis")), variable), int(power)

    def shows(self, base: str) -> bool:
        """Whether a coefficient of this base unit is shown in its unit."""
        return converts(self.unit, base)


def reason_not_held(effect: Effect, links: Sequence[Link]) -> str:
    """Reason why a calibration file has no term for an effect with these links; "" if it has one."""
    if effect.forms:
        return ""
    return OF_HEAD if of_head(links) else effect.not_held or NO_FORMS


def of_head(links: Sequence[Link]) -> bool:
    """Whether links belong to the head, common to all units: they act before the triad's mount."""
    return all(link.place < Place.MOUNT for link in links)


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


def elapsed(where: Where) -> jax.Array | np.ndarray:
    """Time since the first position, s; with several clocks since the first by the same clock."""
    if isinstance(where.time_s, np.ndarray) and where.clocks == 1:
        return where.time_s - np.min(where.time_s)  # outside of a program JAX compiles each operation by itself
    time = jnp.asarray(where.time_s)
    if where.clocks == 1:
        return time - jnp.min(time)
    since = jnp.zeros_like(time)
    for here in of_clocks(where):
        since = jnp.where(here, time - jnp.min(jnp.where(here, time, jnp.inf)), since)
    return since


def of_clocks(where: Where) -> list[jax.Array]:
    """For each of several clocks, the mask of its positions."""
    clock = jnp.asarray(where.index("clock"))
    return [clock == number for number in range(where.clocks)]

"""Catalogue entries, why a calibration file may have no term for one, and the time that they use."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from tumblecal.chain import Link, Place, Where
from tumblecal.chain.where import LEAST_RANGE_DEGC
from tumblecal.ground.axes import AXES
from tumblecal.ground.units import converts


# Prior weight of an entry that is the cause less often than those of the model equation and of the head.
RARE = 0.25
# The same for a higher order without the lower one, which produces nearly the same signal.
HIGHER_ORDER = 0.15

# Pauses of unknown length that an effect of time allows: its time is separate in each run.
BETWEEN_RUNS = "between runs"

# Reference of a form relative to the mean temperature of the data.
MEAN = "mean"
# Reasons why a calibration file has no term for an effect: it gives the force in the frame of the triad, at any time
# and attitude.
OF_HEAD = "it acts in the dividing head, not in the sensor"
OF_RUN = "it is relative to the start of this measurement and has no value at another time"
OF_GROUPS = "it has a value for each pitch setting or run of this measurement, and none for other readings"
OF_PATH = "it depends on the position measured before, which single readings do not state"
OF_BRANCH = "it depends on the direction in which the temperature was reached, which single readings do not state"
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
    - `least_soaks`: the number of separate temperatures that determine it, over a range of 10 degC or more; 0: any.
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
    least_soaks: int = 0

    def lacking(self, where: Where) -> str:
        """The needs that the data lack, as in "the data have no column time_s and only one run"; "" if none. A single
        run, or pitch setting, counts as lacking."""
        columns = [name for name in self.needs if name not in where.groups and getattr(where, name) is None]
        single = [name for name in self.needs if name in where.groups and len(where.names(name)) < 2]
        words = [f"no column {' and '.join(columns)}"] if columns else []
        words += [f"only one {_ONE_OF.get(name, name)}" for name in single]
        if self.least_soaks > where.soaks and where.temperature_degc is not None:
            words.append(f"no {self.least_soaks} separate temperatures (soaks) over {LEAST_RANGE_DEGC:g} degC or more")
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

    @property
    def over_temperature(self) -> tuple[Any, ...]:
        """Axis and powers of the inputs of an effect that is a polynomial of the temperature, from the first power on: its
        orders are one cause. `()` for any other."""
        of_inputs = {
            (str(form.get("axis")), *form.get("powers", ())) for form in self.forms if not form.get("per_hour")
        }
        powers = [form.get("degc_power", int(bool(form.get("per_degc")))) for form in self.forms]
        return of_inputs.pop() if len(of_inputs) == 1 and powers == [*range(1, len(powers) + 1)] else ()

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

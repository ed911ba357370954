"""Closed forms of a candidate law, each as the expression in a file for `--effects`.

Products of inputs, harmonics of the spindle angle, powers, exponentials and periods of the time, polynomials in the
temperature, steps and knees of an input, and terms limited to some angles or times. Forms of the catalogue are excluded.
"""

from collections.abc import Iterator, Sequence
from itertools import combinations_with_replacement
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from tumblecal.chain import Where
from tumblecal.effects import AXES
from tumblecal.effects.effect import elapsed
from tumblecal.ground.angle_settings import setting_angle


# Degrees of the products of inputs: the catalogue has all of degree two.
_DEGREES = (3, 4)
_MOST_HARMONICS, _IN_TIME, _PERIODS = 8, 4, 6
# Time constants, as shares of the whole.
_DECAYS = np.geomspace(0.04, 1.5, 10)
_MOST_STEPS = 40
_THRESHOLDS = np.arange(-6, 7) * 0.15
# Widths (rad) of smooth bumps, and of how many neighbouring angles boxes are at most.
_WIDTHS, _MOST_ANGLES = (0.2, 0.4, 0.8), 8
# Values of a function below this are rounding.
_ROUNDING = 1e-9
_INPUTS = {f"u_{axis}": (f"u[{k}]", k) for k, axis in enumerate(AXES)}


class Form(NamedTuple):
    """One closed form: one function, or sine and cosine.

    - `family`: kind of form; prior weight is shared by families, then by their forms.
    - `name`: part of an effect's id. `words`, `code`: of each function; Python of `u`, `where` and `elapsed`.
    - `unit`: of the output's coefficient after its mg. `needs`: columns.
    - `held`: the term in the form of a calibration file, without axis; None: it has no such form.
    - `against`: the variable on which it depends. `of_input`: whether it uses an input, so that no angle depends on it.
    """

    family: str
    name: str
    words: tuple[str, ...]
    code: tuple[str, ...]
    unit: str = ""
    needs: tuple[str, ...] = ()
    held: dict[str, Any] | None = None
    against: str = "alpha"
    of_input: bool = False

    def times(self, words: str, code: str, name: str, axis: int) -> "Form":
        """This form times one input."""
        held = None if self.held is None else self.held | {"powers": [int(k == axis) for k in range(3)]}
        unit = "/g" if not self.unit else f"/g{self.unit}"
        return self._replace(
            family=f"{self.family} times input", name=f"{self.name}_{name}", unit=unit, held=held, of_input=True,
            words=tuple(f"{words} {text}" for text in self.words), code=tuple(f"{code} * {text}" for text in self.code),
        )  # fmt: skip

    def both(self, other: "Form") -> "Form":
        """This form times another form of one function."""
        return other._replace(
            family=f"{self.family} times {other.family}",
            name=f"{self.name}_{other.name}",
            words=tuple(f"{text} {other.words[0]}" for text in self.words),
            code=tuple(f"{other.code[0]} * {text}" for text in self.code),
        )


def values_of(
    listed: Sequence[Form], where: Where, inputs: Float[np.ndarray, "positions 3"]
) -> Float[np.ndarray, "positions functions"]:
    """All functions at every position, by the same expressions that the file has."""
    time = None if where.time_s is None else np.asarray(elapsed(where), float)
    named = {"jnp": np, "u": inputs.T, "where": where, "elapsed": lambda _: time}
    values = np.empty((len(inputs), sum(len(form.code) for form in listed)))
    for column, code in enumerate(code for form in listed for code in form.code):
        values[:, column] = eval(code, named)
    return values


def nonzero_functions(
    listed: Sequence[Form], where: Where, inputs: Float[np.ndarray, "positions 3"]
) -> tuple[list[Form], Float[np.ndarray, "positions functions"]]:
    """Forms without their functions that are zero at every position, whose coefficients no reading shows, and the values."""
    values = values_of(listed, where, inputs)
    nonzero = np.max(np.abs(values), axis=0) > _ROUNDING
    shown, kept = iter(nonzero.tolist()), []
    for form in listed:
        pairs = [pair for pair in zip(form.words, form.code, strict=True) if next(shown)]
        if pairs:
            words, code = zip(*pairs, strict=True)
            kept.append(form._replace(words=words, code=code))
    return kept, values[:, nonzero]


def forms(where: Where) -> list[Form]:
    """All forms for data with these columns."""
    waves = list(_harmonics(where))
    listed = [*_products(), *waves, *_of_inputs(), *boxes(where), *_bumps(where)]
    listed += [wave.times(*by) for wave in waves for by in _each_input()]
    sides = [Form("", f"{name}_beta", (f"{name}(beta)",), (f"jnp.{name}(where.beta)",)) for name in ("sin", "cos")]
    listed += [wave.both(side)._replace(family="harmonic of the head") for wave in waves for side in sides]
    if where.time_s is not None and np.ptp(np.asarray(where.time_s)) > 0:
        listed += _of_time(where, waves[:_IN_TIME])
    if where.temperature_degc is not None and np.ptp(np.asarray(where.temperature_degc)) > 0:
        listed += _of_temperature(where, waves[:_IN_TIME])
    return listed


def _each_input() -> Iterator[tuple[str, str, str, int]]:
    yield from ((words, code, AXES[axis], axis) for words, (code, axis) in _INPUTS.items())


def _products() -> Iterator[Form]:
    for degree in _DEGREES:
        for axes in combinations_with_replacement(range(3), degree):
            powers = [axes.count(axis) for axis in range(3)]
            factors = [(AXES[k], k, power) for k, power in enumerate(powers) if power]
            words = " ".join(f"u_{axis}{f'^{power}' if power > 1 else ''}" for axis, _, power in factors)
            code = " * ".join(f"u[{k}]{f' ** {power}' if power > 1 else ''}" for _, k, power in factors)
            name = f"product_{''.join(axis * power for axis, _, power in factors)}"
            largest = max(factors, key=itemgetter(2))[0]
            yield Form(
                "product", name, (words,), (code,), f"/g^{degree}", held={"powers": powers}, against=f"u_{largest}",
                of_input=True,
            )  # fmt: skip


def _harmonics(where: Where) -> Iterator[Form]:
    most = min(_MOST_HARMONICS, len(np.unique(np.round(np.asarray(where.alpha), 6))) // 2)
    for order in range(1, most + 1):
        angle, code = ("alpha", "where.alpha") if order == 1 else (f"{order} alpha", f"{order} * where.alpha")
        waves = ("sin", "cos")
        yield Form(
            "harmonic", f"harmonic_{order}", tuple(f"{wave}({angle})" for wave in waves),
            tuple(f"jnp.{wave}({code})" for wave in waves),
        )  # fmt: skip


def _of_inputs() -> Iterator[Form]:
    """Steps and knees."""
    for words, code, axis, _ in _each_input():
        for number, least in enumerate(np.round(_THRESHOLDS, 2).tolist()):
            if least:
                step = f"jnp.where({code} > {least}, 1.0, 0.0)"
                said = f"step({words} > {least:g})"
                yield Form("step", f"step_{axis}_{number}", (said,), (step,), against=words, of_input=True)
            less = f" {'-' if least > 0 else '+'} {abs(least)}" if least else ""
            knee, said = f"jnp.maximum({code}{less}, 0.0)", f"max({words}{less}, 0)"
            yield Form("knee", f"knee_{axis}_{number}", (said,), (knee,), "/g", against=words, of_input=True)


def _of_time(where: Where, waves: Sequence[Form]) -> Iterator[Form]:
    t, needs = np.asarray(elapsed(where), float), ("time_s",)
    span = float(f"{np.max(t):.3g}")

    def form(family: str, name: str, words: Sequence[str], code: Sequence[str]) -> Form:
        return Form(family, name, tuple(words), tuple(code), needs=needs, against="time")

    decays = []
    for number, share in enumerate(_DECAYS, 1):
        tau = float(f"{share * span:.2g}")
        decays.append(
            form("decay", f"decay_{number}", [f"exp(-t/{_time(tau)})"], [f"jnp.exp(-elapsed(where) / {tau})"])
        )
    share = f"(elapsed(where) / {span})"
    powers = [
        form("power of time", f"time_{power}", [f"(t/{_time(span)})^{power}"], [f"{share} ** {power}"])
        for power in (2, 3)
    ]
    linear = form("power of time", "time", [f"t/{_time(span)}"], [share])
    order = np.unique(t)
    ends = (0.5 * (order[1:] + order[:-1]))[:: max(1, len(order) // _MOST_STEPS)]
    steps = [
        form(
            "step", f"from_{number}", [f"step(t > {_time(end)})"], [f"jnp.where(elapsed(where) > {end:.6g}, 1.0, 0.0)"]
        )
        for number, end in enumerate(ends.tolist(), 1)
    ]
    for count in range(1, _PERIODS + 1):
        angle = f"{2 * np.pi * count / span:.6g} * elapsed(where)"
        words = [f"{wave}({count} periods in {_time(span)})" for wave in ("sin", "cos")]
        yield form("period", f"period_{count}", words, [f"jnp.{wave}({angle})" for wave in ("sin", "cos")])
    yield from powers
    yield from (factor.times(*by) for factor in (*decays, *powers, *steps) for by in _each_input())
    yield from (wave.both(factor) for factor in (*decays, linear, *powers[:1]) for wave in waves)
    yield from pulses(where)


def _of_temperature(where: Where, waves: Sequence[Form]) -> Iterator[Form]:
    degc = round(float(np.mean(np.asarray(where.temperature_degc))))
    base = f"(where.temperature_degc - {float(degc)})"

    def form(power: int) -> Form:
        held = {"powers": [0, 0, 0], "degc_power": power, "reference_degc": float(degc)}
        last = f"^{power}" if power > 1 else ""
        return Form(
            "power of temperature", f"temperature_{power}", (f"(T - {degc}){last}",),
            (f"{base} ** {power}" if power > 1 else base,), f"/degC{last}", ("temperature_degc",), held, "temperature",
        )  # fmt: skip

    yield form(3)
    yield from (form(power).times(*by) for power in (2, 3) for by in _each_input())
    yield from (wave.both(form(power))._replace(held=None) for power in (1, 2) for wave in waves)


def pulses(where: Where) -> Iterator[Form]:
    """Terms limited to a time."""
    t = np.unique(np.asarray(elapsed(where), float))
    if len(t) < 4:
        return
    edges = np.concatenate([[t[0] - 1.0], 0.5 * (t[1:] + t[:-1]), [t[-1] + 1.0]])
    edges = edges[:: max(1, len(t) // _MOST_STEPS)]
    number = 0
    for first, begin in enumerate(edges[:-1].tolist()):
        for end in edges[first + 1 :].tolist():
            number += 1
            inside = np.sum((t > begin) & (t < end))
            if 2 <= inside <= len(t) // 2:
                words, middle = f"t {_time(max(begin, 0.0))} to {_time(min(end, t[-1]))}", 0.5 * (begin + end)
                code = f"jnp.where(jnp.abs(elapsed(where) - {middle:.6g}) < {0.5 * (end - begin):.6g}, 1.0, 0.0)"
                yield Form("pulse", f"pulse_{number}", (f"[{words}]",), (code,), needs=("time_s",), against="time")


def _time(seconds: float) -> str:
    return f"{seconds / 3600:.3g} h" if seconds >= 3600 else f"{seconds / 60:.3g} min"


class _Band(NamedTuple):
    words: str
    code: str
    name: str


def _bands(where: Where) -> Iterator[_Band]:
    """Ranges of neighbouring pitch settings, the whole first."""
    yield _Band("", "", "")
    levels = np.unique(np.round(np.asarray(setting_angle(np.asarray(where.beta), np.asarray(where.index("pitch")))), 6))
    edges = np.concatenate([[levels[0] - 0.1], 0.5 * (levels[1:] + levels[:-1]), [levels[-1] + 0.1]])
    degrees = np.degrees(levels)
    for first in range(len(levels)):
        for last in range(first, len(levels)):
            if (first, last) == (0, len(levels) - 1) or (len(levels) > 8 and last - first > 2):
                continue
            middle, half = 0.5 * (edges[first] + edges[last + 1]), 0.5 * (edges[last + 1] - edges[first])
            angles = [f"{angle:.4g}" for angle in degrees[first : last + 1]]
            words = f"beta {' and '.join([', '.join(angles[:-1]), angles[-1]] if len(angles) > 1 else angles)}"
            code = f"jnp.where(jnp.abs(where.beta - {middle:.6g}) < {half:.6g}, 1.0, 0.0)"
            yield _Band(words, code, f"_beta_{first}_{last}")


def boxes(where: Where) -> Iterator[Form]:
    """Terms limited to neighbouring spindle angles, at all or some pitch settings; and to some pitch settings."""
    angles = np.unique(np.round(np.mod(np.asarray(where.alpha), 2 * np.pi), 6))
    following = np.append(angles[1:], angles[0] + 2 * np.pi)
    bands = list(_bands(where))
    yield from (Form("setting", f"at{band.name}", (f"[{band.words}]",), (band.code,)) for band in bands if band.code)
    if len(angles) < 3:
        return
    before = np.roll(angles, 1) - 2 * np.pi * (np.arange(len(angles)) == 0)
    for length in range(1, min(_MOST_ANGLES, len(angles) - 1) + 1):
        for first in range(len(angles)):
            last = (first + length - 1) % len(angles)
            begin = 0.5 * (before[first] + angles[first])
            end = 0.5 * (angles[last] + following[last])
            end += 2 * np.pi * (end < begin)
            cosine = np.cos(0.5 * (end - begin))
            inside = f"jnp.where(jnp.cos(where.alpha - {0.5 * (begin + end):.6g}) > {cosine:.6g}, 1.0, 0.0)"
            words = f"alpha {np.degrees(angles[first]):.4g}" + (
                f" to {np.degrees(angles[last]):.4g}" if length > 1 else ""
            )
            for band in bands:
                said = f"[{', '.join(filter(None, (words, band.words)))}]"
                code = f"{inside} * {band.code}" if band.code else inside
                yield Form("box", f"box_{first}_{last}{band.name}", (said,), (code,))


def _bumps(where: Where) -> Iterator[Form]:
    for number in range(24):
        for wide, width in enumerate(_WIDTHS):
            centre = 15 * number
            bump = f"jnp.exp((jnp.cos(where.alpha - {np.radians(centre):.6g}) - 1.0) / {width**2:.4g})"
            words = f"bump(alpha {centre}, width {np.degrees(width):.0f})"
            for band in _bands(where):
                said = f"{words}{f' [{band.words}]' if band.words else ''}"
                code = f"{bump} * {band.code}" if band.code else bump
                yield Form("bump", f"bump_{centre}_{wide}{band.name}", (said,), (code,))

"""Closed forms of a candidate law, each as the expression in a file for `--effects`.

A form is a factor of one variable or the product of two. Factors: products, steps and knees of inputs; harmonics, windows and
bumps of the spindle angle; windows of the pitch settings; powers, decays, steps, periods and windows of the time; powers of the
temperature. A table of families lists the products.
"""

from collections.abc import Iterator, Sequence
from itertools import combinations_with_replacement, product
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
_THRESHOLDS = np.round(np.arange(-6, 7) * 0.15, 2)
# Centres (deg) and widths (rad) of smooth bumps.
_CENTRES, _WIDTHS = range(0, 360, 15), (0.2, 0.4, 0.8)
# Of neighbouring spindle angles a window has at most so many; of pitch settings any number up to so many, of more so few.
_MOST_ANGLES, _MOST_SETTINGS, _FEW = 8, 8, 3
_WAVES = ("sin", "cos")


class Form(NamedTuple):
    """One closed form: one function, or sine and cosine.

    - `name`: part of an effect's id. `words`, `code`: of each function; Python of `u`, `where` and `elapsed`.
    - `unit`: of the output's coefficient after its mg. `needs`: columns. `against`: the variable on which it depends.
    - `held`: the term in the form of a calibration file, without axis; None: it has no such form.
    """

    name: str
    words: tuple[str, ...]
    code: tuple[str, ...]
    against: str = "alpha"
    unit: str = ""
    needs: tuple[str, ...] = ()
    held: dict[str, Any] | None = None

    @property
    def of_input(self) -> bool:
        """Whether it uses an input, so that no angle depends on it."""
        return "u[" in self.code[0]

    def times(self, other: "Form") -> "Form":
        """Each function of one form times each of another, which is drawn against the variable of the second."""
        return Form(
            f"{other.name}_{self.name}",
            tuple(" ".join(pair) for pair in product(self.words, other.words)),
            tuple(" * ".join(pair) for pair in product(self.code, other.code)),
            other.against,
            self.unit + other.unit,
            other.needs,
            None if self.held is None or other.held is None else other.held | self.held,
        )


def values_of(
    listed: Sequence[Form], where: Where, inputs: Float[np.ndarray, "positions 3"]
) -> Float[np.ndarray, "functions positions"]:
    """All functions at every position, by the same expressions that the file has."""
    time = None if where.time_s is None else np.asarray(elapsed(where), float)
    named = {"jnp": np, "u": inputs.T, "where": where, "elapsed": lambda _: time}
    values = np.empty((sum(len(form.code) for form in listed), len(inputs)))
    for row, code in enumerate(code for form in listed for code in form.code):
        values[row] = eval(code, named)
    return values


def forms(where: Where) -> dict[str, list[Form]]:
    """All forms for data with these columns, by their families."""
    inputs, waves = [_power([k]) for k in range(3)], list(_harmonics(where))
    alphas, settings = _windows_of_alpha(where), _windows_of_settings(where)
    heads = [Form(f"{wave}_beta", (f"{wave}(beta)",), (f"jnp.{wave}(where.beta)",)) for wave in _WAVES]
    steps, knees = zip(*_of_inputs(), strict=True)
    families = {
        "product": [_power(axes) for k in _DEGREES for axes in combinations_with_replacement(range(3), k)],
        "harmonic": waves,
        "harmonic times input": _products(inputs, waves),
        "harmonic of the head": _products(waves, heads),
        "step": list(steps),
        "knee": list(knees),
        "setting": settings,
        "box": [*alphas, *_products(alphas, settings)],
        "bump": [*(bumps := _bumps()), *_products(bumps, settings)],
    }
    if where.time_s is not None and np.ptp(np.asarray(where.time_s)) > 0:
        decays, powers, times, periods = _of_time(where)
        families |= {
            "period": periods,
            "power of time": powers[1:],
            "decay times input": _products(inputs, decays),
            "power of time times input": _products(inputs, powers[1:]),
            "step times input": _products(inputs, times),
            "harmonic times decay": _products(waves[:_IN_TIME], decays),
            "harmonic times power of time": _products(waves[:_IN_TIME], powers[:2]),
            "pulse": pulses(where),
        }
    if where.temperature_degc is not None and np.ptp(np.asarray(where.temperature_degc)) > 0:
        degrees = [_of_temperature(where, power) for power in (1, 2, 3)]
        families |= {
            "power of temperature": degrees[2:],
            "power of temperature times input": _products(inputs, degrees[1:]),
            "harmonic times power of temperature": _products(waves[:_IN_TIME], degrees[:2]),
        }
    return {family: listed for family, listed in families.items() if listed}


def _products(first: Sequence[Form], second: Sequence[Form]) -> list[Form]:
    return [a.times(b) for a, b in product(first, second)]


def _power(axes: Sequence[int]) -> Form:
    """The product of some inputs, one for each axis listed."""
    powers = [axes.count(axis) for axis in range(3)]
    last = {axis: "" if power == 1 else str(power) for axis, power in enumerate(powers) if power}
    letters, degree = "".join(AXES[axis] for axis in axes), len(axes)
    return Form(
        letters if degree == 1 else f"product_{letters}",
        (" ".join(f"u_{AXES[axis]}{power and f'^{power}'}" for axis, power in last.items()),),
        (" * ".join(f"u[{axis}]{power and f' ** {power}'}" for axis, power in last.items()),),
        f"u_{AXES[int(np.argmax(powers))]}",
        "/g" if degree == 1 else f"/g^{degree}",
        held={"powers": powers},
    )


def _harmonics(where: Where) -> Iterator[Form]:
    most = min(_MOST_HARMONICS, len(np.unique(np.round(np.asarray(where.alpha), 6))) // 2)
    for order in range(1, most + 1):
        angle, code = ("alpha", "where.alpha") if order == 1 else (f"{order} alpha", f"{order} * where.alpha")
        words, codes = (f"{wave}({angle})" for wave in _WAVES), (f"jnp.{wave}({code})" for wave in _WAVES)
        yield Form(f"harmonic_{order}", tuple(words), tuple(codes))


def _of_inputs() -> Iterator[tuple[Form, Form]]:
    """Step and knee of each input at each threshold."""
    for axis, (number, least) in product(range(3), enumerate(_THRESHOLDS.tolist())):
        words, code, name = f"u_{AXES[axis]}", f"u[{axis}]", f"{AXES[axis]}_{number}"
        less = f" {'-' if least > 0 else '+'} {abs(least)}" if least else ""
        step, over = f"jnp.where({code} > {least}, 1.0, 0.0)", f"jnp.maximum({code}{less}, 0.0)"
        yield (
            Form(f"step_{name}", (f"step({words} > {least:g})",), (step,), words),
            Form(f"knee_{name}", (f"max({words}{less}, 0)",), (over,), words, "/g"),
        )


def _of_time(where: Where) -> tuple[list[Form], ...]:
    """Decays, powers from the first on, steps and periods."""
    t = np.asarray(elapsed(where), float)
    span = float(f"{np.max(t):.3g}")
    share, whole = f"(elapsed(where) / {span})", _time(span)

    def form(name: str, words: Sequence[str], code: Sequence[str]) -> Form:
        return Form(name, tuple(words), tuple(code), "time", needs=("time_s",))

    taus = [float(f"{share * span:.2g}") for share in _DECAYS]
    ends = _edges(np.unique(t), 0.0)[1:-1][:: max(1, len(np.unique(t)) // _MOST_STEPS)].tolist()
    rates = [f"{2 * np.pi * count / span:.6g}" for count in range(1, _PERIODS + 1)]
    return (
        [form(f"decay_{k}", [f"exp(-t/{_time(tau)})"], [f"jnp.exp(-elapsed(where) / {tau})"])
         for k, tau in enumerate(taus, 1)],
        [form("time", [f"t/{whole}"], [share]),
         *(form(f"time_{power}", [f"(t/{whole})^{power}"], [f"{share} ** {power}"]) for power in (2, 3))],
        [form(f"from_{k}", [f"step(t > {_time(end)})"], [f"jnp.where(elapsed(where) > {end:.6g}, 1.0, 0.0)"])
         for k, end in enumerate(ends, 1)],
        [form(f"period_{k}", [f"{wave}({k} periods in {whole})" for wave in _WAVES],
              [f"jnp.{wave}({rate} * elapsed(where))" for wave in _WAVES]) for k, rate in enumerate(rates, 1)],
    )  # fmt: skip


def _of_temperature(where: Where, power: int) -> Form:
    degc, last = round(float(np.mean(np.asarray(where.temperature_degc)))), f"^{power}" if power > 1 else ""
    base = f"(where.temperature_degc - {float(degc)})"
    return Form(
        f"temperature_{power}",
        (f"(T - {degc}){last}",),
        (f"{base} ** {power}" if power > 1 else base,),
        "temperature",
        f"/degC{last}",
        ("temperature_degc",),
        {"powers": [0, 0, 0], "degc_power": power, "reference_degc": float(degc)},
    )


def _time(seconds: float) -> str:
    return f"{seconds / 3600:.3g} h" if seconds >= 3600 else f"{seconds / 60:.3g} min"


def _edges(levels: Float[np.ndarray, " levels"], beyond: float) -> Float[np.ndarray, " edges"]:
    """The middles between neighbouring levels, and the ends."""
    return np.concatenate([[levels[0] - beyond], 0.5 * (levels[1:] + levels[:-1]), [levels[-1] + beyond]])


def pulses(where: Where) -> list[Form]:
    """Windows of the time with two positions or more, up to half of them."""
    t, listed = np.unique(np.asarray(elapsed(where), float)), []
    edges = _edges(t, 1.0)[:: max(1, len(t) // _MOST_STEPS)].tolist()
    for number, (begin, end) in enumerate(product(edges, edges)):
        if 2 <= np.sum((t > begin) & (t < end)) <= len(t) // 2:
            words, middle = f"t {_time(max(begin, 0.0))} to {_time(min(end, t[-1]))}", 0.5 * (begin + end)
            code = f"jnp.where(jnp.abs(elapsed(where) - {middle:.6g}) < {0.5 * (end - begin):.6g}, 1.0, 0.0)"
            listed.append(Form(f"pulse_{number}", (f"[{words}]",), (code,), "time", needs=("time_s",)))
    return listed


def boxes(where: Where) -> list[Form]:
    """Windows of the angles: neighbouring spindle angles, at all or some pitch settings; and some pitch settings."""
    alphas, settings = _windows_of_alpha(where), _windows_of_settings(where)
    return [*settings, *alphas, *_products(alphas, settings)]


def _windows_of_alpha(where: Where) -> list[Form]:
    angles = np.unique(np.round(np.mod(np.asarray(where.alpha), 2 * np.pi), 6))
    turns = np.concatenate([angles - 2 * np.pi, angles, angles + 2 * np.pi])
    most, count = min(_MOST_ANGLES, len(angles) - 1), len(angles)
    return [] if count < 3 else _windows("alpha", turns, range(count, 2 * count), range(1, most + 1))


def _windows_of_settings(where: Where) -> list[Form]:
    pitch = setting_angle(np.asarray(where.beta), np.asarray(where.index("pitch")))
    levels = np.unique(np.round(np.asarray(pitch), 6))
    most = len(levels) - 1 if len(levels) <= _MOST_SETTINGS else _FEW
    return _windows("beta", levels, range(len(levels)), range(1, most + 1))


def _windows(name: str, levels: Float[np.ndarray, " levels"], begins: range, sizes: range) -> list[Form]:
    """So many neighbouring levels of an angle, from some of them on, as far as there are levels."""
    edges, listed = _edges(levels, 0.1), []
    for first, size in product(begins, sizes):
        if first + size <= len(levels):
            begin, end = edges[first], edges[first + size]
            inside = [f"{degrees - 360 * (degrees >= 360):.4g}" for degrees in np.degrees(levels[first : first + size])]
            words = f"{name} {inside[0]}" + (f" to {inside[-1]}" if size > 1 else "")
            middle, least = f"{0.5 * (begin + end):.6g}", f"{np.cos(0.5 * (end - begin)):.6g}"
            code = f"jnp.where(jnp.cos(where.{name} - {middle}) > {least}, 1.0, 0.0)"
            listed.append(Form(f"{name}_{first % len(begins)}_{size}", (f"[{words}]",), (code,)))
    return listed


def _bumps() -> list[Form]:
    """Smooth bumps at some spindle angles."""
    return [
        Form(
            f"bump_{centre}_{number}",
            (f"bump(alpha {centre}, width {np.degrees(width):.0f})",),
            (f"jnp.exp((jnp.cos(where.alpha - {np.radians(centre):.6g}) - 1.0) / {width**2:.4g})",),
        )
        for centre, (number, width) in product(_CENTRES, enumerate(_WIDTHS))
    ]

"""Closed forms of a candidate law, each as the expression in a file for `--effects`.

A form is a factor of one variable or the product of two. Factors: products, steps and knees of inputs; harmonics, windows and
bumps of the spindle angle; windows of the pitch settings; powers, decays, steps, periods and windows of the time; powers of the
temperature. Each kind of factor is a form with the places of its parameters, filled in for every value of these; a table of
families lists the products.
"""

from collections.abc import Iterable, Mapping, Sequence
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

    def filled(self, parameters: Iterable[Mapping[str, Any]]) -> "list[Form]":
        """The forms with the parameters, by name, in their places; `held` is one of them."""
        return [
            Form(
                self.name.format_map(own),
                tuple([words.format_map(own) for words in self.words]),
                tuple([code.format_map(own) for code in self.code]),
                self.against.format_map(own),
                self.unit.format_map(own),
                self.needs,
                own.get("held"),
            )
            for own in parameters
        ]


# The kinds of factors, with the places of their parameters.
_POWER = Form("{name}", ("{words}",), ("{code}",), "u_{axis}", "/g{power}")
_HARMONIC = Form(
    "harmonic_{k}",
    ("sin({times}alpha)", "cos({times}alpha)"),
    ("jnp.sin({k} * where.alpha)", "jnp.cos({k} * where.alpha)"),
)
_OF_HEAD = Form("{wave}_beta", ("{wave}(beta)",), ("jnp.{wave}(where.beta)",))
_STEP = Form(
    "step_{axis}_{k}", ("step(u_{axis} > {least:g})",), ("jnp.where(u[{number}] > {least}, 1.0, 0.0)",), "u_{axis}"
)
_KNEE = Form("knee_{axis}_{k}", ("max(u_{axis}{less}, 0)",), ("jnp.maximum(u[{number}]{less}, 0.0)",), "u_{axis}", "/g")
_WINDOW = Form(
    "{angle}_{first}_{size}",
    ("[{angle} {levels}]",),
    ("jnp.where(jnp.cos(where.{angle} - {middle:.6g}) > {least:.6g}, 1.0, 0.0)",),
)
_BUMP = Form(
    "bump_{centre}_{k}",
    ("bump(alpha {centre}, width {degrees:.0f})",),
    ("jnp.exp((jnp.cos(where.alpha - {middle:.6g}) - 1.0) / {square:.4g})",),
)
_OF_TIME = Form("", (), (), "time", needs=("time_s",))
_DECAY = _OF_TIME._replace(name="decay_{k}", words=("exp(-t/{words})",), code=("jnp.exp(-elapsed(where) / {tau})",))
_TIME_POWER = _OF_TIME._replace(name="time{end}", words=("{words}",), code=("(elapsed(where) / {span}) ** {k}",))
_FROM = _OF_TIME._replace(
    name="from_{k}", words=("step(t > {words})",), code=("jnp.where(elapsed(where) > {end:.6g}, 1.0, 0.0)",)
)
_PERIOD = _OF_TIME._replace(
    name="period_{k}",
    words=("sin({k} periods in {whole})", "cos({k} periods in {whole})"),
    code=("jnp.sin({rate:.6g} * elapsed(where))", "jnp.cos({rate:.6g} * elapsed(where))"),
)
_PULSE = _OF_TIME._replace(
    name="pulse_{k}",
    words=("[t {begin} to {end}]",),
    code=("jnp.where(jnp.abs(elapsed(where) - {middle:.6g}) < {half:.6g}, 1.0, 0.0)",),
)
_TEMPERATURE = Form(
    "temperature_{k}",
    ("(T - {reference:.0f}){power}",),
    ("(where.temperature_degc - {reference}) ** {k}",),
    "temperature",
    "/degC{power}",
    ("temperature_degc",),
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
    inputs, settings, alphas = _powers(1), _windows_of_settings(where), _windows_of_alpha(where)
    most = min(_MOST_HARMONICS, len(np.unique(np.round(np.asarray(where.alpha), 6))) // 2)
    waves = _HARMONIC.filled({"k": k, "times": "" if k == 1 else f"{k} "} for k in range(1, most + 1))
    thresholds = [
        {
            "axis": AXES[number],
            "number": number,
            "k": k,
            "least": least,
            "less": f" {'-' if least > 0 else '+'} {abs(least)}" if least else "",
        }
        for number, (k, least) in product(range(3), enumerate(_THRESHOLDS.tolist()))
    ]
    bumps = _BUMP.filled(
        {"centre": own, "k": k, "degrees": np.degrees(width), "middle": np.radians(own), "square": width**2}
        for own, (k, width) in product(_CENTRES, enumerate(_WIDTHS))
    )
    families = {
        "product": [form for degree in _DEGREES for form in _powers(degree)],
        "harmonic": waves,
        "harmonic times input": _products(inputs, waves),
        "harmonic of the head": _products(waves, _OF_HEAD.filled({"wave": wave} for wave in ("sin", "cos"))),
        "step": _STEP.filled(thresholds),
        "knee": _KNEE.filled(thresholds),
        "setting": settings,
        "box": [*alphas, *_products(alphas, settings)],
        "bump": [*bumps, *_products(bumps, settings)],
    }
    if where.time_s is not None and np.ptp(np.asarray(where.time_s)) > 0:
        families |= _of_time(where, inputs, waves[:_IN_TIME])
    if where.temperature_degc is not None and np.ptp(degc := np.asarray(where.temperature_degc)) > 0:
        reference = float(round(float(np.mean(degc))))
        degrees = _TEMPERATURE.filled(
            {
                "k": k,
                "reference": reference,
                "power": f"^{k}" if k > 1 else "",
                "held": {"powers": [0, 0, 0], "degc_power": k, "reference_degc": reference},
            }
            for k in (1, 2, 3)
        )
        families |= {
            "power of temperature": degrees[2:],
            "power of temperature times input": _products(inputs, degrees[1:]),
            "harmonic times power of temperature": _products(waves[:_IN_TIME], degrees[:2]),
        }
    return {family: listed for family, listed in families.items() if listed}


def _products(first: Sequence[Form], second: Sequence[Form]) -> list[Form]:
    return [a.times(b) for a, b in product(first, second)]


def _powers(degree: int) -> list[Form]:
    """The products of so many inputs."""
    listed = []
    for axes in combinations_with_replacement(range(3), degree):
        powers = [axes.count(axis) for axis in range(3)]
        letters, own = "".join(AXES[axis] for axis in axes), [k for k in range(3) if powers[k]]
        listed.append({
            "name": letters if degree == 1 else f"product_{letters}",
            "words": " ".join(f"u_{AXES[k]}^{powers[k]}" for k in own).replace("^1", ""),
            "code": " * ".join(f"u[{k}] ** {powers[k]}" for k in own).replace(" ** 1", ""),
            "axis": AXES[int(np.argmax(powers))],
            "power": "" if degree == 1 else f"^{degree}",
            "held": {"powers": powers},
        })  # fmt: skip
    return _POWER.filled(listed)


def _of_time(where: Where, inputs: Sequence[Form], waves: Sequence[Form]) -> dict[str, list[Form]]:
    """The families with the time."""
    t = np.unique(np.asarray(elapsed(where), float))
    span = float(f"{np.max(t):.3g}")
    whole, taus = _time(span), [float(f"{share * span:.2g}") for share in _DECAYS]
    decays = _DECAY.filled({"k": k, "tau": tau, "words": _time(tau)} for k, tau in enumerate(taus, 1))
    names = (("", f"t/{whole}"), ("_2", f"(t/{whole})^2"), ("_3", f"(t/{whole})^3"))
    powers = _TIME_POWER.filled(
        {"k": k, "span": span, "end": end, "words": words} for k, (end, words) in enumerate(names, 1)
    )
    ends = _edges(t, 0.0)[1:-1][:: max(1, len(t) // _MOST_STEPS)].tolist()
    steps = _FROM.filled({"k": k, "end": end, "words": _time(end)} for k, end in enumerate(ends, 1))
    rates = ({"k": k, "whole": whole, "rate": 2 * np.pi * k / span} for k in range(1, _PERIODS + 1))
    return {
        "period": _PERIOD.filled(rates),
        "power of time": powers[1:],
        "decay times input": _products(inputs, decays),
        "power of time times input": _products(inputs, powers[1:]),
        "step times input": _products(inputs, steps),
        "harmonic times decay": _products(waves, decays),
        "harmonic times power of time": _products(waves, powers[:2]),
        "pulse": pulses(where),
    }


def _time(seconds: float) -> str:
    return f"{seconds / 3600:.3g} h" if seconds >= 3600 else f"{seconds / 60:.3g} min"


def _edges(levels: Float[np.ndarray, " levels"], beyond: float) -> Float[np.ndarray, " edges"]:
    """The middles between neighbouring levels, and the ends."""
    return np.concatenate([[levels[0] - beyond], 0.5 * (levels[1:] + levels[:-1]), [levels[-1] + beyond]])


def pulses(where: Where) -> list[Form]:
    """Windows of the time with two positions or more, up to half of them."""
    t = np.unique(np.asarray(elapsed(where), float))
    edges = _edges(t, 1.0)[:: max(1, len(t) // _MOST_STEPS)].tolist()
    return _PULSE.filled(
        {
            "k": k,
            "begin": _time(max(begin, 0.0)),
            "end": _time(min(end, t[-1])),
            "middle": 0.5 * (begin + end),
            "half": 0.5 * (end - begin),
        }
        for k, (begin, end) in enumerate(product(edges, edges))
        if 2 <= np.sum((t > begin) & (t < end)) <= len(t) // 2
    )


def boxes(where: Where) -> list[Form]:
    """Windows of the angles: neighbouring spindle angles, at all or some pitch settings; and some pitch settings."""
    alphas, settings = _windows_of_alpha(where), _windows_of_settings(where)
    return [*settings, *alphas, *_products(alphas, settings)]


def _windows_of_alpha(where: Where) -> list[Form]:
    angles = np.unique(np.round(np.mod(np.asarray(where.alpha), 2 * np.pi), 6))
    turns, count = np.concatenate([angles - 2 * np.pi, angles, angles + 2 * np.pi]), len(angles)
    return [] if count < 3 else _windows("alpha", turns, range(count, 2 * count), min(_MOST_ANGLES, count - 1))


def _windows_of_settings(where: Where) -> list[Form]:
    pitch = setting_angle(np.asarray(where.beta), np.asarray(where.index("pitch")))
    levels = np.unique(np.round(np.asarray(pitch), 6))
    return _windows("beta", levels, range(len(levels)), len(levels) - 1 if len(levels) <= _MOST_SETTINGS else _FEW)


def _windows(angle: str, levels: Float[np.ndarray, " levels"], begins: range, most: int) -> list[Form]:
    """Up to so many neighbouring levels of an angle, from some of them on, as far as there are levels."""
    edges, degrees, listed = _edges(levels, 0.1), np.degrees(levels), []
    degrees = [f"{own - 360 * (own >= 360):.4g}" for own in degrees.tolist()]
    for first, size in product(begins, range(1, most + 1)):
        if first + size <= len(levels):
            begin, end = edges[first], edges[first + size]
            listed.append({
                "angle": angle,
                "first": first % len(begins),
                "size": size,
                "levels": degrees[first] + (f" to {degrees[first + size - 1]}" if size > 1 else ""),
                "middle": 0.5 * (begin + end),
                "least": np.cos(0.5 * (end - begin)),
            })  # fmt: skip
    return _WINDOW.filled(listed)

"""Units by name, with dimensions: `factor("mg/g^2")`, `quantity("3 arcmin", "rad")`.

Base units are rad, g, s, degC and their products. Here one g is 9.80665 m/s^2; a file in m/s^2 from a site with a
different gravity states that value (`# gravity_ms2: 9.8123`).
"""

import math
import re
from functools import lru_cache

from tumblecal.ground.decimal_marks import without_decimal_comma
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2


Dimensions = tuple[int, int, int, int]  # exponents of rad, m, s, degC

_NONE: Dimensions = (0, 0, 0, 0)
_ANGLE: Dimensions = (1, 0, 0, 0)
_ACCELERATION: Dimensions = (0, 1, -2, 0)
_TIME: Dimensions = (0, 0, 1, 0)
_TEMPERATURE: Dimensions = (0, 0, 0, 1)

ATOMS: dict[str, tuple[float, Dimensions]] = {
    "1": (1.0, _NONE),
    "1e-3": (1e-3, _NONE),
    "%": (1e-2, _NONE),
    "ppm": (1e-6, _NONE),
    "rad": (1.0, _ANGLE),
    "mrad": (1e-3, _ANGLE),
    "urad": (1e-6, _ANGLE),
    "deg": (math.pi / 180, _ANGLE),
    "arcmin": (math.pi / 10800, _ANGLE),
    "arcsec": (math.pi / 648000, _ANGLE),
    "g": (STANDARD_GRAVITY_MS2, _ACCELERATION),
    "mg": (1e-3 * STANDARD_GRAVITY_MS2, _ACCELERATION),
    "ug": (1e-6 * STANDARD_GRAVITY_MS2, _ACCELERATION),
    "m": (1.0, (0, 1, 0, 0)),
    "s": (1.0, _TIME),
    "min": (60.0, _TIME),
    "h": (3600.0, _TIME),
    "Hz": (1.0, (0, 0, -1, 0)),
    "degC": (1.0, _TEMPERATURE),
    "K": (1.0, _TEMPERATURE),
}


def _parse(unit: str) -> tuple[float, Dimensions]:
    """SI factor and dimensions of a unit such as `mg`, `mg/g^2`, `(mg/g)/h`, `m/s^2`."""
    factor, dimensions = 1.0, [0, 0, 0, 0]
    for place, term in enumerate(re.sub(r"[()\s]", "", unit).split("/")):
        name, _, power_text = term.partition("^")
        if name not in ATOMS or not re.fullmatch(r"\d?", power_text):
            known = ", ".join(name for name in ATOMS if name != "1")
            raise InputError(f"unknown unit {unit!r}; units are products of {known} with / and ^")
        power = int(power_text or 1) * (1 if place == 0 else -1)
        factor *= ATOMS[name][0] ** power
        dimensions = [total + power * part for total, part in zip(dimensions, ATOMS[name][1], strict=True)]
    return factor, (dimensions[0], dimensions[1], dimensions[2], dimensions[3])


@lru_cache(maxsize=512)
@lru_cache(maxsize=1024)
def factor(unit: str, target: str) -> float:
    """The number of `target` units in one `unit`: `factor("mg", "g") == 1e-3`.

    **Raises:** `InputError` for an unknown unit or a different dimension.
    """
    (given, given_dimensions), (wanted, wanted_dimensions) = _parse(unit), _parse(target)
    if given_dimensions != wanted_dimensions:
        raise InputError(f"{unit!r} cannot be converted to {target!r}: their dimensions differ")
    if unit.replace(" ", "") == target:
        return 1.0
    ratio = given / wanted
    # 9.80665 cancels except for rounding: return the exact power of ten if there is one.
    power = round(math.log10(ratio))
    return 10.0**power if math.isclose(ratio, 10.0**power, rel_tol=1e-14) else ratio


@lru_cache(maxsize=1024)
def converts(unit: str, target: str) -> bool:
    """Whether two units have the same dimension."""
    return _parse(unit)[1] == _parse(target)[1]


def quantity(text: str, target: str, *, bare: bool = True) -> float:
    """The number in a text such as `0.1mg` or `3 arcmin`, in `target` units.

    **Arguments:**

    - `bare`: whether a number without a unit is accepted if `target` is "1".

    **Raises:** `InputError` unless it is a finite number followed by a unit of that dimension.

    **Example:** `quantity("3 arcmin", "rad")`
    """
    if text != (plain := without_decimal_comma(text)):
        raise InputError(f"{text!r} has a decimal comma; write {plain!r}")
    match = re.fullmatch(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S*)\s*", text)
    if match is None:
        raise InputError(f"{text!r} is not a number with a unit, such as '1 {_example(target)}'")
    number, unit = float(match[1]), match[2]
    if not unit and target != "1":
        raise InputError(f"{text!r} has no unit; write for example '{match[1]} {_example(target)}'")
    if not unit and not bare:
        raise InputError(
            f"{text!r} has no unit; write for example '{match[1]} ppm' or '{match[1]} %', and '{match[1]} 1' for the number "
            "itself"
        )
    value = number * factor(unit or "1", target)
    if not math.isfinite(value):
        raise InputError(f"{text!r} is not finite")
    return value


def _example(unit: str) -> str:
    """The usual unit of a quantity with this base unit, for an example."""
    return {"1": "ppm", "s": "s"}.get(unit) or SHOWN.get(unit, unit)


# Limits for the precision of weighted sums of squares, far outside those of instruments.
SMALLEST_SD_G, LARGEST_SD_G = 1e-12, 1e6
# Larger readings are not measurements, and would overflow the sums of squares.
LARGEST_READING_G = 1e6
SD_RANGE = "a standard deviation must be above 0 (1e-12 to 1e6 g)"


def reading_sd(text: str, *, none: bool = False) -> float:
    """The standard deviation of a reading in a text such as `0.1 mg`, g; `none`: whether 0 is accepted.

    **Raises:** `InputError` as `quantity`, and for one beyond `SMALLEST_SD_G` to `LARGEST_SD_G`.
    """
    value = quantity(text, "g")
    if value == 0 and none:
        return 0.0
    if not SMALLEST_SD_G <= value <= LARGEST_SD_G:
        raise InputError(f"{text!r}: {SD_RANGE}")
    return value


# Display unit of each base unit.
SHOWN = {
    "rad": "mrad",
    "g": "mg",
    "1": "1e-3",
    "rad/rad": "mrad/rad",
    "rad/g": "mrad/g",
    "g/g^2": "mg/g^2",
    "g/g^3": "mg/g^3",
    "g/g": "mg/g",
    "g/s": "mg/h",
    "1/s": "(mg/g)/h",
    "g/degC": "mg/degC",
    "1/degC": "(mg/g)/degC",
    **{f"{unit}/degC^{power}": f"u{unit}/degC^{power}" for unit in ("g", "rad") for power in range(2, 6)},
    **{f"1/degC^{power}": f"ppm/degC^{power}" for power in range(2, 6)},
    "rad/degC": "mrad/degC",
    "s": "min",
}


def shown(unit: str) -> tuple[str, float]:
    """The display unit of values in `unit`, and the factor to it."""
    display = SHOWN.get(unit, unit)
    return display, factor(unit, display)


def in_words(value: float | str, unit: str) -> str:
    """A number with its unit for a sentence: `0.2 mg/g^2`; the unit 1e-3 is written as a power: `0.3e-3`."""
    number = value if isinstance(value, str) else f"{value:g}"
    return f"{number}e-3" if unit == "1e-3" else f"{number} {unit}"

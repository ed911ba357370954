"""Local gravity: the value of one g in a file, and the normal-gravity formula of the GRS 80 ellipsoid.

Readings are in units of local gravity. A file states it in `# gravity_ms2: 9.8123` and `# gravity_source: ...`.
Somigliana's closed formula on the ellipsoid and the second-order free-air reduction: Moritz, Geodetic Reference
System 1980.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from tumblecal.ground.decimal_marks import has_decimal_comma, pointed, without_decimal_comma
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import shown


STANDARD_GRAVITY_MS2 = 9.80665
# Units of accelerations in use, for one standard g.
UNITS_PER_G = {"g": 1.0, "mg": 1000.0, "m/s2": STANDARD_GRAVITY_MS2} | {
    f"LSB {counts}/g": float(counts) for counts in (2048, 4096, 8192, 16384, 256)
}
# Gravity on the ground is between 9.76 and 9.84 m/s^2; the limits include mines and aircraft.
LEAST_MS2, MOST_MS2 = 9.7, 9.9
# Largest difference between two values for one site.
SAME_MS2 = 5e-4
UNITS = ("g", "mg", "ms2")
VALUE_KEY, SOURCE_KEY = "gravity_ms2", "gravity_source"
ASSUMED = "standard gravity, none stated"

_EQUATOR_MS2 = 9.7803267715
_K = 0.001931851353
_E2 = 0.00669438002290
_A_M = 6378137.0
_F = 0.00335281068118
_M = 0.00344978600308


@dataclass(frozen=True)
class Gravity:
    """One g: its value in m/s^2, and the source of the value."""

    value_ms2: float
    source: str

    def in_g_of(self, other: "Gravity") -> float:
        """One g of this site in g of another site."""
        return self.value_ms2 / other.value_ms2

    @property
    def assumed(self) -> bool:
        """Whether it was assumed, not stated."""
        return self.source.startswith("standard gravity")

    def __str__(self) -> str:
        value = f"{self.value_ms2:.6g} m/s^2"
        return f"{value}, {self.source}" if "(" in self.source else f"{value} ({self.source})"


STANDARD = Gravity(STANDARD_GRAVITY_MS2, ASSUMED)


def stated_gravity(comments: Mapping[str, str], file: str) -> Gravity | None:
    """The gravity in the comments (or Parquet metadata) of a file; None without one.

    **Arguments:**

    - `comments`: the `key: value` lines of the file.
    - `file`: its name in messages.

    **Raises:** `InputError` for an invalid value.
    """
    text = comments.get(VALUE_KEY)
    if text is None:
        return None
    try:
        value = float(text)
    except ValueError:
        if has_decimal_comma(text):
            raise InputError(
                f"{file}: comment {VALUE_KEY}: {shown(text)} has a decimal comma; write {pointed(text)}"
            ) from None
        value = math.nan
    return checked_gravity(value, comments.get(SOURCE_KEY) or "stated", f"{file}: comment {VALUE_KEY}", text)


def checked_gravity(value_ms2: float, source: str, named: str, text: str | None = None) -> Gravity:
    """A gravity in m/s^2.

    **Raises:** `InputError`, with `named` first, for a value that does not occur on Earth; `text`: as written.
    """
    if not LEAST_MS2 < value_ms2 < MOST_MS2:
        raise InputError(f"{named}: {shown(text or value_ms2)} is not a gravity in m/s^2 (9.78 to 9.84)")
    return Gravity(value_ms2, source)


def gravity_of_option(text: str) -> Gravity:
    """The gravity of `--gravity`: a value in m/s^2 (`9.8123`), or a site (`lat=48.14` or `lat=48.14,height=520`: degrees,
    metres) with its normal gravity.

    **Raises:** `InputError` for a text that is neither.
    """
    named, numbers = f"--gravity {text}", dict[str, float]()
    if text != (plain := without_decimal_comma(text)):
        raise InputError(f"{named}: has a decimal comma; write --gravity {plain}")
    try:
        for part in text.replace(" ", "").split(","):
            key, _, value = part.rpartition("=")
            numbers[key] = float(value)
    except ValueError:
        numbers = {}
    if set(numbers) == {""}:
        return checked_gravity(numbers[""], "stated on the command line", named)
    latitude, height = numbers.get("lat", math.nan), numbers.get("height", 0.0)
    if not set(numbers) <= {"lat", "height"} or not (abs(latitude) <= 90 and -500 < height < 9000):
        raise InputError(
            f"{named}: write m/s^2, such as 9.8123, or a site, such as lat=48.14,height=520 (degrees, metres)"
        )
    source = f"normal gravity at latitude {latitude:g} deg, height {height:g} m"
    return checked_gravity(normal_gravity(latitude, height), source, named)


def record_of(gravity: Gravity | None) -> dict[str, Any]:
    """The record in a JSON file."""
    if gravity is None:
        return {"value_ms2": None, "source": "not stated: the readings were in g"}
    return {"value_ms2": gravity.value_ms2, "source": gravity.source}


def comments_of(gravity: Gravity) -> dict[str, str]:
    """The comments that state this gravity in a file."""
    return {VALUE_KEY: repr(gravity.value_ms2), SOURCE_KEY: gravity.source}


def unit_in_g(unit: str, gravity: Gravity | None) -> float:
    """One `g`, `mg` or `ms2` (m/s^2) in g; standard gravity if none is stated."""
    return {"g": 1.0, "mg": 1e-3, "ms2": 1.0 / (gravity or STANDARD).value_ms2}[unit]


def normal_gravity(latitude_deg: float, height_m: float = 0.0) -> float:
    """Gravity in m/s^2.

    **Arguments:**

    - `latitude_deg`: geodetic latitude.
    - `height_m`: height above the ellipsoid; height above sea level differs by tens of metres, 3e-6 m/s^2 per metre.
    """
    s2 = math.sin(math.radians(latitude_deg)) ** 2
    surface = _EQUATOR_MS2 * (1 + _K * s2) / math.sqrt(1 - _E2 * s2)
    ratio = height_m / _A_M
    return surface * (1 - 2 * (1 + _F + _M - 2 * _F * s2) * ratio + 3 * ratio**2)

"""Which quantity a column's name says, and in which unit."""

import re

from tumblecal.capture.protocols.text_layout import names_of
from tumblecal.capture.recordings.table import SourceTable
from tumblecal.capture.recordings.time_or_temperature import EITHER
from tumblecal.capture.recordings.units import FORCE, RATE, TIME_S


LABELS = ("position", "run", "mount")
NUMBERS = ("alpha_deg", "beta_deg", "approach")
QUANTITIES = (*FORCE, *RATE, "time", "temperature", *LABELS, *NUMBERS)
_WORDS = {
    r"[\[(]?(m_?/?s(\^|\*\*)?2|m/s²|mps2|m_s-2)[\])]?": "ms2",
    r"[\[(]?(rad(ians)?(_?/?s(ec)?)?|rps)[\])]?": "rads",
    r"[\[(]?(dps|deg(rees)?_?/?s(ec)?|°/s)[\])]?": "dps",
    r"[\[(]?(raw|lsb|counts?|adc)[\])]?": "counts",
    r"[\[(]mg[\])]|mg": "mg",
    r"[\[(]g[\])]": "g",
}
_NAMES = {
    r"linear[ _.]?acc\w*|accelerometer|acceleration": "acc",
    r"angular[ _.]?(velocity|rate)|gyroscope|omega": "gyr",
    r"[\[(]0[\])]": "_x",
    r"[\[(]1[\])]": "_y",
    r"[\[(]2[\])]": "_z",
}
# Without a unit they may be anything: phones write their own attitude so.
_ANGLE = re.compile(r"(alpha|beta)_?[\[(]_?(?:deg|degrees?|°)_?[\])]")
_CLOCK = re.compile(
    r"(?:time|timestamp|zeit|elapsed(?:_time)?|header_stamp|t(?=.))_?(?:[\[(]?(s|ms|us|µs|ns|secs?|seconds)[\])]?)?"
)
_CLOCK_UNITS = {"sec": "s", "secs": "s", "seconds": "s", "µs": "us"}
_CELSIUS = re.compile("°?_?c|deg_?c|celsius")
_WARMTH = re.compile(r"(?:t|tmp|temp|temperature?|temperatur)(?:_?[\[(]_?(.+?)[\])]|_(°?c|deg_?c|celsius))")


def named_quantity(table: SourceTable, name: str) -> tuple[str | None, str]:
    """Quantity and unit of a column, by the format's own rules or by its name; None where it says none."""
    return quantity_of(table.roles.get(name) or _cleaned(name))


def quantity_of_name(name: str) -> str | None:
    """The quantity that a name says by itself; None where it says none."""
    return quantity_of(_cleaned(name))[0]


def same_kind(one: str | None, other: str | None) -> bool:
    """Whether two quantities are measured in the same units."""
    return one == other or any(one in kind and other in kind for kind in (FORCE, RATE))


def _cleaned(name: str) -> str:
    """A column's name as `names_of` knows it, its unit put behind."""
    text, unit = name.strip().lower(), ""
    for pattern, own in _WORDS.items():
        shorter = re.sub(rf"(?:^|[ _.])?(?<![a-z])(?:{pattern})(?![a-z])", "", text)
        if shorter != text and shorter:
            text, unit = shorter, own
            break
    for pattern, own in _NAMES.items():
        text = re.sub(pattern, own, text)
    text = re.sub(r"[ _.]+", "_", text).strip("_")
    match = re.fullmatch(r"([ag][xyz]|time|temperature)_(g|mg|ms2|dps|rads|counts|raw|s|ms|us|ns|degc)", text)
    if match:
        return text
    if text in ("sample", "samples", "n_samples", "index", ""):
        return ""
    if text in (*LABELS, *NUMBERS):
        return text
    if text == "t":
        return name.strip()
    angle = _ANGLE.fullmatch(text)
    if angle:
        return f"{angle[1]}_deg"
    clock = _CLOCK.fullmatch(text)
    if clock:
        return "time" + (f"_{_CLOCK_UNITS.get(clock[1], clock[1])}" if clock[1] else "")
    warmth = _WARMTH.fullmatch(text)
    if warmth:
        return "temperature_degc" if _CELSIUS.fullmatch(warmth[1] or warmth[2]) else ""
    role = names_of([text])[0]
    quantity = {"t": "temperature", "-": "", "counter": ""}.get(role, role)
    return f"{quantity}_{unit}" if quantity and unit else quantity


def quantity_of(text: str) -> tuple[str | None, str]:
    """Quantity and unit of `ax_ms2`, `time`, `temperature_degc` ...; None for what is none."""
    if text in (*QUANTITIES, *EITHER):
        return text, ""
    quantity, _, unit = text.rpartition("_")
    quantity = {"t": "temperature"}.get(quantity, quantity)
    units = (
        ("g", "mg", "ms2", "counts") if quantity in FORCE else
        ("dps", "rads", "counts", "raw") if quantity in RATE else
        tuple(TIME_S) if quantity == "time" else
        ("degc",) if quantity == "temperature" else ()
    )  # fmt: skip
    return (quantity, unit) if unit in units else (None, "")

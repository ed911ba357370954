"""Quantity, axis, unit and processing state of a column, from the words of its name in any order."""

import re
from dataclasses import dataclass
from functools import lru_cache

from tumblecal.capture.columns.column_words import LETTERS, WORDS, meanings, plain_letters, split, unit_of
from tumblecal.capture.columns.units import FORCE, RATE, TIME_S


# The time or the temperature.
EITHER = ("t", "T")
CLOCKS = frozenset(("time", "temperature", *EITHER))
LABELS = ("position", "run", "mount")
NUMBERS = ("alpha_deg", "beta_deg", "approach")
QUANTITIES = (*FORCE, *RATE, "time", "temperature", *LABELS, *NUMBERS)
_QUANTITIES = ("acceleration", "rate", "field", "orientation", "gravity", "velocity", "place")
# States of accelerations that are not those of the sensor with gravity.
WITHOUT_GRAVITY = frozenset(("linear", "free", "world"))
_STATES = ("linear", "free", "world", "raw", "processed")
_UNITS_OF = {
    "acceleration": ("g", "mg", "ms2", "counts"),
    "rate": ("dps", "rads", "counts", "raw"),
    "time": tuple(TIME_S),
    "temperature": ("degc",),
}
_BRACKETS = re.compile(r"\[([^\]]*)\]|\(((?:[^()]|\([^()]*\))*)\)")
_SEPARATORS = re.compile(r"[\s_./:,|#%>@\\\-]+")
_PARTS = re.compile(r"\d+|[^\W\d_]+")
_CAMEL = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|[^\W\dA-Za-z_]+")
# Without a unit they are ambiguous: phones write their attitude with these names.
_ANGLE = re.compile(r"(alpha|beta)[ _]?[\[(]\s*(?:deg|degrees?|°)\s*[\])]")
_MOST_UNIT_WORDS = 4


@dataclass(frozen=True)
class ColumnName:
    """Meaning of a name.

    **Arguments:**

    - `quantity`: one of `_QUANTITIES`, time, temperature, `other` (none of these), `letter` (g or f alone, which may be
      a rate, gravity or a force); empty if unknown.
    - `axis`: x, y, z, or a digit; empty for none. `unit`: as in `_UNITS_OF`; empty for none of these.
    - `states`: of `_STATES`. `stem`: all words but the axis and the unit; `sensor`: those without the states.
    - `foreign`: number of words that do not concern the quantity.
    """

    quantity: str = ""
    axis: str = ""
    unit: str = ""
    states: frozenset[str] = frozenset()
    stem: tuple[str, ...] = ()
    sensor: tuple[str, ...] = ()
    foreign: int = 0


@lru_cache(maxsize=4096)
def parsed(name: str) -> ColumnName:
    """Meaning of a name, from its words in any order and case, between any separators."""
    words, units = _words(name)
    unit = next(filter(None, map(unit_of, units)), None)
    if unit is None:
        words, unit = _trailing_unit(words)
    axis = next((word for word in words if word in ("x", "y", "z")), "")
    if not axis and len(words) > 1 and words[-1].isdecimal() and len(words[-1]) == 1:
        axis = words[-1]
    rest = list(words)
    if axis:
        rest.pop(len(rest) - 1 - rest[::-1].index(axis))
    kinds = [kind for word in rest for kind in _kinds(word, rest, axis)]
    if {"g", "force"} <= set(rest):
        kinds, unit = ["acceleration"], unit or ("acceleration", "g")
    if {"specific", "force"} <= set(rest):
        kinds = ["acceleration"]
    quantity, states = _quantity(kinds, unit, axis)
    states = states | {
        kind for kind in kinds if kind in _STATES and not (kind == "linear" and quantity != "acceleration")
    }
    stem = tuple(rest)
    its_unit = unit[1] if unit and (unit[0] == quantity or unit[0] == "counts") else ""
    its_unit = its_unit or ("g" if quantity == "acceleration" and {"gf", "gforce"} & set(rest) else "")
    # A unit alone names no quantity, except a time.
    its_unit = its_unit or (clock[1] if rest and (clock := unit_of(rest[-1])) and clock[0] == "time" else "")
    its_unit = its_unit if its_unit in _UNITS_OF.get(quantity, ()) else ""
    sensor = tuple(word for word in stem if WORDS.get(word) not in _STATES)
    foreign = sum(not set(meanings(word)) & {quantity, "plain"} for word in rest)
    if quantity == "temperature" and unit and unit[0] == "temperature" and not its_unit:
        quantity = "other"
    return ColumnName(quantity, axis, its_unit, frozenset(states), stem, sensor, foreign)


def _words(name: str) -> tuple[list[str], list[str]]:
    """The words of a name in lower case, including an index in brackets, and the contents of its other brackets."""
    units, words = list[str](), list[str]()
    text = plain_letters(name)

    def replaced(match: re.Match) -> str:
        content = (match[1] if match[1] is not None else match[2]).strip()
        if unit_of(content) is not None:
            units.append(content)
            return " "
        return f" {content} "

    text = _BRACKETS.sub(replaced, text)
    for chunk in filter(None, _SEPARATORS.split(text)):
        for part in _PARTS.findall(chunk):
            whole = [part] if part.isdecimal() else split(part.lower())
            if whole is None:
                whole = [
                    word
                    for letters in _CAMEL.findall(part)
                    for word in (split(letters.lower()) or _letter(letters.lower()))
                ]
            words += whole
    return words, units


def _letter(word: str) -> list[str]:
    """`ax` as letter and axis; any other word unchanged."""
    if len(word) == 2:
        for letter, axis in (word, word[::-1]):
            if letter in LETTERS and axis in "xyz":
                return [letter, axis]
    return [word]


def _trailing_unit(words: list[str]) -> tuple[list[str], tuple[str, str] | None]:
    """A unit without brackets, at the end or before the index; none if it is the only word."""
    for end in (len(words), len(words) - 1):
        for start in range(max(1, end - _MOST_UNIT_WORDS), end):
            unit = unit_of("".join(words[start:end]))
            others = words[:start] + words[end:]
            known = {kind for word in others for kind in meanings(word)}
            if unit is None or (end < len(words) and not words[end].isdecimal() and words[end] not in "xyz"):
                continue
            if unit == ("orientation", "") or unit == ("orientation", "deg"):
                # `gyro_rad[0]`: a rate in radians a second.
                unit = ("rate", "rads" if unit[1] == "" else "dps") if "rate" in known else unit
            if len("".join(words[start:end])) > 1 or unit[0] in known or _of_letter(words[start:end], others):
                return others, unit
    return words, None


def _of_letter(unit: list[str], others: list[str]) -> bool:
    """Whether a unit of one letter belongs to a quantity of one letter: `a_x_g`, `t / s`."""
    return (unit == ["g"] and "a" in others) or (unit == ["s"] and others == ["t"])


def _kinds(word: str, rest: list[str], axis: str) -> list[str]:
    if axis and len(word) == 1 and word in LETTERS:
        # A letter gives the quantity only if no word does.
        return (
            []
            if any(meanings(other) for other in rest if len(other) > 1 and WORDS.get(other) not in ("plain", *_STATES))
            else [LETTERS[word] if axis in "xyz" or word == "q" else "letter"]
        )
    return meanings(word)


def _quantity(kinds: list[str], unit: tuple[str, str] | None, axis: str) -> tuple[str, set[str]]:
    """The quantity from words and a unit, and the state that they imply. Of several words, the last decides."""
    there, states = set(kinds), set[str]()
    of_axes = [kind for kind in kinds if kind in _QUANTITIES]
    if "other" in there and not ("time" in there and not axis):
        return "other", states
    if "time" in there and not axis:
        return "time", states
    if "temperature" in there and not axis:
        return "temperature", states
    if "angular" in there:
        return ("other" if "acceleration" in there else "rate"), states
    if "rotation" in there and "rate" not in there:
        return ("rate" if {"rate_of", "velocity"} & there else "orientation"), states
    if {"acceleration", "gravity"} <= there:
        if "without" in there or "free" in there:
            return "acceleration", {"free"}
        return ("acceleration" if "with" in there else "gravity"), states
    if of_axes:
        return of_axes[-1], states
    if "letter" in there:
        return (
            "acceleration" if unit and unit[0] == "acceleration" else "rate" if unit and unit[0] == "rate" else "letter"
        ), states
    if "linear" in there:
        return "velocity", states
    if "rate_of" in there and axis:
        return "rate", states
    if unit and unit[0] != "counts" and (axis or unit[0] not in ("acceleration", "rate", "field")):
        return unit[0], states
    return "", states


def quantity_of_name(name: str) -> str | None:
    """The role of a single name: ax, gy, time, temperature, position ...; None for no role."""
    return role_of(name)[0]


def role_of(name: str) -> tuple[str | None, str]:
    """The role and the unit of a single name; an index starts at 0."""
    if name.strip() in EITHER:
        return name.strip(), ""
    exact = exact_role(name.strip().lower())
    if exact[0]:
        return exact
    if angle := _ANGLE.fullmatch(name.strip().lower()):
        return f"{angle[1]}_deg", ""
    meaning = parsed(name)
    if meaning.stem == ("t",) and not meaning.axis and meaning.quantity in ("", "orientation"):
        return name.strip()[0], ""
    if meaning.quantity in ("time", "temperature"):
        return meaning.quantity, meaning.unit
    if meaning.quantity in ("acceleration", "rate") and meaning.axis:
        axis = meaning.axis if meaning.axis in "xyz" else "xyz"[int(meaning.axis)] if int(meaning.axis) < 3 else ""
        return (f"{'a' if meaning.quantity == 'acceleration' else 'g'}{axis}", meaning.unit) if axis else (None, "")
    return None, ""


def exact_role(text: str) -> tuple[str | None, str]:
    """Role and unit of the names that this program writes: `ax_ms2`, `time`, `temperature_degc` ...; None for others."""
    if text in (*QUANTITIES, *EITHER):
        return text, ""
    role, _, unit = text.rpartition("_")
    role = {"t": "temperature"}.get(role, role)
    kind = "acceleration" if role in FORCE else "rate" if role in RATE else role
    return (role, unit) if role and unit in _UNITS_OF.get(kind, ()) else (None, "")


def same_kind(one: str | None, other: str | None) -> bool:
    """Whether two roles are measured in the same units."""
    return one == other or any(one in kind and other in kind for kind in (FORCE, RATE))

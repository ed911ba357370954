"""What the name of a column says: quantity, axis, unit and processing state, from its words in any order."""

import re
import unicodedata
from dataclasses import dataclass
from functools import lru_cache

from tumblecal.data.column_words import LETTERS, MEANINGS, UNITS


FORCE, RATE = ("ax", "ay", "az"), ("gx", "gy", "gz")
LABELS, NUMBERS = ("position", "run", "mount"), ("alpha_deg", "beta_deg", "approach")
QUANTITIES = (*FORCE, *RATE, "time", "temperature", *LABELS, *NUMBERS)
# States of an acceleration, the preferred first; the last three do not have gravity along the axes of the sensor.
STATES = ("raw", "", "processed", "linear", "world", "free")
_TRIADS = ("acceleration", "rate", "field", "orientation", "gravity", "velocity", "place")
_ENDS_OF_TIMES = ("time", "stamp", "zeit", "tijd", "seconds")
_WITHOUT_GRAVITY = {"la", "lacc", "linacc", "laccel", "ua", "uacc", "useracc"}
_SHORT = {"gf": "gf", "xl": "xl", "la": "la", "ua": "ua", "ac": "ac", "gy": "gyr"}
_UNITWORDS = {
    r"degrees?|°": "deg", r"radians?": "rad", r"(meters?|metres?)": "m", r"(?<=[/ ])(seconds?|secs?)": "s",
    r"^(seconds?|secs?)$": "s", r"\bper\b": "/", r"squared": "2", r"[\s^*·⋅_]+": "",
}  # fmt: skip
_BRACKETS = re.compile(r"\[([^\]]*)\]|\(((?:[^()]|\([^()]*\))*)\)")
_CAMEL = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|[^\W\dA-Za-z_]+")
_MOST_UNITWORDS = 4


@dataclass(frozen=True)
class Name:
    """The meaning of a name.

    **Arguments:**

    - `quantity`: acceleration, rate, field, orientation, gravity, velocity, place, time, temperature; `other` (none of
      these), `letter` (g or f alone: a rate, gravity or a force); empty if unknown.
    - `axis`: x, y, z or a digit; empty for none. `unit`: g, mg, ms2, counts, dps, rads, degc, s, ms, us, ns; empty for others.
    - `state`: of `STATES`. `stem`: all words but the axis and the unit. `foreign`: how many do not concern the quantity.
    """

    quantity: str = ""
    axis: str = ""
    unit: str = ""
    state: str = ""
    stem: tuple[str, ...] = ()
    foreign: int = 0

    @property
    def sensor(self) -> tuple[str, ...]:
        """The words that do not state a processing state."""
        return tuple(word for word in self.stem if WORDS.get(word) not in STATES)


def plain_letters(text: str) -> str:
    """A text without accents, with superscript digits and similar forms as usual characters; letters keep their case."""
    decomposed = unicodedata.normalize("NFKD", text.replace("µ", "μ")).replace("−", "-")
    return "".join(letter for letter in decomposed if not unicodedata.combining(letter))


WORDS = {plain_letters(word): kind for kind, words in reversed(MEANINGS.items()) for word in words.split()}
_LONG = sorted((word for word in WORDS if len(word) > 2 or not word.isascii()), key=len, reverse=True)
_UNITS = {
    plain_letters(word): (kind, unit)
    for kind, units in UNITS.items() for unit, words in units.items() for word in words.split()
}  # fmt: skip


def unit_of(text: str) -> tuple[str, str] | None:
    """The quantity of a unit, and the unit as this program writes it (empty for an unused one); None for no unit."""
    plain = plain_letters(text).strip().lower()
    for pattern, symbol in _UNITWORDS.items():
        plain = re.sub(pattern, symbol, plain)
    return _UNITS.get(plain)


@lru_cache(maxsize=4096)
def parsed(column: str) -> Name:
    """The meaning of a name, from its words in any order, case and language, between any separators.

    **Example:** `parsed("accSmooth[0] (g)")` is an acceleration in g, axis 0, processed.
    """
    words, unit = _words(column)
    axis = next((word for word in words if word in ("x", "y", "z")), "")
    if not axis and len(words) > 1 and re.fullmatch(r"\d", words[-1]):
        axis = words[-1]
    stem = list(words)
    if axis:
        stem.pop(len(stem) - 1 - stem[::-1].index(axis))
    kinds = [kind for word in stem for kind in _kinds(word, stem, axis)]
    if {"specific", "force"} <= {*stem} or {"g", "force"} <= {*stem}:
        kinds = ["acceleration"]
    quantity, implied = _quantity(kinds, unit, axis)
    states = {implied, *(kind for kind in kinds if kind in STATES)} - (
        {"linear"} if quantity != "acceleration" else set()
    )
    written = unit[1] if unit and unit[0] in (quantity, "counts") else ""
    if quantity == "acceleration" and not written and {"gf", "gforce"} & {*stem}:
        written = "g"
    if quantity == "time" and not written:  # seconds_elapsed, timestamp_ms
        written = next((unit[1] for word in stem if (unit := unit_of(word)) and unit[0] == "time"), "")
    if unit and ((unit == (quantity, "") and quantity == "temperature") or (unit[0] == "time" and quantity in _TRIADS)):
        quantity = "other"  # in kelvin or Fahrenheit; a duration or a minimum
    known = {quantity, "plain"}
    foreign = sum(not {*_meanings(word)} & known for word in stem)
    return Name(quantity, axis, written, max(states - {""} or {""}, key=STATES.index), tuple(stem), foreign)


def _words(column: str) -> tuple[list[str], tuple[str, str] | None]:
    """The words of a name in small letters, and its unit: in brackets, or the last words."""
    text, units = plain_letters(column), []
    for bracket in _BRACKETS.finditer(text):
        if unit := unit_of(bracket[1] or bracket[2] or ""):
            units.append(unit)
            text = text.replace(bracket[0], " ")
    words = [word for part in re.findall(r"\d+[munμ]s(?![^\W_])|\d+|[^\W\d_]+", text) for word in _split(part)]
    if units:
        return words, units[0]
    for end in (len(words), len(words) - 1):
        for start in range(max(1, end - _MOST_UNITWORDS), end):
            unit, others = unit_of("".join(words[start:end])), words[:start] + words[end:]
            if unit is None or (end < len(words) and not re.fullmatch(r"\d|[xyz]", words[end])):
                continue
            known = {kind for word in others for kind in _meanings(word)}
            if unit[0] == "orientation" and "rate" in known:
                unit = ("rate", "dps" if unit[1] else "rads")  # gyro_rad[0]: radians a second
            of_letter = (words[start:end], others) == (["s"], ["t"]) or (
                words[start] == "g" and ("a" in others or others[0] in "xyz")
            )
            # `min` is also a minimum.
            if (len("".join(words[start:end])) > 1 and words[start] != "min") or unit[0] in known or of_letter:
                return others, unit
    return words, None


def _split(part: str) -> list[str]:
    """The words of a string of letters: known words that together form it, otherwise by capital letters."""
    if part[0].isdecimal():
        return [part]  # an index, or a unit such as 10us
    if whole := _known(part.lower()):
        return whole
    words = []
    for chunk in _CAMEL.findall(part) or [part]:
        chunk = chunk.lower()
        pair = len(chunk) == 2 and next((w for w in (chunk, chunk[::-1]) if w[0] in LETTERS and w[1] in "xyz"), "")
        words += _known(chunk) or (list(pair) if pair else [chunk])
    return words


def _known(letters: str, axes: int = 1) -> list[str] | None:
    """Known words, and at most one letter x, y or z, that together form these letters; None if they do not."""
    if not letters or letters in WORDS or (axes and letters in ("x", "y", "z")):
        return [letters] if letters else []
    if axes and letters[-1] in "xyz" and letters[:-1] in _SHORT:
        return [_SHORT[letters[:-1]], letters[-1]]
    for word in _LONG:
        if letters.startswith(word) and (rest := _known(letters[len(word) :], axes)) is not None:
            return [word, *rest]
    rest = _known(letters[1:], 0) if axes and letters[0] in "xyz" else None
    return None if rest is None else [letters[0], *rest]


def _meanings(word: str) -> list[str]:
    kind = WORDS.get(word, "") or ("time" if word.endswith(_ENDS_OF_TIMES) else "")
    return ["acceleration", kind] if word in _WITHOUT_GRAVITY else [kind] if kind else []


def _kinds(word: str, stem: list[str], axis: str) -> list[str]:
    """The meanings of a word; a letter with an axis gives the quantity only if no other word does."""
    if not axis or len(word) > 1 or word not in LETTERS:
        return _meanings(word)
    if any(len(other) > 1 and _meanings(other) and WORDS.get(other) not in ("plain", *STATES) for other in stem):
        return []
    return [LETTERS[word] if axis in "xyz" or word == "q" else "letter"]


def _quantity(kinds: list[str], unit: tuple[str, str] | None, axis: str) -> tuple[str, str]:
    """The quantity from words and a unit, and the state that they imply. Of several triads, the last word decides."""
    there = {*kinds}
    triads = [kind for kind in kinds if kind in _TRIADS]
    by_unit = unit[0] if unit and unit[0] != "counts" else ""
    rules = (
        ("other" in there and ("time" not in there or axis), "other", ""),
        ("time" in there and not axis, "time", ""),
        ("temperature" in there and not axis, "temperature", ""),
        ("angular" in there, "other" if "acceleration" in there else "rate", ""),
        ("rotation" in there and "rate" not in there, "rate" if {"rate_of", "velocity"} & there else "orientation", ""),
        ({"acceleration", "gravity"} <= there and {"without", "free"} & there, "acceleration", "free"),
        ({"acceleration", "gravity"} <= there, "acceleration" if "with" in there else "gravity", ""),
        (triads, triads[-1] if triads else "", ""),
        ("letter" in there, by_unit if by_unit in ("acceleration", "rate") else "letter", ""),
        ("linear" in there, "velocity", ""),
        ("rate_of" in there and axis, "rate", ""),
        (by_unit and (axis or by_unit not in ("acceleration", "rate", "field")), by_unit, ""),
    )
    return next(((quantity, state) for holds, quantity, state in rules if holds), ("", ""))


def role_of(column: str) -> tuple[str, str]:
    """The quantity of a single column (`ax`, `time`, `position` ...) and its unit; empty for none. An index starts at 0."""
    text = column.strip()
    if exact := exact_role(text.lower()):
        return exact
    if angle := re.fullmatch(r"(alpha|beta)[ _]?[\[(]\s*(?:deg|degrees?|°)\s*[\])]", text.lower()):
        return f"{angle[1]}_deg", ""
    name = parsed(text)
    if text == "t":
        return "time", ""
    if name.quantity in ("time", "temperature"):
        return name.quantity, name.unit
    axis = {"0": "x", "1": "y", "2": "z"}.get(name.axis, name.axis)
    if name.quantity in ("acceleration", "rate") and axis in ("x", "y", "z"):
        return f"{'a' if name.quantity == 'acceleration' else 'g'}{axis}", name.unit
    return "", ""


def exact_role(text: str) -> tuple[str, str] | None:
    """Quantity and unit of a name that this program writes: `ax_ms2`, `time_s`, `position`; None for others."""
    if text in QUANTITIES:
        return text, ""
    role, _, unit = text.rpartition("_")
    kind = "acceleration" if role in FORCE else "rate" if role in RATE else role
    if (unit == "raw" and kind == "rate") or unit in UNITS.get(kind, ()) or (unit == "counts" and kind != role):
        return (role, unit) if role in QUANTITIES and unit else None
    return None

"""Texts of options as values: `NAME=VALUE`, sizes with units, numbers and angles. Every fault begins with the option."""

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager

from tumblecal.ground.errors import InputError
from tumblecal.ground.units import quantity, reading_sd


# Seeds of random numbers have 64 bits.
LARGEST_SEED = 2**63 - 1
# Angles of one range.
_MOST_ANGLES = 720


@contextmanager
def faults_of(option: str) -> Iterator[None]:
    """Add an option to the faults of its text.

    **Raises:** `InputError` of the block.
    """
    try:
        yield
    except InputError as error:
        raise InputError([f"{option}: {fault}" for fault in error.faults]) from error


def pairs(
    option: str, given: str | Sequence[str], example: str, known: Collection[str] | None = None
) -> dict[str, str]:
    """The pairs of a text such as `ax=AccX,ay=AccY`, or of several texts with one pair each.

    **Arguments:**

    - `example`: in faults. `known`: the names that may be given; None: any.

    **Raises:** `InputError` for other text.
    """
    found: dict[str, str] = {}
    for part in filter(None, given.split(",") if isinstance(given, str) else given):
        name, _, value = (word.strip() for word in part.partition("="))
        text = given if isinstance(given, str) else part
        if known is not None and name not in known:
            raise InputError(f"{option} {text}: no {name!r}; names: {', '.join(known)}")
        if not (name and value) or found.setdefault(name, value) != value:
            raise InputError(f"{option} {text}: write pairs such as {example}, with each name once")
    return found


def size(option: str, text: str, unit: str, *, zero: bool = False) -> float:
    """A size in a text such as `1 mg`, in this base unit; `zero`: whether it may be 0.

    **Raises:** `InputError` for other text, and for a size below 0.
    """
    with faults_of(option):
        value = quantity(text, unit)
        if value < 0 or (value == 0 and not zero):
            raise InputError(f"{text!r}: must be above 0{', or 0' if zero else ''}")
    return value


def sd_of_reading(option: str, text: str | None, *, zero: bool = False) -> float | None:
    """The standard deviation of a reading, g; None without a text. `zero`: whether it may be 0.

    **Raises:** `InputError` for other text, or a size that gives no weights.
    """
    with faults_of(option):
        return reading_sd(text, none=zero) if text else None


def sizes(
    option: str,
    given: Sequence[str] | Mapping[str, str],
    units: Mapping[str, str] | Callable[[str], str],
    example: str = "",
    *,
    zero: bool = False,
) -> dict[str, float]:
    """Sizes in texts such as `bias=1 mg`, or in a table of texts, in the unit of each name.

    **Arguments:**

    - `option`: before each name in faults, with a blank or a dot at its end.
    - `units`: the base unit of each name, or a function that raises an `InputError` for an unknown name.
    - `example`: in faults. `zero`: whether a size may be 0.

    **Raises:** `InputError` with all faults: other text, and a size below 0.
    """
    found, faults = dict[str, float](), list[str]()
    stated = given if isinstance(given, Mapping) else pairs(option.strip(), given, example)
    for name, text in stated.items():
        try:
            if not callable(units) and name not in units:
                raise InputError(f"{option}{name}: no such parameter; parameters: {', '.join(units)}")
            with faults_of(f"{option}{name}"):
                unit = units(name) if callable(units) else units[name]
            found[name] = size(f"{option}{name}", text, unit, zero=zero)
        except InputError as error:
            faults += error.faults
    if faults:
        raise InputError(faults)
    return found


def numbers(option: str, text: str, example: str, separator: str = ",") -> tuple[float, ...]:
    """The numbers of a text such as `0,20,40`.

    **Raises:** `InputError` for other text.
    """
    try:
        found = tuple(map(float, text.split(separator)))
    except ValueError:
        found = (math.nan,)
    if not all(map(math.isfinite, found)):
        raise InputError(f"{option}: {text!r}: write numbers, such as {example}")
    return found


def angles(option: str, given: Sequence[str]) -> tuple[float, ...]:
    """The angles (deg) of texts such as `0,45` or `0:360:15` (end included; a whole turn ends where it began).

    **Raises:** `InputError` for other text.
    """
    found = list[float]()
    for text in given:
        for part in text.split(","):
            try:
                start, *more = map(float, part.split(":"))
                end, step = more or (start, 1.0)
                count = math.floor((end - start) / step + 1e-9) + 1
                if not (-360 <= start <= end <= 360 and step > 0 and count <= _MOST_ANGLES):
                    raise ValueError
            except (ValueError, ArithmeticError):
                raise InputError(
                    f"{option} {text}: {part.strip()!r} is not an angle; write degrees from -360 to 360, such as 45 or "
                    f"0,45,90, or START:END:STEP, such as 0:360:15, with at most {_MOST_ANGLES} angles"
                ) from None
            values = [round(start + step * number, 9) for number in range(count)]
            found += values[:-1] if count > 1 and values[-1] - values[0] == 360 else values
    return tuple(dict.fromkeys(found))

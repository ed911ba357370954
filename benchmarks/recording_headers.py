"""The headers in `recording_headers.toml`, where their codes are explained."""

import tomllib
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Header:
    """A header line.

    **Arguments:**

    - `source`: the program that writes it. `names`: of the columns, in order; `codes`: the quantities in them.
    - `separator`: between cells. `per_g`: how many of its unit make one g; `per_dps` one deg/s.
    - `asks`: whether a question is the right answer (no gravity in it, or two sensors).
    """

    source: str
    names: tuple[str, ...]
    codes: tuple[str, ...]
    separator: str = ","
    per_g: float = 9.80665
    per_dps: float = 1.0
    asks: bool = False


def _header(names: str, codes: str, separator: str = ",", **more) -> Header:
    return Header(names=tuple(names.split(separator)), codes=tuple(codes.split()), separator=separator, **more)


_TABLE = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
HEADERS = [_header(**header) for header in _TABLE["headers"]]

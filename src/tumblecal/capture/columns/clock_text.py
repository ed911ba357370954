"""Times written as date and time of day, or as time of day alone, converted to seconds."""

import re
from collections.abc import Sequence

import polars as pl


_TIME = (
    r"(?P<hour>\d{1,3}):(?P<minute>[0-5]\d):(?P<second>[0-5]\d(?:[.,]\d*)?)"
    r"\s*(?P<half>[AaPp])?\.?(?:[Mm]\.?)?\s*(?P<zone>Z|UTC|[+-]\d\d:?\d\d)?\s*$"
)
_DAY, _MONTH, _YEAR = r"(?P<day>\d{1,2})", r"(?P<month>\d{1,2})", r"(?P<year>\d{4}|\d\d)"
_BETWEEN = r"[T,]?\s*"
_PATTERNS = {
    "y-m-d h:m:s": rf"^\s*(?P<year>\d{{4}})[-/.]{_MONTH}[-/.]{_DAY}{_BETWEEN}{_TIME}",
    "d.m.y h:m:s": rf"^\s*{_DAY}\.{_MONTH}\.{_YEAR}{_BETWEEN}{_TIME}",
    "m/d/y h:m:s": rf"^\s*{_MONTH}[/-]{_DAY}[/-]{_YEAR}{_BETWEEN}{_TIME}",
    "d/m/y h:m:s": rf"^\s*{_DAY}[/-]{_MONTH}[/-]{_YEAR}{_BETWEEN}{_TIME}",
    # If day and month of a date are ambiguous, only the time of day is used.
    "day h:m:s": rf"^\s*\d{{1,2}}[/-]\d{{1,2}}[/-]\d{{2,4}}{_BETWEEN}{_TIME}",
    "h:m:s": rf"^\s*{_TIME}",
}
FORMS = tuple(_PATTERNS)
_MOST_OTHER = 0.2
_DAY_S, _HOUR_S, _MINUTE_S = 86400, 3600, 60


def form_of(cells: Sequence[str]) -> str | None:
    """The form of these times, one of `FORMS`; None for any other form."""
    for form, pattern in _PATTERNS.items():
        matches = [match for match in (re.match(pattern, cell) for cell in cells) if match]
        if len(matches) <= (1 - _MOST_OTHER) * len(cells):
            continue
        if "year" in matches[0].groupdict() and any(int(match["month"]) > 12 for match in matches):
            continue
        if form[1] == "/" and all(int(match["day"]) <= 12 for match in matches):
            continue
        return form
    return None


def seconds_of(name: str, form: str, first_day: float = 0.0) -> pl.Expr:
    """The times of a column of text, s, from midnight of a day (counted from 1970); null for cells of another form."""

    def of_groups(groups: pl.Series) -> pl.Series:
        # Each cell is split only once.
        return (
            groups.struct.unnest().select(_seconds(dated="<year>" in _PATTERNS[form], first_day=first_day)).to_series()
        )

    return pl.col(name).str.extract_groups(_PATTERNS[form]).map_batches(of_groups, return_dtype=pl.Float64)


def _seconds(*, dated: bool, first_day: float) -> pl.Expr:
    """The seconds of the parts of a time, columns of text."""
    hour, minute = (pl.col(unit).cast(pl.Int64, strict=False) for unit in ("hour", "minute"))
    second = pl.col("second").str.replace(",", ".", literal=True).cast(pl.Float64, strict=False)
    half = pl.col("half").str.to_lowercase()
    hour = pl.when(half.is_null()).then(hour).otherwise(hour % 12 + 12 * (half == "p").cast(pl.Int64))
    ahead = pl.col("zone").str.replace(":", "", literal=True).cast(pl.Int64, strict=False).fill_null(0)
    ahead = ahead.sign() * (ahead.abs() // 100 * _HOUR_S + ahead.abs() % 100 * _MINUTE_S)
    of_day = hour * _HOUR_S + minute * _MINUTE_S - ahead + second
    if not dated:
        return of_day
    year = pl.when(pl.col("year").str.len_chars() == 2).then("20" + pl.col("year")).otherwise(pl.col("year"))
    date = pl.concat_str([year, pl.col("month"), pl.col("day")], separator="-")
    day = date.str.to_date("%Y-%m-%d", strict=False).cast(pl.Int64)
    return (day - int(first_day)) * _DAY_S + of_day

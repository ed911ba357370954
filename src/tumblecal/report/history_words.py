"""The history of a unit and a comparison of two calibrations, in words and tables of text."""

from collections.abc import Iterator, Sequence
from datetime import timedelta
from typing import NamedTuple

import numpy as np

from tumblecal.data.sensor_parameters import GROUPS, leaf_of
from tumblecal.ground.axes import AXES
from tumblecal.ground.counted import counted
from tumblecal.ground.numbers_shown import decimals, p_cell, rounded, rounded_together, with_decimals
from tumblecal.ground.units import in_words, shown
from tumblecal.history.changes import DRIFT, RESULT, STEP, Change
from tumblecal.history.comparison import Comparison
from tumblecal.history.entry import Entry
from tumblecal.history.repeatability import DAYS_A_MONTH, FEWEST, MOUNTING, Repeatability, Trend, UnitHistory
from tumblecal.show.tables import Table, number
from tumblecal.show.verdict import as_sentence


# Of each kind of change: its name, its verb, and its time.
_KINDS = {
    STEP: ("change at one date", "changed", "between {first} and {last}"),
    DRIFT: ("drift", "drifts", "from {first} to {last}"),
    RESULT: ("single deviating result", "differs", "only in {last}"),
}
_PER_YEAR_FROM_MONTHS = 6


def repeats_table(history: UnitHistory) -> Table:
    """Repeatability of each kind of parameter, and the largest difference of two results without the changes."""
    header = [
        "parameters",
        "repeatability",
        "u (median)",
        "degrees of freedom",
        "largest difference",
        "allowed",
        "unit",
    ]
    return Table([*header, "judgement"], list(map(_repeats_row, history.repeats)), text=(0, 6, 7))


def _repeats_row(repeats: Repeatability) -> list[str]:
    words, (unit, factor) = GROUPS[repeats.leaf][0], shown(GROUPS[repeats.leaf][1])
    sizes = [number(repeats.sd * factor, 2), number(repeats.u * factor, 2), str(repeats.dof)]
    judgement = "exceeds the limit" if repeats.beyond_limit else "within the limit"
    judgement = "not of the unit" if repeats.leaf == MOUNTING else judgement
    return [words, *sizes, f"{repeats.largest * factor:.4f}", f"{repeats.limit * factor:g}", unit, judgement]


def trends_table(history: UnitHistory) -> Table:
    """The parameters over time."""
    header = ["parameter", "last", "U (95.45 %)", "unit", "E_n", "drift / month", "u", "p of no change"]
    return Table(header, list(map(trend_row, history.trends)), text=(0, 3))


def trend_row(trend: Trend) -> list[str]:
    """A parameter over time."""
    unit, factor = shown(trend.unit)
    last = _with_uncertainty(trend.values[-1] * factor, trend.expanded[-1] * factor if trend.sd[-1] > 0 else np.nan)
    drift = _with_uncertainty(trend.drift * factor, trend.drift_sd * factor)
    p_value = None if leaf_of(trend.name) == MOUNTING else trend.p_value
    return [trend.name, *last, unit, "".join(map(_en, trend.en[-1:].tolist())), *drift, p_cell(p_value)]


def en_table(history: UnitHistory) -> Table:
    """E_n of each result and the previous one, with the repeatability."""
    names = [trend.name for trend in history.trends]
    rows = zip(history.entries[1:], *(trend.en.tolist() for trend in history.trends), strict=True)
    return Table(["result", *names], [[_result(entry), *map(_en, sizes)] for entry, *sizes in rows], text=(0,))


def _with_uncertainty(value: float, uncertainty: float) -> list[str]:
    """A value and its uncertainty in two cells; "" for one that does not exist."""
    if not np.isfinite(value):
        return ["", ""]
    return rounded(value, uncertainty) if np.isfinite(uncertainty) else [*rounded(value, 0.0)[:1], ""]


def _en(value: float) -> str:
    """E_n in two digits, or as many as distinguish it from its limit of 1; "" for one that does not exist."""
    texts = (number(value, digits) for digits in range(2, 18))
    return next((text for text in texts if not text or abs(float(text)) != 1), "1" if value > 0 else "-1")


class Statement(NamedTuple):
    """A finding on a unit, and the next step; "" if that of a later change is the same."""

    words: str
    next: str


def statements(history: UnitHistory) -> list[Statement]:
    """All findings: changes of the unit first, the largest first."""
    return [*_changes(history), *_limits(history), *_refused(history)]


def _changes(history: UnitHistory) -> Iterator[Statement]:
    """Changes; those of several parameters between the same results are one finding."""
    found = [(trend, change) for trend in history.trends for change in trend.changes]
    found.sort(key=lambda pair: -abs(pair[1].size) / pair[1].u)
    events = dict.fromkeys((change.kind, change.first, change.last) for _, change in found)
    latest = max((change.last for _, change in found if change.kind == STEP), default=0)
    for event in events:
        kind, first, last = event
        changes = [(trend, c) for trend, c in found if (c.kind, c.first, c.last) == event]
        names = [trend.name for trend, _ in changes]
        _, verb, time = _KINDS[kind]
        sizes = [f"{trend.name} {verb} by {_size(history, trend, change)}" for trend, change in changes]
        between = time.format(first=_result(history.entries[first]), last=_result(history.entries[last]))
        others = dict.fromkeys(_KINDS[other][0] for _, change in changes for other in change.alternatives)
        possible = f"; a {' or a '.join(others)} is also possible" if others else ""
        following = "" if kind == STEP and last < latest else _next(history, changes[0][1], names)
        yield Statement(f"{', '.join(sizes)} {between}{possible}", following)


def _next(history: UnitHistory, change: Change, names: Sequence[str]) -> str:
    before, result = (_result(history.entries[place]) for place in (change.first, change.last))
    if {*names} >= {f"dK_{axis}" for axis in AXES}:
        return "Check the gravity value of each result: it changes all scale factors"
    if change.kind == DRIFT:
        return f"Correct {', '.join(names)} for the drift since the last calibration, or recalibrate more often"
    if change.kind == RESULT:
        return f"Do not use {result}. Check its mounting, temperature and gravity value"
    if change.last == len(history.entries) - 1:
        return f"Repeat the calibration, because only {result} shows this change. If it is confirmed, inspect the unit"
    return (
        f"Use no calibration from before {result}. Inspect the unit and its mounting for the cause, such as a shock. Check the "
        f"data that were recorded after {before} with an earlier calibration"
    )


def _size(history: UnitHistory, trend: Trend, change: Change) -> str:
    """The size of a change with its standard uncertainty; of a drift per year, or per month in a short history."""
    (unit, factor), time, per = shown(trend.unit), 1, ""
    if change.kind == DRIFT:
        time, per = (12, " per year") if history.months >= _PER_YEAR_FROM_MONTHS else (1, " per month")
    size = rounded_together(change.size * factor * time, change.u * factor * time)
    return in_words(f"({size})" if unit == "1e-3" else size, unit) + per


def _result(entry: Entry) -> str:
    return f"{entry.date_utc[:10]} (result {entry.number})"


def _limits(history: UnitHistory) -> Iterator[Statement]:
    for repeats in history.repeats:
        if repeats.beyond_limit:
            words, (unit, factor) = GROUPS[repeats.leaf][0], shown(GROUPS[repeats.leaf][1])
            largest, limit = (in_words(f"{size * factor:.3g}", unit) for size in (repeats.largest, repeats.limit))
            changed = any(trend.changes for trend in history.trends if leaf_of(trend.name) == repeats.leaf)
            words = f"{words} of two results differ by {largest}, more than the limit of {limit}"
            words += ", in addition to the changes" if changed else ""
            if repeats.u > 0 and repeats.between == 0:
                yield Statement(
                    f"{words}, but agree within their uncertainties", "Measure more positions for this limit"
                )
            else:
                yield Statement(words, "Check mounting and temperature, or state a larger limit (--limit)")


def _refused(history: UnitHistory) -> Iterator[Statement]:
    if refused := [entry.number for entry in history.entries if entry.refused]:
        words = f"result{'s' * (len(refused) > 1)} {_ranges(refused)}"
        yield Statement(f"{words} must not be used (use: no)", "Diagnose the data of such results (tumblecal diagnose)")


def _ranges(numbers: Sequence[int]) -> str:
    """Numbers in rising order, three and more consecutive ones as a range."""
    breaks = [k for k in range(1, len(numbers)) if numbers[k] != numbers[k - 1] + 1]
    rows = (numbers[begin:end] for begin, end in zip([0, *breaks], [*breaks, len(numbers)], strict=True))
    return ", ".join(f"{row[0]} to {row[-1]}" if len(row) > 2 else ", ".join(map(str, row)) for row in rows)


def repeatability_words(history: UnitHistory) -> str:
    """The repeatability of the parameters of the unit; "" for one result."""
    sizes = []
    for repeats in history.repeats:
        if repeats.leaf != MOUNTING and np.isfinite(repeats.sd):
            words, (unit, factor) = GROUPS[repeats.leaf][0], shown(GROUPS[repeats.leaf][1])
            sizes.append(f"{words} {in_words(rounded(repeats.sd * factor, repeats.sd * factor)[0], unit)}")
    return f"repeatability (standard deviation between dates): {', '.join(sizes)}" if sizes else ""


def interval_words(history: UnitHistory, risk: float) -> str:
    """The recalibration interval."""
    months, name = history.interval(risk)
    if not np.isfinite(months):
        return "recalibration interval: not determinable with fewer than three results on different dates"
    if months <= 0:
        return (
            f"recalibration interval: not determinable at a risk of {risk:g}, because the dispersion of {name} already exceeds "
            "its limit"
        )
    reason = "the length of this history" if months >= history.months else f"limited by {name}"
    due = (history.entries[-1].when + timedelta(days=months * DAYS_A_MONTH)).date()
    return f"recalibrate by {due}, after {months:.3g} months ({reason}; risk {risk:g})"


def uncertainty_words(history: UnitHistory) -> str:
    """The contributions to the uncertainties of the results."""
    entries = history.entries
    by_kind = {
        words: [e.number for e in entries if (e.combined, e.diagnosed) == kind]
        for kind, words in _CONTRIBUTIONS.items()
    }
    kinds = {words: numbers for words, numbers in by_kind.items() if numbers}
    few = [(e.number, e.parameters.dof) for e in history.entries if e.parameters and np.isfinite(e.parameters.dof)]
    dofs = sorted({dof for _, dof in few})
    by_dof = "; ".join(f"{_ranges([result for result, of_result in few if of_result == dof])}: {dof:g}" for dof in dofs)
    estimated = f"; degrees of freedom from which the noise was estimated, by result: {by_dof}" if few else ""
    if len(kinds) == 1:
        return f"uncertainties: {next(iter(kinds))}{estimated}"
    return "uncertainties: " + "; ".join(f"{_ranges(numbers)}: {words}" for words, numbers in kinds.items()) + estimated


def dof_words(dof: float) -> str:
    """End of a sentence: the noise was estimated; "" if it was stated."""
    return f"; its noise was estimated from {dof:g} degree{'s' * (dof != 1)} of freedom" if np.isfinite(dof) else ""


# By whether they include the inputs of a budget, and the contributions of a diagnosis.
_CONTRIBUTIONS = {
    (True, False): "combined (noise and budget)",
    (True, True): "combined (noise, other explanations, undetected effects and budget)",
    (False, True): "of the noise, of other explanations and of undetected effects",
    (False, False): "of the noise alone (type A)",
}


def headline(serial: str, history: UnitHistory) -> str:
    """The result for a unit without findings."""
    count, (first, last) = len(history.entries), (history.entries[k].date_utc[:10] for k in (0, -1))
    results = f"{counted(count, 'result')} from {first} to {last}"
    if count < FEWEST:
        return f"{serial}: {results}, too few to detect a change ({FEWEST} are needed)"
    return f"{serial}: stable, no change or drift in {results}"


def next_steps(found: Sequence[Statement]) -> list[str]:
    """The next steps of all findings."""
    return list(dict.fromkeys([one.next for one in found if one.next]))


def history_text(serial: str, history: UnitHistory, risk: float) -> str:
    """The history of a unit for a terminal: one line, or each finding, the next steps, and repeatability."""
    found, notes = statements(history), [repeatability_words(history), interval_words(history, risk)]
    closing = " ".join(f"{as_sentence(words)}." for words in notes if words)
    if not found:
        return f"{headline(serial, history)}. {closing}"
    lines = [f"{serial}: {one.words}." for one in found]
    lines += [f"NEXT: {step}." for step in next_steps(found)]
    return "\n".join([*lines, closing]) + " +- is the standard uncertainty." * (" +- " in lines[0])


def comparison_text(comparison: Comparison) -> str:
    """The changes between two calibrations, for a terminal."""
    moved = []
    for part in comparison.moved:
        unit, factor = shown(part.unit)
        places = decimals(part.sd * factor)
        sizes = [with_decimals(size * factor, places) for size in (part.old, part.new, part.change, part.sd)]
        moved.append([part.name, *sizes[:3], sizes[3] if part.sd > 0 else "", number(part.in_sd, 2), unit])
    joint = []
    for test in comparison.joint:
        unit, factor = shown(test.unit) if test.unit else ("", 1.0)
        size = f"{test.size * factor:.4f}" if test.unit else ""
        known = test.p_value is not None
        cells = [number(test.chi2) if known else "", str(test.dof) if known else "", p_cell(test.p_value)]
        joint.append([test.what, size, unit, *cells, "yes" if test.moved else "no" if known else "", test.means])
    changes = Table(["parameter", "old", "new", "change", "u", "change / u", "unit"], moved, text=(0, 6))
    tests = ["together", "largest change", "unit", "chi2", "dof", "p", "moved", "what would move it"]
    return f"{changes}\n\n{Table(tests, joint, text=(0, 2, 6, 7))}"

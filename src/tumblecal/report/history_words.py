"""The history of a unit and a comparison of two calibrations, in words and tables of text."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tumblecal.data.sensor_parameters import GROUPS, leaf_of
from tumblecal.ground.numbers_shown import decimals, p_cell, p_words, rounded, rounded_together, with_decimals
from tumblecal.ground.units import shown
from tumblecal.history.comparison import Comparison
from tumblecal.history.drift import Drift, drifts, without_drift
from tumblecal.history.repeatability import TOGETHER, Repeats, Trend, UnitHistory
from tumblecal.report.tables import Table, number


# At most so many E_n of one parameter are listed; more are only counted, as the charts show them.
_MOST_OF_ONE = 5


def repeats_table(history: UnitHistory) -> Table:
    """Whether repeated results agree, for each kind of parameter."""
    header = ["of all results", "largest difference", "allowed", "unit", "p", "judgement"]
    return Table(header, list(map(_repeats_row, history.repeats)), text=(0, 3, 5))


def trends_table(history: UnitHistory) -> Table:
    """The parameters over time."""
    header = ["parameter", "last", "U (95.45 %)", "unit", "E_n", "drift / month", "u"]
    return Table(header, list(map(trend_row, history.trends)), text=(0, 3))


def _repeats_row(repeats: Repeats) -> list[str]:
    unit, factor = shown(repeats.unit) if repeats.unit else ("", 1.0)
    sizes = [f"{repeats.largest * factor:.4f}", f"{repeats.limit * factor:g}"] if repeats.unit else ["", ""]
    return [repeats.what, *sizes, unit, p_cell(repeats.p_value), judged(repeats)]


def judged(repeats: Repeats) -> str:
    """Result of the two criteria: the limit, and the uncertainties."""
    agree = ", but agree within their uncertainties" if repeats.p_value is not None and not repeats.beyond_noise else ""
    results = [f"exceed the limit{agree}"] if repeats.beyond_limit else []
    results += ["disagree beyond their uncertainties"] if repeats.beyond_noise else []
    return "; ".join(results) or (
        "agree" if repeats.p_value is not None else "within the limit (no uncertainties stated)"
    )


def trend_row(trend: Trend) -> list[str]:
    """A parameter over time."""
    unit, factor = shown(trend.unit)
    last_en = "" if not len(trend.en) else _en(float(trend.en[-1]))
    last = _with_uncertainty(trend.values[-1] * factor, trend.expanded[-1] * factor if trend.sd[-1] > 0 else np.nan)
    return [trend.name, *last, unit, last_en, *_with_uncertainty(trend.drift * factor, trend.drift_sd * factor)]


def _with_uncertainty(value: float, uncertainty: float) -> list[str]:
    """A value and its uncertainty in two cells; "" for one that does not exist."""
    if not np.isfinite(value):
        return ["", ""]
    return rounded(value, uncertainty) if np.isfinite(uncertainty) else [*rounded(value, 0.0)[:1], ""]


def _en(value: float) -> str:
    """E_n in two digits, or as many as distinguish it from its limit of 1; "" for one that does not exist."""
    texts = (number(value, digits) for digits in range(2, 18))
    return next((text for text in texts if not text or abs(float(text)) != 1), "1" if value > 0 else "-1")


@dataclass(frozen=True)
class Flag:
    """A finding that deserves attention, in words; `explained`: further flags that it explains.

    `about`: the parameter, or the kind of parameters.
    """

    words: str
    about: str = ""
    explained: tuple[str, ...] = ()


def flags(history: UnitHistory) -> list[Flag]:
    """All flags: drifts first, each with the flags that disappear once all drifts are subtracted."""
    found, every = drifts(history), list(_flagged(history))
    if not found:
        return every
    without = without_drift(history, found)
    unexplained = {flag.about for flag in _flagged(without)}
    explained = [flag for flag in every if flag.about not in unexplained]
    drift_flags = list[Flag]()
    for drift in found:
        name = drift.trend.name
        by_drift = [
            flag
            for flag in explained
            if flag.about in (name, GROUPS[leaf_of(name)][0]) or flag.about not in _kinds(found)
        ]
        explained = [flag for flag in explained if flag not in by_drift]
        drift_flags.append(Flag(_drift_words(history, drift), name, tuple(flag.words for flag in by_drift)))
    return [*drift_flags, *(flag for flag in every if flag.about in unexplained)]


def _kinds(found: Sequence[Drift]) -> set[str]:
    """The parameters that drift, and their kinds."""
    names = {drift.trend.name for drift in found}
    return names | {GROUPS[leaf_of(name)][0] for name in names}


def _drift_words(history: UnitHistory, drift: Drift) -> str:
    trend, first = drift.trend, history.entries[0].date_utc[:10]
    unit, factor = shown(trend.unit)
    sizes = (rounded_together(trend.drift * factor * k, trend.drift_sd * factor * k) for k in (1, 12))
    month, year = (f"({size})e-3" if unit == "1e-3" else f"{size} {unit}" for size in sizes)
    return (
        f"{trend.name} drifts by {month} per month ({year} per year; "
        f"{abs(trend.drift) / trend.drift_sd:.2g} u, {p_words(drift.p_value)}), since {first} "
        f"({len(history.entries)} results)"
    )


def _flagged(history: UnitHistory) -> Iterator[Flag]:
    """Flags if nothing drifts, a line each."""
    if refused := [entry.number for entry in history.entries if entry.refused]:
        several = "s" if len(refused) > 1 else ""
        yield Flag(f"result{several} {_ranges(refused)}: use: no; {'they' if several else 'it'} must not be used")
    for repeats in history.repeats:
        if repeats.beyond_limit or repeats.beyond_noise:
            yield Flag(f"{len(history.entries)} results of {repeats.what} {judged(repeats)}", repeats.what)
    for trend in history.trends:
        far = np.flatnonzero((np.abs(trend.en) > 1) & (trend.tail < history.unlikely_together)).tolist()
        if len(far) > _MOST_OF_ONE:
            largest = max(far, key=lambda k: abs(trend.en[k]))
            words = f"{trend.name}: {len(far)} E_n beyond 1, the largest {_en_of(history, trend, largest)}"
            yield Flag(words, trend.name)
        else:
            yield from (Flag(f"{trend.name}: {_en_of(history, trend, k)}", trend.name) for k in far)
        beyond = [history.entries[k].number for k in np.flatnonzero(trend.beyond < history.unlikely_on_charts)]
        if beyond:
            several = "s" if len(beyond) > 1 else ""
            are = f"result{several} {_ranges(beyond)} {'are' if several else 'is'}"
            yield Flag(f"{trend.name}: {are} beyond the control limits", trend.name)


def _en_of(history: UnitHistory, trend: Trend, k: int) -> str:
    before, after = (history.entries[place].number for place in (k, k + 1))
    return f"E_n {_en(float(trend.en[k]))} of result {after} against {before}"


def _ranges(numbers: Sequence[int]) -> str:
    """Numbers in rising order, three and more consecutive ones as a range."""
    breaks = [k for k in range(1, len(numbers)) if numbers[k] != numbers[k - 1] + 1]
    rows = (numbers[begin:end] for begin, end in zip([0, *breaks], [*breaks, len(numbers)], strict=True))
    return ", ".join(f"{row[0]} to {row[-1]}" if len(row) > 2 else ", ".join(map(str, row)) for row in rows)


def en_words(history: UnitHistory) -> str:
    """Number of E_n beyond 1, the number expected by chance, and those that are not flagged; "" without E_n."""
    known = np.concatenate([trend.en for trend in history.trends])
    if not np.any(np.isfinite(known)):
        return ""
    expected = float(np.nansum([trend.by_chance for trend in history.trends]))
    within = list[str]()
    for trend in history.trends:
        near = np.flatnonzero((np.abs(trend.en) > 1) & (trend.tail >= history.unlikely_together)).tolist()
        listed = [f"{trend.name} {_en_of(history, trend, k)}" for k in near]
        within += listed if len(listed) <= _MOST_OF_ONE else [f"{len(listed)} of {trend.name}"]
    count, limit = int(np.isfinite(known).sum()), history.unlikely_together
    words = f"E_n: {int(np.sum(np.abs(known) > 1))} of {count} beyond 1, {expected:.2g} expected by chance"
    words += f"; flagged if p < {limit:.2g} ({1 - TOGETHER:.2g} family-wise error rate for {count} comparisons)"
    return words + (f"; not flagged: {', '.join(within)}" if within else "")


def control_words(history: UnitHistory) -> str:
    """Results beyond control limits that are consistent with chance and therefore not flagged; "" without any."""
    within = list[str]()
    for trend in history.trends:
        near = np.flatnonzero(trend.outside & (trend.beyond >= history.unlikely_on_charts))
        within += [f"{trend.name} result {_ranges([history.entries[k].number for k in near])}"] if len(near) else []
    charts = sum(trend.control > 0 for trend in history.trends)
    rate = f"{1 - TOGETHER:.2g} family-wise error rate for {charts} charts"
    return (
        f"beyond control limits, but consistent with chance ({rate}), so not flagged: {', '.join(within)}"
        if within
        else ""
    )


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
    capped = " or longer (the history covers no longer time)" if months >= history.months else f", by {name}"
    return f"recalibration interval at a risk of {risk:g}: {months:.1f} months{capped}"


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


def history_text(serial: str, history: UnitHistory, risk: float) -> str:
    """The history of a unit for a terminal."""
    first, last = (history.entries[k].date_utc[:10] for k in (0, -1))
    count = len(history.entries)
    flagged = list[str]()
    for flag in flags(history):
        flagged += [f"FLAG: {flag.words}", *(f"      explained by this drift: {words}" for words in flag.explained)]
    flagged = flagged or ["nothing is flagged"]
    lines = [f"unit {serial}: {count} independent result{'s' * (count > 1)}, {first} to {last}", ""]
    lines += [str(repeats_table(history)), ""] if count > 1 else []
    notes = [en_words(history), control_words(history), interval_words(history, risk), uncertainty_words(history)]
    return "\n".join([*lines, str(trends_table(history)), "", *flagged, *filter(None, notes)])


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

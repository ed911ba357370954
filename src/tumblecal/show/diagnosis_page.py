"""`diagnosis.html`: the verdict with a picture for each finding, and everything it rests on."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tumblecal.diagnosis import Diagnosis
from tumblecal.ground.numbers_shown import decimals
from tumblecal.ground.units import in_words, shown
from tumblecal.planning import NextPlan
from tumblecal.report.finding_figures import card_figures, finding_signals
from tumblecal.report.unnamed_figure import CAPTION
from tumblecal.show.diagnosis import harm_in_u, verdict_of_diagnosis, words_of_diagnosis
from tumblecal.show.fit import fit_words
from tumblecal.show.page import TONES, page, write_page
from tumblecal.show.tables import Table
from tumblecal.show.verdict import Verdict
from tumblecal.show.words import Words, words_of


# Tables by name, with their columns of words.
_TABLES = {"gain": (0, 4), "alternatives": (0, 1, 2), "explanations": (0,), "parameters": (1,), "provenance": (1,)}
_LIMITS = {"limits": (1, 3), "invisible": (1, 2, 3), "not testable": (0, 1)}
_PLANS = {"together": (1,), "singles": (1,), "confirming": (2,)}
# Details that tables and cards of the page show.
_SHOWN = {"Changes of the calibration", "Residuals and gain", "Causes", "Undetectable with these data", "Not testable"}


@page
def write_diagnosis_page(
    path: Path, diagnosis: Diagnosis, plan: NextPlan, drawn: Mapping[str, Path], verdict: Verdict | None = None
) -> None:
    """Write the page.

    `path`: the HTML file. `plan`: what to measure next. `drawn`: SVG files by name. `verdict`: by default
    that of the diagnosis, with commands for the page's folder.
    """
    verdict = verdict or verdict_of_diagnosis(diagnosis, plan, path.parent)
    signals, data = finding_signals(diagnosis), diagnosis.data
    words = words_of_diagnosis(
        diagnosis,
        template="diagnosis_page",
        plan=plan,
        verdict=verdict,
        sd_mg=1e3 * diagnosis.level * diagnosis.problem.sd,
        pitch_settings=len(np.unique(data.pitch_setting_deg)),
        mountings_measured=len({*(data.mount or "1")}),
        values=[] if diagnosis.calibration is None else fit_words(diagnosis.in_use.as_fit).lines("values"),
        drawn=drawn,
        signals={number: signal.label for number, signal in signals.items()},
        unnamed_caption=CAPTION,
        parameters=list(_parameters(diagnosis)),
    )
    tables = _tables(words, _TABLES) | limit_tables(diagnosis, folded="limits.svg" in drawn)
    tables["explanations"] = replace(tables["explanations"], shares=(1,))
    if others := [one for one in verdict.details if one[0] not in _SHOWN]:
        tables["details"] = Table(("", ""), others, text=(0, 1))
    cards = {f"card_{number}": draw for number, draw in card_figures(diagnosis, signals).items()}
    write_page(
        path,
        words,
        verdict,
        tone=TONES[diagnosis.verdict],
        tables=tables,
        figures=cards | {Path(name).stem: file for name, file in drawn.items()},
        plans=[*_tables(words, _PLANS).values()],
    )


def limit_tables(diagnosis: Diagnosis, *, folded: bool = False) -> dict[str, Table]:
    """Detection limits, undetectable effects and those that cannot be tested, by the names limits, invisible and not testable;
    `folded`: whether the limits are closed at first, as a figure shows them."""
    words = words_of("diagnosis_limits", d=diagnosis, harm=harm_in_u(diagnosis), in_words=in_words, shown=shown)
    tables = _tables(words, _LIMITS)
    return tables | {name: replace(table, folded=folded) for name, table in tables.items() if name == "limits"}


def _tables(words: Words, columns: Mapping[str, Sequence[int]]) -> dict[str, Table]:
    tables = {name: words.table(f"table {name}", text=text) for name, text in columns.items()}
    return {name: table for name, table in tables.items() if table is not None}


def _parameters(diagnosis: Diagnosis) -> Iterator[tuple]:
    """Each nominal parameter of sensor and set-up in calibration.json, in display units: name, unit, decimals, nominal value,
    numbers (value, standard uncertainty and its contributions; none if no position depends on it), and change in u."""
    nominal, used = diagnosis.nominal, diagnosis.in_use
    for k, name in enumerate(diagnosis.model.nominal_chain.names):
        if diagnosis.model.layout.of_positions[k]:  # the tilts of a hand-held set
            continue
        unit, scale = shown(nominal.units[k])
        value, u = float(nominal.values[k]), float(used.sd[k])
        numbers = [] if used.idle[k] else [used.values[k], u, *(part[k] for part in used.parts.values())]
        change = (numbers[0] - value) / u if numbers else 0.0
        yield name, unit, decimals(u * scale), value * scale, [float(each * scale) for each in numbers], change

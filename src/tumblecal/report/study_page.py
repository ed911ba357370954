"""The page of a study: answer, table, figures, files and settings."""

from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import polars as pl

from tumblecal import __version__
from tumblecal.report.page import Section, inline_figure, page, write_page
from tumblecal.report.study_answers import Answer
from tumblecal.report.tables import Table
from tumblecal.report.verdict import Verdict


_QUESTIONS = {
    "coverage": "Are the estimates unbiased, and do the stated intervals contain the true value as often as stated?",
    "sweep": "How do rig, plan, noise or an effect change estimation bias and coverage?",
    "convergence": "How many data sets does each method need to reach a given error?",
    "linearization": "Up to which errors are the small-angle equations adequate?",
    "power": "How large must an effect be for the diagnosis to detect it, and to name it?",
}
_CAPTIONS = {
    "coverage.svg": "Bars are two standard errors: of the bias, of the standard deviation, and of the interval coverage. Below "
    "on the right: frequency of the sum of squares in 20 bins of equal probability.",
    "sweep.svg": "The worst parameter at each point of the grid.",
    "convergence.svg": "Rms error of the worst parameter of each group, over all runs, against the number of data sets.",
    "data_sets_needed.svg": "From the number of data sets that 10 % of the runs need to that of 90 % (bar); the median (dot). "
    "Right of the grey line: not within the study.",
    "linearization.svg": "Rms bias of the worst parameter, divided by the standard deviation of one data set. On a grey line "
    "the bias equals the standard deviation after that number of data sets. Dashed: theoretical slope of 2.",
    "power.svg": "Share of the runs in which something was detected, and in which the effect was among those named.",
}
_FILES = {
    "parameters": "a row for each parameter (and point): truth, bias, standard deviation, coverage; base units (1, g, rad)",
    "errors": "bias and rms error by method, number of data sets and parameter; base units (1, g, rad)",
    "consistency": "NEES and NIS by method and number of data sets",
    "needed": "data sets needed for each threshold: 10 %, median, 90 % of the runs, and the share that never reaches it",
    "biases": "bias of the linear equations by kind and size (rad) of the errors, equations and parameter; base units",
    "crossings": "size (rad) at which the bias of each parameter reaches its standard deviation after a number of data sets",
    "rates": "runs, failures and rates by effect and size",
}


@page
def write_study_page(
    path: Path, kind: str, content: Mapping[str, Any], frames: Mapping[str, pl.DataFrame], answer: Answer,
    figures: Sequence[str],
) -> None:  # fmt: skip
    """Write the page of a study.

    `content`: of the JSON file; `frames`: the tables; `answer`: of the study; `figures`: names of the SVG files in the folder.
    """
    sections = [
        Section("Results", tables=[answer.table]),
        Section("Figures", figures=[inline_figure(path.parent / name, _CAPTIONS[name]) for name in figures]),
        _files(kind, frames, figures),
        Section("Settings", tables=[Table(["", ""], list(_studied(content)), text=(1,))]),
    ]
    title = str(content["title"] or f"Study of {kind}")
    verdict = Verdict("", answer.headline, evidence=answer.words)
    write_page(path, title, _QUESTIONS[kind], verdict, sections, tone=answer.tone)


def _files(kind: str, frames: Mapping[str, pl.DataFrame], figures: Sequence[str]) -> Section:
    rows = [[f"{kind}.json", "all results except the large tables, with the study and the rig as they were read"]]
    rows += [[f"{kind}_{name}.parquet", f"{_FILES[name]} ({len(frame)} rows)"] for name, frame in frames.items()]
    rows += [[name, "a figure of this page"] for name in figures]
    rows += [["chunks/, manifest.json", "completed parts: the same command resumes from them; they can be deleted"]]
    return Section("Files", tables=[Table(["file", "contents"], rows, text=(0, 1))])


def _studied(content: Mapping[str, Any]) -> Iterator[list[str]]:
    """Keys of the study and of the rig, a row each, then date and program."""
    for table, values in (("study", content["study"]), ("rig", content["rig"])):
        for key, value in values.items():
            yield [f"{table}.{key}", _value_words(value, content.get("units", {}), f"{table}.{key}")]
    yield ["date (UTC)", datetime.now(UTC).strftime("%Y-%m-%d %H:%M:%S")]
    yield ["program", f"tumblecal {__version__}"]


def _value_words(value: object, units: Mapping[str, str], path: str) -> str:
    """The value at a dotted path with its unit from `units`; the keys of a grid are dotted paths themselves."""
    if isinstance(value, Mapping):
        return "; ".join(f"{key}: {_value_words(part, units, f'{path}.{key}')}" for key, part in value.items())
    text = ", ".join(_value_words(part, units, "") for part in value) if isinstance(value, list | tuple) else str(value)
    unit = units.get(path.removeprefix("study.grid."))
    return f"{text} {unit}" if unit else text

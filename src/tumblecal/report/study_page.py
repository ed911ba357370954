"""The page of a study: what was found, what it means, the figures, the files, and what made them."""

from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import polars as pl

from tumblecal import __version__
from tumblecal.report.page import PageTable, Section, inline_figure, write_page
from tumblecal.report.study_answers import Answer
from tumblecal.report.verdict import Verdict


_QUESTIONS = {
    "coverage": "Are the estimates unbiased, and do the stated intervals hold the truth as often as they say?",
    "sweep": "What does a value of rig, plan, noise or effect do to bias and coverage?",
    "convergence": "How many data sets does each method need to reach a given error?",
    "linearization": "Up to which errors are the small-angle equations good enough?",
    "power": "How large must an effect be for the diagnosis to detect it, and to name it?",
}
_CAPTIONS = {
    "coverage": "Bars are two standard errors: of the bias, of the sd, and of a share of intervals that holds the truth. Below "
    "on the right: how often sums of squares fall into each of 20 bins of equal probability.",
    "sweep": "The worst parameter at each point of the grid.",
    "convergence": "Rms error of the worst parameter of each group, over all runs, against the number of data sets.",
    "data_sets_needed": "From the number of data sets that 10 % of the runs need to that of 90 % (bar); the median (dot). "
    "Right of the grey line: not within the study.",
    "linearization": "Rms bias of the worst parameter over the sd of one data set. Where the points cross a grey line the bias "
    "is as large as the sd after so many data sets. Dashed: the theory's slope of 2.",
    "power": "Share of the runs in which something was detected, and in which the effect was among those named.",
}
_FILES = {
    "parameters": "a row for each parameter (and point): truth, bias, sd, coverage; base units (1, g, rad)",
    "errors": "bias and rms error by method, number of data sets and parameter; base units (1, g, rad)",
    "consistency": "NEES and NIS by method and number of data sets",
    "needed": "data sets needed for each threshold: 10 %, median, 90 % of the runs, and the share that never reaches it",
    "biases": "bias of the linear equations by kind and size (rad) of the errors, equations and parameter; base units",
    "crossings": "size (rad) at which each parameter's bias reaches its sd after so many data sets",
    "rates": "runs, failures and rates by effect and size",
}


def write_study_page(
    folder: Path, kind: str, content: Mapping[str, Any], frames: Mapping[str, pl.DataFrame], answer: Answer,
    figures: Sequence[Path],
) -> Path:  # fmt: skip
    """Write `KIND.html` into the study's folder.

    **Arguments:**

    - `content`: of the JSON file; `frames`: the tables; `answer`: what was found; `figures`: SVG files in the folder.
    """
    path = folder / f"{kind}.html"
    sections = [
        Section("The numbers behind it", tables=[answer.table]),
        Section("Figures", figures=[inline_figure(figure, _CAPTIONS[figure.stem]) for figure in figures]),
        _files(kind, frames, figures),
        Section("What was studied", tables=[PageTable(["", ""], list(_studied(content)), text=(1,))]),
    ]
    title = str(content["title"] or f"Study of {kind}")
    verdict = Verdict("", answer.headline, title, "", evidence=answer.words)
    write_page(path, title, _QUESTIONS[kind], verdict, sections, tone=answer.tone)
    return path


def _files(kind: str, frames: Mapping[str, pl.DataFrame], figures: Sequence[Path]) -> Section:
    rows = [[f"{kind}.json", "everything but the large tables, with the study and the rig as they were read"]]
    rows += [[f"{kind}_{name}.parquet", f"{_FILES[name]} ({len(frame)} rows)"] for name, frame in frames.items()]
    rows += [[figure.name, "a figure of this page"] for figure in figures]
    rows += [["chunks/, manifest.json", "finished parts: the same command goes on from them, and they can be deleted"]]
    return Section("Files", tables=[PageTable(["file", "what it holds"], rows, text=(0, 1))])


def _studied(content: Mapping[str, Any]) -> Iterator[list[str]]:
    """The study's and the rig's keys, a row each, and what computed it."""
    for table, values in (("study", content["study"]), ("rig", content["rig"])):
        for key, value in values.items():
            yield [f"{table}.{key}", _told(value, content.get("units", {}), f"{table}.{key}")]
    yield ["date (UTC)", datetime.now(UTC).strftime("%Y-%m-%d %H:%M:%S")]
    yield ["program", f"tumblecal {__version__}"]


def _told(value: object, units: Mapping[str, str], path: str) -> str:
    """What stands at a dotted path, with the unit that `units` has of it; a grid's keys are dotted paths themselves."""
    if isinstance(value, Mapping):
        return "; ".join(f"{key}: {_told(own, units, f'{path}.{key}')}" for key, own in value.items())
    text = ", ".join(_told(own, units, "") for own in value) if isinstance(value, list | tuple) else str(value)
    unit = units.get(path.removeprefix("study.grid."))
    return f"{text} {unit}" if unit else text

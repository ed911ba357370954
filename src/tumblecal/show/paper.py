"""The study of the paper as files: figures, `study.json`, `page.html`, `findings.txt`."""

import textwrap
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tumblecal.data import paper
from tumblecal.diagnosis import Diagnosis
from tumblecal.estimation import Fit
from tumblecal.estimation.methods import Calibrated
from tumblecal.ground.atomic import write_texts
from tumblecal.ground.json_file import json_text
from tumblecal.ground.numbers_shown import decimals, p_cell, with_decimals
from tumblecal.ground.units import shown
from tumblecal.lab.record import result_content
from tumblecal.planning import NextPlan
from tumblecal.show.diagnosis import harm_in_u, verdict_of_diagnosis
from tumblecal.show.figures.drawing import write_each
from tumblecal.show.figures.paper import AUDIT_FIGURES, FIGURES, GROUPS
from tumblecal.show.fit import TITLES
from tumblecal.show.page import write_page
from tumblecal.show.tables import Table
from tumblecal.show.words import Words, words_of
from tumblecal.studies.paper_audit import Audit
from tumblecal.studies.paper_record import paper_record
from tumblecal.studies.paper_study import PaperStudy


_EARLY = ("running mean", "Kalman, prior sd 0.001", "Kalman, prior sd 0.0003")


def write_paper_study(
    folder: Path, study: PaperStudy, audit: Audit, table1: Calibrated, diagnosis: Diagnosis, plan: NextPlan
) -> list[str]:
    """Write everything into `folder`; `diagnosis` and `plan`: of Table 1. Returns the findings."""
    diagnosed = verdict_of_diagnosis(diagnosis, plan).words().splitlines()
    words = words_of_paper(study, audit, table1.exact, diagnosed, diagnosis)
    findings = words.section("Findings")
    folded = "\n\n".join(textwrap.fill(text, 100) for text in findings) + "\n"
    record = paper_record(study, audit, result_content(table1), findings)
    write_texts(folder, {"study.json": json_text(record), "findings.txt": folded})
    figures = write_each(folder, FIGURES, study)
    figures |= write_each(folder, AUDIT_FIGURES, audit, table1.exact)
    tables = {
        "explanations": _explanations_table(audit),
        "methods": _methods_table(table1),
        "published": _published_table(table1.exact),
    }
    write_page(folder / "page.html", words, figures, tables=tables)
    return findings


def words_of_paper(
    study: PaperStudy, audit: Audit, table1: Fit, diagnosed: Sequence[str], diagnosis: Diagnosis
) -> Words:
    """The words; `diagnosed`: those of the diagnosis of Table 1, a paragraph each."""
    errors = np.abs(study.exact_mean[-1] - study.truth) / (study.single_sd / np.sqrt(len(study.single)))
    difference = np.abs(study.exact_mean[-1] - study.mean[-1]) / study.single_sd
    return words_of(
        "paper",
        study=study,
        audit=audit,
        table1=table1,
        diagnosed=diagnosed,
        error_u=np.max(errors),
        farthest=study.names[int(np.argmax(errors))],
        difference=np.max(difference),
        early=[study.early_error[name] for name in _EARLY],
        groups=[(f"figure{number}_{leaf}", f"Figure {number}. {title}") for leaf, (number, title) in GROUPS.items()],
        d=diagnosis,
        harm=harm_in_u(diagnosis),
    )


def _methods_table(table1: Calibrated) -> Table:
    exact = table1.exact
    others = [result for name, result in table1.fits.items() if name != "exact"]
    header = ["parameter", "unit", "exact", "u", *(TITLES[result.method] for result in others), "simulation truth"]
    rows = []
    for name, base, value, u in zip(exact.names, exact.units, exact.values, exact.sd, strict=True):
        cells = [value, u, *(result.value(name) for result in others), paper.SIMULATION_TRUTH[name]]
        rows.append([name, *_in_unit(base, u, cells)])
    return Table(header, rows)


def _published_table(fit: Fit) -> Table:
    published, rows = paper.table2(), []
    for name, base, value, u in zip(fit.names, fit.units, fit.values, fit.sd, strict=True):
        cells = _in_unit(base, u, [*published[name], value, u])
        rows.append([name, *cells, f"{(published[name][0] - value) / u:+.1f}"])
    return Table(["parameter", "unit", "run 1", "run 2", "run 3", "Table 1, exact", "u", "(run 1 - exact) / u"], rows)


def _in_unit(base: str, u: float, values: Sequence[float]) -> list[str]:
    """The display unit, and the values in it with the decimals of their uncertainty."""
    unit, factor = shown(base)
    return [unit, *(with_decimals(value * factor, decimals(u * factor)) for value in values)]


def _explanations_table(audit: Audit) -> Table:
    third = paper.table3()
    listed = [(e.name, f"{e.f:.2f}", p_cell(e.p_value), e.largest_g, e.smallest_g) for e in audit.explanations]
    for run, (largest, smallest) in enumerate(zip(third["largest"], third["smallest"], strict=True), 1):
        listed.append((f"Table 3 states, run {run}", "", "", largest, smallest))
    rows = [[*row[:3], *(f"{size * 1e3:+.3f}" for size in row[3:])] for row in listed]
    return Table(["parameters", "F", "p", "largest residual / mg", "smallest / mg"], rows)

"""The study of the paper as files: figures, `study.json`, `page.html`, `findings.txt`."""

import textwrap
from pathlib import Path
from typing import Any

import numpy as np

from tumblecal.data import paper
from tumblecal.diagnosis import Diagnosis
from tumblecal.estimation import Fit
from tumblecal.estimation.methods import Calibrated
from tumblecal.ground.atomic import write_texts
from tumblecal.ground.json_file import json_text
from tumblecal.ground.numbers_shown import decimals, p_cell, with_decimals
from tumblecal.ground.units import shown
from tumblecal.planning import NextPlan
from tumblecal.report.calibration_words import TITLES
from tumblecal.report.diagnosis_tables import invisible_table, limits_table
from tumblecal.report.diagnosis_verdict import verdict_of_diagnosis
from tumblecal.report.page import Section, inline_figure, page, write_page
from tumblecal.report.paper_words import findings, paper_verdict
from tumblecal.report.result_file import result_content
from tumblecal.report.tables import Table
from tumblecal.show.figures.drawing import write_each
from tumblecal.show.figures.paper import AUDIT_CAPTION, AUDIT_FIGURES, CAPTIONS, FIGURES
from tumblecal.studies.paper_audit import Audit
from tumblecal.studies.paper_study import PaperStudy


SCHEMA = "tumblecal.reproduction/1"
_FILES = (
    ("study.json", "every number of this page, with residuals and covariances"),
    ("findings.txt", "the findings in words"),
    ("diagnosis/", "the diagnosis of Table 1: diagnosis.html, diagnosis.json, what to measure next"),
    ("*.svg", "the figures"),
)


def write_paper_study(
    folder: Path, study: PaperStudy, audit: Audit, table1: Calibrated, diagnosis: Diagnosis, plan: NextPlan
) -> list[str]:
    """Write everything into `folder`; `diagnosis` and `plan`: of Table 1. Returns the findings."""
    words = findings(study, audit, table1.exact)
    folded = "\n\n".join(textwrap.fill(text, 100) for text in words) + "\n"
    write_texts(folder, {"study.json": json_text(_content(study, audit, table1, words)), "findings.txt": folded})
    _write_page(folder / "page.html", study, audit, table1, diagnosis, plan, words)
    return words


@page
def _write_page(
    path: Path,
    study: PaperStudy,
    audit: Audit,
    table1: Calibrated,
    diagnosis: Diagnosis,
    plan: NextPlan,
    words: list[str],
) -> None:
    folder = path.parent
    study_figures = write_each(folder, FIGURES, study)
    audit_figures = write_each(folder, AUDIT_FIGURES, audit, table1.exact)
    sections = [
        Section(
            "Audit of Table 1",
            ["Residuals of the table that the paper calls measured, under three sets of parameters."],
            tables=[_explanations_table(audit)],
            figures=[inline_figure(folder / name, AUDIT_CAPTION) for name in audit_figures],
        ),
        Section("Table 1 by all methods", tables=[_methods_table(table1)]),
        Section(
            "Comparison with Table 2",
            ["Published parameters of the three runs, and the exact fit of Table 1 (the data of run 1)."],
            tables=[_published_table(table1.exact)],
        ),
        Section(
            "Diagnosis of Table 1",
            [
                *verdict_of_diagnosis(diagnosis, plan).words().splitlines(),
                "Detection limits with these positions, and undetectable effects:",
            ],
            tables=[limits_table(diagnosis), invisible_table(diagnosis)],
        ),
        Section("Findings", words),
        Section(
            "Simulation: the paper's figures 4 to 9",
            figures=[inline_figure(folder / name, CAPTIONS[name]) for name in study_figures],
        ),
        Section("Files", tables=[Table(["file", "contents"], _FILES, text=(0, 1))]),
    ]
    write_page(
        path,
        "Calibration of a MEMS accelerometer triad on a dividing head: the study reproduced",
        "Gao, Chen and Ren 2016, doi 10.19306/j.cnki.2095-8110.2016.03.012, computed again from its own numbers; "
        f"seed {study.seed}.",
        paper_verdict(study, audit, table1.exact, verdict_of_diagnosis(diagnosis).words().splitlines()[0]),
        sections,
        tone="named",
    )


def _methods_table(table1: Calibrated) -> Table:
    exact = table1.exact
    others = [result for name, result in table1.fits.items() if name != "exact"]
    header = ["parameter", "unit", "exact", "u", *(TITLES[result.method] for result in others), "simulation truth"]
    rows = []
    for index, name in enumerate(exact.names):
        unit, factor = shown(exact.units[index])
        cells = [exact.values[index], exact.sd[index], *(result.value(name) for result in others)]
        cells.append(paper.SIMULATION_TRUTH[name])
        places = decimals(exact.sd[index] * factor)
        rows.append([name, unit, *(with_decimals(value * factor, places) for value in cells)])
    return Table(header, rows)


def _published_table(fit: Fit) -> Table:
    published = paper.table2()
    rows = []
    for index, name in enumerate(fit.names):
        unit, factor = shown(fit.units[index])
        cells = [*published[name], fit.values[index], fit.sd[index]]
        places, u = decimals(fit.sd[index] * factor), fit.sd[index]
        difference_u = f"{(published[name][0] - fit.values[index]) / u:+.1f}"
        rows.append([name, unit, *(with_decimals(value * factor, places) for value in cells), difference_u])
    return Table(["parameter", "unit", "run 1", "run 2", "run 3", "Table 1, exact", "u", "(run 1 - exact) / u"], rows)


def _explanations_table(audit: Audit) -> Table:
    third = paper.table3()
    listed = [(e.name, f"{e.f:.2f}", p_cell(e.p_value), e.largest_g, e.smallest_g) for e in audit.explanations]
    for run, (largest, smallest) in enumerate(zip(third["largest"], third["smallest"], strict=True), 1):
        listed.append((f"Table 3 states, run {run}", "", "", largest, smallest))
    rows = [[*row[:3], *(f"{size * 1e3:+.3f}" for size in row[3:])] for row in listed]
    return Table(["parameters", "F", "p", "largest residual / mg", "smallest / mg"], rows)


def _content(study: PaperStudy, audit: Audit, table1: Calibrated, words: list[str]) -> dict[str, Any]:
    final = {
        "running_mean": study.mean,
        "kalman": study.kalman,
        "kalman_diffuse": study.diffuse,
        "exact": study.exact_mean,
    }
    return {
        "schema": SCHEMA,
        "findings": words,
        "simulation": {
            "seed": study.seed,
            "sets": len(study.single),
            "parameters": {
                name: {
                    "unit": study.units[index],
                    "truth": study.truth[index],
                    "single_sd": study.single_sd[index],
                    "final": {name: estimates[-1, index] for name, estimates in final.items()},
                    "scatter_of_single_exact_fits": float(np.std(study.exact[:, index], ddof=1)),
                }
                for index, name in enumerate(study.names)
            },
            "diffuse_kalman_less_running_mean_max_sd": study.kalman_is_running_mean,
            "rms_error_in_sd_after_sets": {name: list(values) for name, values in study.early_error.items()},
        },
        "table1": result_content(table1),
        "table2": {name: list(values) for name, values in paper.table2().items()},
        "table3_g": {name: list(values) for name, values in paper.table3().items()},
        "audit": {
            "explanations": [
                {"parameters": e.name, "f": e.f, "dof": e.dof, "p_value": e.p_value}
                | {"largest_residual_g": e.largest_g, "smallest_residual_g": e.smallest_g}
                for e in audit.explanations
            ],
            "noise": {
                "observed_g": audit.noise.observed_g,
                "dof": audit.noise.dof,
                "implied_white_beyond_100s_g": audit.noise.white_g,
                "implied_floor_g": audit.noise.flicker_g,
                "p_value": audit.noise.p_value,
            },
            "units": {"mean_norm": audit.norm_g, "mean_norm_if_ms2_g": audit.norm_if_ms2_g},
        },
    }

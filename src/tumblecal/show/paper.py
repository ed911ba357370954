"""The study of the paper as files: figures, `study.json`, `page.html`, `findings.txt`."""

import textwrap
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tumblecal.data import paper
from tumblecal.diagnosis import Diagnosis
from tumblecal.estimation.methods import Calibrated
from tumblecal.ground.atomic import write_texts
from tumblecal.ground.json_file import json_text
from tumblecal.lab.record import CalibratedRecord
from tumblecal.planning import NextPlan
from tumblecal.show.diagnosis import harm_in_u, verdict_of_diagnosis
from tumblecal.show.figures.drawing import write_each
from tumblecal.show.figures.paper import AUDIT_FIGURES, FIGURES, GROUPS
from tumblecal.show.fit import TITLES
from tumblecal.show.page import write_page
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
    words = words_of_paper(study, audit, table1, diagnosed, diagnosis)
    findings = words.section("Findings")
    folded = "\n\n".join(textwrap.fill(text, 100) for text in findings) + "\n"
    record = paper_record(study, audit, CalibratedRecord.of(table1), findings)
    write_texts(folder, {"study.json": json_text(record), "findings.txt": folded})
    figures = write_each(folder, FIGURES, study)
    figures |= write_each(folder, AUDIT_FIGURES, audit, table1.exact)
    write_page(folder / "page.html", words, figures)
    return findings


def words_of_paper(
    study: PaperStudy, audit: Audit, table1: Calibrated, diagnosed: Sequence[str], diagnosis: Diagnosis
) -> Words:
    """The words; `diagnosed`: those of the diagnosis of Table 1, a paragraph each."""
    errors = np.abs(study.exact_mean[-1] - study.truth) / (study.single_sd / np.sqrt(len(study.single)))
    difference = np.abs(study.exact_mean[-1] - study.mean[-1]) / study.single_sd
    return words_of(
        "paper",
        study=study,
        audit=audit,
        table1=table1.exact,
        others=[fit for name, fit in table1.fits.items() if name != "exact"],
        titles=TITLES,
        truth=paper.SIMULATION_TRUTH,
        table2=paper.table2(),
        table3=paper.table3(),
        diagnosed=diagnosed,
        error_u=np.max(errors),
        farthest=study.names[int(np.argmax(errors))],
        difference=np.max(difference),
        early=[study.early_error[name] for name in _EARLY],
        groups=[(f"figure{number}_{leaf}", f"Figure {number}. {title}") for leaf, (number, title) in GROUPS.items()],
        d=diagnosis,
        harm=harm_in_u(diagnosis),
    )

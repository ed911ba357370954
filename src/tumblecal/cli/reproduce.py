"""`tumblecal reproduce`: the study of the paper."""

from pathlib import Path

from tumblecal.cli.diagnosis_batch import DIAGNOSIS_SET
from tumblecal.cli.options import seed_in_range


_SET = ("page.html", "study.json", "findings.txt", "figure[4-9]_*.svg", "table1_residuals.svg")
_DIAGNOSIS = "diagnosis"


def reproduce(*, out: Path = Path("study"), seed: int = 0) -> None:
    """Reproduce the study of the paper without further input: simulation, Table 1 by all methods, audit of its tables.

    Parameters
    ----------
    out
        Output folder: page.html, study.json, findings.txt and figures. Example: --out paper.
    seed
        Seed of the simulated noise. Example: --seed 1.
    """
    from tumblecal.cli.start import start

    start()
    seed_in_range(seed)
    from rich.console import Console
    from rich.status import Status

    from tumblecal.data import paper
    from tumblecal.diagnosis import Diagnoser
    from tumblecal.estimation import problem_of
    from tumblecal.estimation.methods import all_methods
    from tumblecal.ground.atomic import output_folders
    from tumblecal.ground.result_set import result_set
    from tumblecal.planning import next_plan
    from tumblecal.report.diagnosis_files import write_diagnosis
    from tumblecal.report.diagnosis_verdict import verdict_of_diagnosis
    from tumblecal.report.paper_report import write_paper_study
    from tumblecal.show.calibration import calibration_text, words_of_calibration
    from tumblecal.show.narrow import print_words
    from tumblecal.show.verdict import WIDTH, verdict_lines
    from tumblecal.studies.paper_audit import audit
    from tumblecal.studies.paper_study import paper_study

    console = Console()
    with output_folders([out]):
        with Status("simulating and estimating 600 data sets", console=console):
            study = paper_study(seed)
        with Status("calibrating Table 1", console=console):
            table1 = all_methods(problem_of(paper.table1()))
            audited = audit(table1.exact)
        with Status("diagnosing Table 1", console=console):
            diagnosis = Diagnoser()(paper.table1())
            plan = next_plan(diagnosis)
        names = (*_SET, *(f"{_DIAGNOSIS}/{name}" for name in DIAGNOSIS_SET))
        with Status("drawing", console=console), result_set(out, names) as aside:
            words = write_paper_study(aside, study, audited, table1, diagnosis, plan)
            verdict = verdict_of_diagnosis(diagnosis, plan, out / _DIAGNOSIS)
            write_diagnosis(aside / _DIAGNOSIS, diagnosis, plan, figures=True, verdict=verdict)
    print_words(console, calibration_text(table1, words_of_calibration(table1), min(WIDTH, console.width)))
    console.print("\nFindings", style="bold")
    for text in words:
        print_words(console, f"\n{text}")
    console.print("\nDiagnosis of Table 1", style="bold")
    for line in verdict_lines(verdict, min(WIDTH, console.width)):
        print_words(console, line)
    console.print(
        f"\nwritten: {out}/page.html (open it), study.json, findings.txt, diagnosis/, 7 figures", highlight=False
    )

"""`tumblecal reproduce`: the study of the paper."""

from pathlib import Path

from tumblecal.cli.command import Command
from tumblecal.cli.diagnosis_batch import DIAGNOSIS_SET
from tumblecal.cli.options import Seed
from tumblecal.cli.result_files import results
from tumblecal.cli.terminal import columns


_DIAGNOSIS = "diagnosis"
_SET = (
    *("page.html", "study.json", "findings.txt", "figure[4-9]_*.svg", "table1_residuals.svg"),
    *(f"{_DIAGNOSIS}/{name}" for name in DIAGNOSIS_SET),
)


def reproduce(*, out: Path = Path("study"), seed: Seed = 0) -> None:
    """Reproduce the study of the paper without further input: simulation, Table 1 by all methods, audit of its tables.

    Parameters
    ----------
    out
        Output folder: page.html, study.json, findings.txt and figures. Example: --out paper.
    seed
        Seed of the simulated noise. Example: --seed 1.
    """
    command = Command()
    command.begin()
    from tumblecal.data import paper
    from tumblecal.diagnosis import Diagnoser
    from tumblecal.estimation import problem_of
    from tumblecal.estimation.methods import all_methods
    from tumblecal.planning import next_plan
    from tumblecal.show.calibration import calibration_text, words_of_calibration
    from tumblecal.show.diagnosis import verdict_of_diagnosis, write_diagnosis
    from tumblecal.show.paper import write_paper_study
    from tumblecal.studies.paper_audit import audit
    from tumblecal.studies.paper_study import paper_study

    with results(out, _SET) as aside:
        with command.working("simulating and estimating 600 data sets"):
            study = paper_study(seed)
        with command.working("calibrating Table 1"):
            table1 = all_methods(problem_of(paper.table1()))
            audited = audit(table1.exact)
        with command.working("diagnosing Table 1"):
            diagnosis = Diagnoser()(paper.table1())
            plan = next_plan(diagnosis)
        with command.working("drawing"):
            words = write_paper_study(aside, study, audited, table1, diagnosis, plan)
            verdict = verdict_of_diagnosis(diagnosis, plan, out / _DIAGNOSIS)
            write_diagnosis(aside / _DIAGNOSIS, diagnosis, plan, figures=True, verdict=verdict)
    command.say(calibration_text(words_of_calibration(table1), columns()), "\nFindings")
    command.say(*(f"\n{text}" for text in words), "\nDiagnosis of Table 1")
    command.print_verdict(verdict)
    command.say(f"\nwritten: {out}/page.html (open it), study.json, findings.txt, diagnosis/, 7 figures")

"""All files of a diagnosis, into one folder."""

from pathlib import Path

from tumblecal.diagnosis import Diagnosis
from tumblecal.ground.atomic import writable_folder, write_text
from tumblecal.planning import NextPlan
from tumblecal.report.diagnosis_calibration import write_extended_calibration
from tumblecal.report.diagnosis_file import record, write_json
from tumblecal.report.next_plan_files import write_next_plan


def write_diagnosis(folder: Path, diagnosis: Diagnosis, plan: NextPlan, *, figures: bool) -> list[str]:
    """Write diagnosis.json, verdict.txt, calibration.json and plans where there are any, the figures and the page.

    **Returns:** their names.
    """
    writable_folder(folder)
    content = record(diagnosis, plan)
    write_json(folder / "diagnosis.json", content)
    write_text(folder / "verdict.txt", content["text"] + "\n")
    names = ["diagnosis.json", "verdict.txt"]
    if write_extended_calibration(folder, diagnosis):
        names.append("calibration.json")
    names += write_next_plan(folder, diagnosis, plan)
    if figures:
        from tumblecal.report.diagnosis_figures import draw_all
        from tumblecal.report.diagnosis_page import write_diagnosis_page

        drawn = draw_all(diagnosis, folder)
        names += [*drawn, write_diagnosis_page(folder / "diagnosis.html", diagnosis, plan, drawn).name]
    return names

"""All files of a diagnosis, into one folder."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from tumblecal.data.calibration import calibration_text
from tumblecal.diagnosis import Diagnosis
from tumblecal.ground.atomic import writable_folder, write_texts
from tumblecal.planning import NextPlan
from tumblecal.report.diagnosis_calibration import extended_calibration
from tumblecal.report.diagnosis_file import json_text, record
from tumblecal.report.extended_rig import NAME as EXTENDED_RIG
from tumblecal.report.extended_rig import extended_rig_text
from tumblecal.report.next_plan_files import write_next_plan
from tumblecal.report.suggested_effect import suggested_effect_text
from tumblecal.report.unnamed_words import SUGGESTED


def write_diagnosis(
    folder: Path, diagnosis: Diagnosis, plan: NextPlan, *, figures: bool, said: Mapping[str, Any] | None = None
) -> list[str]:
    """Write diagnosis.json, verdict.txt; calibration.json, extended_rig.toml, suggested_effect.py and plans if there are any;
    figures and page.

    **Arguments:**

    - `said`: what else the provenance of the calibration says, such as of the head (`MeasuredHead.record`).

    **Returns:** their names.
    """
    if not folder.is_dir():
        writable_folder(folder)
    content, calibration = record(diagnosis, plan, folder), extended_calibration(diagnosis)
    texts = {"diagnosis.json": json_text(content), "verdict.txt": content["text"] + "\n"}
    if calibration is not None:
        provenance = calibration.provenance | dict(said or {})
        texts["calibration.json"] = calibration_text(replace(calibration, provenance=provenance))
    if rig := extended_rig_text(diagnosis):
        texts[EXTENDED_RIG] = rig
    if suggested := suggested_effect_text(diagnosis):
        texts[SUGGESTED] = suggested
    write_texts(folder, texts)
    names = [*texts, *write_next_plan(folder, diagnosis, plan)]
    if figures:
        from tumblecal.report.diagnosis_figures import draw_all
        from tumblecal.report.diagnosis_page import write_diagnosis_page

        drawn = draw_all(diagnosis, folder)
        names += [*drawn, write_diagnosis_page(folder / "diagnosis.html", diagnosis, plan, drawn).name]
    return names

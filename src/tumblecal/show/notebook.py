"""What a calibration and a diagnosis show in a notebook, and how they are saved from there."""

from dataclasses import replace
from pathlib import Path

import polars as pl

from tumblecal.data.calibration import write_calibration
from tumblecal.data.calibration_use import Use
from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import label_words
from tumblecal.effects import Catalogue
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.intrinsic import one_sensor
from tumblecal.estimation.methods import Calibrated
from tumblecal.estimation.plausibility import implausible
from tumblecal.ground.errors import InputError
from tumblecal.ground.showing import Screen
from tumblecal.lab.diagnosed_use import not_written
from tumblecal.lab.record import calibration_of
from tumblecal.show.calibration import words_of_calibration
from tumblecal.show.diagnosis import verdict_of_diagnosis


def calibrated_screen(calibrated: Calibrated) -> Screen:
    """The verdict and the exact fit's parameters."""
    screen = calibrated.exact.screen()
    headline, *reasons = words_of_calibration(calibrated).verdict.words().splitlines()
    return Screen(f"{calibrated.exact.data.source}: {headline}", screen.header, screen.rows, reasons)


def diagnosis_screen(diagnosis: Diagnosis) -> Screen:
    """The verdict and its reasons, and the leading explanations."""
    headline, *reasons = verdict_of_diagnosis(diagnosis).words(lists=False).splitlines()
    rows = [
        (row["explanation"], f"{row['probability']:.3f}", f"{row['alone']:.3f}")
        for row in explanations(diagnosis).head(5).iter_rows(named=True)
    ]
    return Screen(f"{diagnosis.data.source}: {headline}", ("explanation", "probability", "alone"), rows, reasons)


def explanations(diagnosis: Diagnosis) -> pl.DataFrame:
    """The explanations, most probable first; columns as of `Diagnosis.table`."""
    rows = [
        (label_words(e.labels) or "adequate", e.probability, e.own_probability, len(e.equivalents))
        for e in diagnosis.screened.explanations
    ]
    return pl.DataFrame(rows, schema=["explanation", "probability", "alone", "equivalents"], orient="row")


def save_calibrated(path: Path, calibrated: Calibrated) -> None:
    """Write the exact fit's `calibration.json`, with the use that the judgements allow.

    **Raises:** `InputError` as `save_fit`.
    """
    save_fit(path, calibrated.exact, calibrated.entries, calibrated.use)


def save_fit(path: Path, fit: Fit, entries: Catalogue | None = None, use: Use | None = None) -> None:
    """Write a fit's `calibration.json`; `entries`: as of `calibration_of`; `use`: by default judged from this fit alone.

    **Raises:** `InputError` for a fit that did not converge, or of more or less than one sensor.
    """
    if not fit.code.good or not one_sensor(fit):
        why = fit.message if not fit.code.good else "dK, bias and gamma are not one for all data, or all are fixed"
        raise InputError(f"{fit.data.source}: no calibration to save: {why}")
    use = use or Calibrated({"exact": fit}, {}, implausible(fit)).use
    write_calibration(path, replace(calibration_of(fit, entries), use=use))


def save_extended(path: Path, diagnosis: Diagnosis) -> None:
    """Write the `calibration.json` of the extended model.

    **Raises:** `InputError` if there is none, with the reason.
    """
    if diagnosis.calibration is None:
        raise InputError(f"{diagnosis.data.source}: no calibration to save: {not_written(diagnosis)}")
    write_calibration(path, diagnosis.calibration)

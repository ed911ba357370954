"""What a calibration and a diagnosis show in a notebook."""

import polars as pl

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import label_words
from tumblecal.estimation.methods import Calibrated
from tumblecal.ground.showing import Screen
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

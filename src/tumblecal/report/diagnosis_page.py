"""`diagnosis.html`: the verdict record with a picture for each finding, and everything it rests on."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import id_of
from tumblecal.ground.numbers_shown import p_words
from tumblecal.planning.next_plan import NextPlan
from tumblecal.report import diagnosis_tables as tables
from tumblecal.report.calibration_words import sensor_values
from tumblecal.report.cause_words import label_words
from tumblecal.report.diagnosis_details import CAUSES, CHANGES, GAIN, HELD, LACKING, UNCERTAINTIES, UNDETERMINED
from tumblecal.report.diagnosis_verdict import verdict_of_diagnosis
from tumblecal.report.page import TONES, PageFigure, Section, chosen, inline_figure, page, write_page
from tumblecal.report.tables import Table
from tumblecal.report.verdict import NOT_TESTABLE, UNDETECTABLE, Verdict
from tumblecal.show.figures.finding import FindingSignal, card_figures, finding_signals
from tumblecal.show.figures.unnamed import CAPTION as UNNAMED_CAPTION


CAPTIONS = {
    "unexplained.svg": UNNAMED_CAPTION,
    "residuals_by_angle.svg": (
        "Measured minus predicted against the spindle angle. The band is two standard deviations of the noise."
    ),
    "residuals_by_column.svg": (
        "The same against each axis's input, the pitch angle, time or measuring order, and temperature."
    ),
    "residual_harmonics.svg": (
        "Harmonics of the spindle angle in the residuals (c: cosine, s: sine), in units of the standard deviation that "
        "they have if the model is correct; bold beyond 3. A cross: fitted parameters absorb this harmonic completely."
    ),
    "predictive.svg": (
        "Above: statistics of the residuals (marks) and of 2000 data sets simulated from the fitted model (bars: 95 % and "
        "50 % of them, tick: median), each scaled to its limits; 1 % of simulated data sets lie outside any one limit. "
        "Below: sorted residuals against normal quantiles, with the range of 99 % of the simulated data; neighbouring "
        "points are correlated, so several points slightly outside are not significant."
    ),
    "limits.svg": (
        "Detection limit of each effect divided by a size met in practice (in brackets). In the shaded part an effect of "
        "that size would be found; right of the line it could be present undetected. Lines join the coefficients of one effect."
    ),
}
_OF_RESIDUALS = ("residuals_by_angle.svg", "residuals_by_column.svg", "residual_harmonics.svg")
# Details of the record that the part of the calibration repeats in full, and those that the tables and cards show.
_OF_CALIBRATION = (UNDETERMINED, UNCERTAINTIES, HELD, LACKING)
_IN_TABLES = (CHANGES, GAIN, CAUSES, UNDETECTABLE, NOT_TESTABLE)


@page
def write_diagnosis_page(
    path: Path, diagnosis: Diagnosis, plan: NextPlan, figures: Sequence[str], verdict: Verdict | None = None
) -> None:
    """Write the page.

    `path`: the HTML file. `diagnosis`; `plan`: what to measure next. `figures`: names of the SVG files in the same folder; they
    are put into the page. `verdict`: the record that is drawn; by default that of the diagnosis, with commands for the page's
    folder.
    """
    verdict = verdict or verdict_of_diagnosis(diagnosis, plan, path.parent)
    signals = finding_signals(diagnosis)
    drawn = {name: inline_figure(path.parent / name, _caption(diagnosis, signals, verdict, name)) for name in figures}
    write_page(
        path,
        f"Diagnosis of {verdict.source}",
        _lead(diagnosis),
        verdict,
        _sections(diagnosis, drawn, dict(verdict.details)),
        tone=TONES[diagnosis.verdict],
        pictures=card_figures(diagnosis, signals),
        plans=list(_plans(plan)),
        values=[] if diagnosis.calibration is None else sensor_values(diagnosis.in_use.as_fit),
    )


def _caption(diagnosis: Diagnosis, signals: dict[int, FindingSignal], verdict: Verdict, name: str) -> str:
    if name.startswith("finding_"):
        number = int(name.removeprefix("finding_").removesuffix(".svg"))
        finding, signal = verdict.found[number - 1], signals[number]
        entry = diagnosis.entries.get(id_of(signal.label))
        physics = "" if entry is None or not entry.physics else f" Model: {entry.physics}"
        source = "" if entry is None or not entry.source else f" ({entry.source})"
        return f"{number}. {finding.words}.{physics}{source}"
    marks = " Grey rings: nominal model; filled: extended model."
    both = name.startswith("residuals_by") and diagnosis.extended is not diagnosis.nominal
    shared = _SHARED if name.startswith("residuals_by") and diagnosis.problem.correlated else ""
    return CAPTIONS[name] + (marks if both else "") + shared


def _lead(diagnosis: Diagnosis) -> str:
    data = diagnosis.data
    parts = [f"{len(data)} positions, {len(np.unique(data.pitch_setting_deg))} pitch settings"]
    several = {"runs": len(data.runs), "mountings": len(set(data.mount or ()))}
    parts += [f"{count} {name}" for name, count in several.items() if count > 1]
    return f"{', '.join(parts)}, {_noise(diagnosis)}. ± is the standard uncertainty u."


def _noise(diagnosis: Diagnosis) -> str:
    """Source of the noise, and its standard deviation: of all readings, or the smallest and the largest."""
    sd = 1e3 * diagnosis.level * diagnosis.problem.sd
    low, high = float(np.min(sd)), float(np.max(sd))
    size = f"{low:.3g} mg" if high < 1.005 * low else f"{low:.3g} to {high:.3g} mg"
    corrected = ", corrected to" if diagnosis.noise_labels else ""
    if diagnosis.samples is not None:
        level = "" if diagnosis.problem.known else ", its level estimated from the residuals"
        return f"noise of {diagnosis.samples.origin}{level}, {size}"
    return (
        f"stated noise{corrected} {size}" if diagnosis.problem.known else f"noise estimated from the residuals, {size}"
    )


def _sections(diagnosis: Diagnosis, drawn: dict[str, PageFigure], details: dict[str, str]) -> Iterator[Section]:
    inserted = diagnosis.extended is not diagnosis.nominal
    yield Section(
        "Evidence",
        words=[*([_GAIN] if inserted else []), *_outside(diagnosis)],
        tables=[tables.gain_table(diagnosis)] if inserted else [],
        figures=chosen(drawn, "predictive.svg"),
    )
    yield Section(
        "Alternatives",
        words=[_PROBABILITIES],
        tables=[*tables.class_tables(diagnosis.factors, diagnosis.best), tables.explanations_table(diagnosis)],
    )
    found = [name for name in drawn if name.startswith("finding_")]
    lacking = bool(drawn) and "residual_harmonics.svg" not in drawn
    yield Section(
        "Residuals",
        words=[*([_COMPONENTS] if found else []), *([_NO_HARMONICS] if lacking else [])],
        figures=chosen(drawn, "unexplained.svg", *found, *_OF_RESIDUALS),
    )
    changed = [f"{name}: {details[name]}" for name in _OF_CALIBRATION if name in details]
    yield Section(
        CHANGES if inserted else "Calibration",
        words=[_INSERTED if inserted else _NOTHING_INSERTED, *changed, _IN_USE],
        tables=[tables.parameters_table(diagnosis)],
    )
    yield _limits(diagnosis, drawn)
    others = [[name, text] for name, text in details.items() if name not in (*_OF_CALIBRATION, *_IN_TABLES)]
    yield _provenance(diagnosis, others)


# For residuals under correlated noise.
_SHARED = (
    " The noise is correlated. These points include the part that neighbouring positions share, the tests do not. Several "
    "neighbours may therefore be outside the band."
)
_GAIN = "The improvement of the held-out error is measured on data that the fit does not use. ± is its standard uncertainty."
_PROBABILITIES = (
    "Posterior probability of each class of indistinguishable explanations, and of its first member alone (linear screen, "
    "among the catalogued causes)."
)
_COMPONENTS = (
    "One panel for each finding, the largest first. Grey: measured minus predicted by the extended model without this effect. "
    "Line: the fitted effect."
)
_NO_HARMONICS = "Harmonics of the spindle angle are not shown: no pitch setting has four or more spindle angles."
_IN_USE = (
    "Bias and scale factors refer to the mean time, to the mean over runs and pitch settings, and to the mean temperature if "
    "no term of temperature is in the file. The standard uncertainty u is that of calibration.json. Its contributions add in "
    "quadrature: noise, other explanations, and undetected effects of the size that these data make probable."
)
_INSERTED = "The values are those of calibration.json, with the causes found in the model."
_NOTHING_INSERTED = "The values are those of the nominal model."
_LIMITS = "Smallest size of each coefficient that is detected with 80 % probability in data like these."
_ABSORBED = (
    "Fitted parameters absorb the following effects, wholly or in the stated direction, so the residuals do not show them at "
    "any size. Last column: error that an effect of the stated size would cause."
)


def _outside(diagnosis: Diagnosis) -> Iterator[str]:
    """Posterior predictive check: the statistics outside their limits, before and after."""
    for name, checks in (("nominal", diagnosis.checks), ("extended", diagnosis.checks_after)):
        outside = [check.name for check in checks if check.outside]
        if name == "nominal" or diagnosis.extended is not diagnosis.nominal:
            result = f"outside their limits: {', '.join(outside)}" if outside else "all within their limits"
            yield f"Posterior predictive check of the {name} model, {len(checks)} statistics: {result}."


def _limits(diagnosis: Diagnosis, drawn: dict[str, PageFigure]) -> Section:
    figures = [replace(figure, on_paper=False) for figure in chosen(drawn, "limits.svg")]
    listed = [replace(tables.limits_table(diagnosis), folded=bool(figures))] if diagnosis.limits else []
    parts = {tables.invisible_table: diagnosis.invisible, tables.not_testable_table: diagnosis.model.not_testable}
    return Section(
        "Detection limits",
        words=[*([_LIMITS] if diagnosis.limits else []), *([_ABSORBED] if diagnosis.invisible else [])],
        tables=[*listed, *(table(diagnosis) for table, content in parts.items() if content)],
        figures=figures,
    )


def _plans(plan: NextPlan) -> Iterator[Table]:
    yield from (tables.next_table(positions) for positions in (plan.together, plan.singles) if positions)
    if plan.confirming:
        yield tables.confirming_table(plan.confirming, label_words(plan.confirming[0].rival) or "nominal model")


def _provenance(diagnosis: Diagnosis, others: Sequence[Sequence[str]]) -> Section:
    test = diagnosis.screened.detection
    rows = [
        ["data", diagnosis.data.source],
        *([key, value] for key, value in diagnosis.data.comments.items()),
        ["positions in the fit", f"{int(diagnosis.extended.retained.sum())} of {len(diagnosis.data)}"],
        ["noise", _noise(diagnosis)],
        *([["noise model", diagnosis.noise_words]] if diagnosis.noise_words else []),
        ["residual standard deviation with the best explanation", f"{diagnosis.sigma_g * 1e3:.4g} mg"],
        ["degrees of freedom", f"{diagnosis.nominal.dof} nominal, {diagnosis.extended.dof} extended"],
        ["test", f"statistic {test.statistic:.3g}, threshold {test.threshold:.3g}, {p_words(test.p_value)}"],
        ["effects in the catalogue", f"{len(diagnosis.entries)}"],
        *others,
    ]
    return Section("Provenance", tables=[Table(["", ""], rows, text=(1,))])

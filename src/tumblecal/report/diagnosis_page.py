"""`diagnosis.html`: all of a diagnosis on one page that opens anywhere and prints."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import Cause, id_of
from tumblecal.effects import Effect
from tumblecal.ground.numbers_shown import p_words
from tumblecal.planning.next_plan import SEPARATE, NextPlan
from tumblecal.report import diagnosis_tables as tables
from tumblecal.report.cause_words import (
    by_family,
    identical_words,
    label_words,
    less_simple_words,
    other_axes,
    patchwork_words,
    size_words,
    unexplained_terms,
)
from tumblecal.report.diagnosis_details import undetermined_words
from tumblecal.report.diagnosis_verdict import verdict_of_diagnosis
from tumblecal.report.page import TONES, PageCard, PageFigure, PageTable, Section, headed, inline_figure, write_page
from tumblecal.report.unnamed_figure import CAPTION as UNNAMED_CAPTION


# Figures of what the table beside them says: not printed.
_IN_TABLES = ("explanations.svg", "limits.svg")
_OF_RESIDUALS = ("residuals_by_angle.svg", "residuals_by_column.svg", "residual_harmonics.svg")
_CAPTIONS = {
    "unexplained.svg": UNNAMED_CAPTION,
    "explanations.svg": "Posterior probability of the leading explanations.",
    "residuals_by_angle.svg": (
        "Measured minus predicted against the spindle angle. The band is two standard deviations of the noise."
    ),
    "residuals_by_column.svg": (
        "The same against each axis's own input, the pitch angle, time or measuring order, and temperature."
    ),
    "residual_harmonics.svg": (
        "Harmonics of the spindle angle in the residuals (c: cosine, s: sine), in units of the standard deviation that "
        "they have when the model is right; beyond 3 (bold) something is left over. A cross: the fitted parameters take "
        "up this harmonic whole, nothing can be seen of it."
    ),
    "predictive.svg": (
        "Above: statistics of the residuals (marks) and of 2000 data sets simulated from the fitted model (bars: 95 % and "
        "50 % of them, the tick their median), each scaled to its limits; one percent of right models' data lie outside of "
        "any of them. The numbers are the measured value and the limits. Below: sorted residuals against normal quantiles, "
        "with the range of 99 % of the simulated data at each place; neighbouring places go together, so a row of points "
        "a little outside says little."
    ),
    "limits.svg": (
        "Detection limit of each effect divided by a size met in practice (in brackets). In the shaded part an effect of "
        "that size would be found; right of the line it could still be hidden. Lines join the coefficients of one effect."
    ),
}


def write_diagnosis_page(path: Path, diagnosis: Diagnosis, plan: NextPlan, figures: Sequence[str]) -> Path:
    """Write the page.

    **Arguments:**

    - `path`: the HTML file.
    - `diagnosis`; `plan`: what to measure next.
    - `figures`: names of the SVG files that lie beside it; they are put into the page.
    """
    drawn = {name: inline_figure(path.parent / name, _caption(diagnosis, name)) for name in figures}
    drawn |= {name: replace(drawn[name], on_paper=False) for name in _IN_TABLES if name in drawn}
    verdict = verdict_of_diagnosis(diagnosis, plan)
    headline, lines = headed(verdict.words(lists=False).replace(" -> ", " → "))
    write_page(
        path,
        f"Diagnosis of {Path(diagnosis.data.source).name}",
        _lead(diagnosis),
        lines,
        list(_sections(diagnosis, plan, drawn)),
        headline=headline,
        tone=TONES[diagnosis.verdict],
    )
    return path


def _caption(diagnosis: Diagnosis, name: str) -> str:
    marks = (
        " Grey rings: the nominal model; filled: the extended one. The line: what the causes explain of the nominal residuals, "
        "where that follows from the angle, the time or the temperature."
    )
    both = name.startswith("residuals_by") and diagnosis.extended is not diagnosis.nominal
    shared = _SHARED if name.startswith("residuals_by") and diagnosis.problem.correlated else ""
    return _CAPTIONS[name] + (marks if both else "") + shared


def _lead(diagnosis: Diagnosis) -> str:
    data = diagnosis.data
    parts = [f"{len(data)} positions at {len(np.unique(data.pitch_setting_deg))} pitch settings"]
    if len(data.runs) > 1:
        parts.append(f"{len(data.runs)} runs")
    if data.mount is not None and len(set(data.mount)) > 1:
        parts.append(f"{len(set(data.mount))} mountings")
    return ", ".join(parts) + "; " + _noise(diagnosis) + "."


def _noise(diagnosis: Diagnosis) -> str:
    """Where the noise comes from, and its sd: of all readings, or the smallest and the largest."""
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


def _sections(diagnosis: Diagnosis, plan: NextPlan, drawn: dict[str, PageFigure]) -> Iterator[Section]:
    inserted = diagnosis.extended is not diagnosis.nominal
    yield _causes(diagnosis)
    yield from _next(plan)
    if inserted:
        yield Section(
            "What was gained",
            words=[
                "The gain is measured where nothing was tuned: predictions of data that took no part in the fit, and the "
                "error expected of a new measurement at the same positions. ± is the standard error of the gain."
            ],
            tables=[tables.gain_table(diagnosis)],
        )
    yield Section(
        "Explanations",
        words=[
            "Probability that the truth is this set of causes or one of those that these data cannot tell from it; beside "
            "it the share of this set alone. Probabilities are of the linear screen and of the causes in the catalogue."
        ],
        tables=[tables.explanations_table(diagnosis)],
        figures=_chosen(drawn, "explanations.svg"),
    )
    yield Section(
        "Residuals",
        words=[] if "residual_harmonics.svg" in drawn else [_NO_HARMONICS],
        figures=_chosen(drawn, "unexplained.svg", *_OF_RESIDUALS),
    )
    yield Section(
        "Does the fitted model make such data?", _outside(diagnosis), figures=_chosen(drawn, "predictive.svg")
    )
    yield Section(
        "How far the calibration moved" if inserted else "The calibration",
        words=list(
            filter(None, [_INSERTED if inserted else _NOTHING_INSERTED, undetermined_words(diagnosis), _IN_USE])
        ),
        tables=[tables.parameters_table(diagnosis)],
    )
    yield from _cannot_say(diagnosis, drawn)
    yield _provenance(diagnosis)


# Of residuals under correlated noise.
_SHARED = (
    " The noise is correlated: what neighbouring positions share is still in these points, though not in the tests, so that "
    "they may wander out of the band together."
)
_NO_HARMONICS = "Harmonics of the spindle angle are not shown: no pitch setting has four or more spindle angles."
_LOOK = "Look for what changes in this way; measure once more in another order to see whether it follows the angles or time."
_IN_USE = (
    "The values hold for the mean time, all runs and settings alike (what a given model itself has of time, runs or settings: "
    "where that is zero), and for the mean temperature if no term of temperature is written. The standard uncertainty u is "
    "that of calibration.json. Its contributions add in quadrature: the noise, the other explanations that remain, and effects "
    "that were not detected, of the size that these data make probable."
)
_INSERTED = "The values are those of calibration.json, with the named causes in the model."
_NOTHING_INSERTED = "Nothing was inserted in the model: these are the estimates of the nominal one."


def _chosen(drawn: dict[str, PageFigure], *names: str) -> list[PageFigure]:
    return [drawn[name] for name in names if name in drawn]


def _causes(diagnosis: Diagnosis) -> Section:
    cards = [
        PageCard(mix_up.label, [("found", mix_up.told), *_bench(diagnosis.entries[mix_up.label])])
        for mix_up in dict.fromkeys(diagnosis.mix_ups)
    ]
    cards += [
        PageCard(label, [("found", diagnosis.noise_wrong[label].words), *_bench(diagnosis.entries[label])])
        for label in diagnosis.noise_labels
    ]
    cards += [_member(diagnosis, own) for own in by_family(cause for cause in diagnosis.members if cause.named)]
    generic = [("depends like", words) for words in unexplained_terms(diagnosis)]
    if generic:
        facts = [*generic, ("what it is", "No entry of the catalogue describes it; it is not named.")]
        cards.append(PageCard("unexplained", [*facts, ("on the bench", _LOOK)]))
    words = [] if cards else ["None: nothing in these data contradicts the model."]
    words += [*identical_words(diagnosis.best), *(f"{words}." for words in less_simple_words(diagnosis.best))]
    if diagnosis.best.separable:
        same = "; ".join(label_words(labels) for labels in diagnosis.best.separable[:8])
        more = len(diagnosis.best.separable) - 8
        words.append(
            f"These data cannot tell what follows from: {same}{f'; and {more} more' if more > 0 else ''}. The one most "
            f"probable by itself is shown. {patchwork_words(diagnosis)}".rstrip()
        )
    return Section("Causes", words=words, cards=cards)


def _member(diagnosis: Diagnosis, causes: Sequence[Cause]) -> PageCard:
    """A cause with its coefficients or its position; several that differ in their axis alone."""
    first = causes[0]
    entry, positions = diagnosis.entries[id_of(first.label)], first.label.partition(":")[2].replace("+", " and ")
    sizes = (size for cause in causes for size in size_words(diagnosis, cause))
    facts = [(kind, words.replace("+-", "±")) for kind, words in sizes]
    if positions:
        facts.append(("position", positions + (f" ({first.words})" if first.words else "")))
    title = label_words(tuple(id_of(cause.label) for cause in causes))
    symbol = f" ({entry.symbol})" if entry.symbol and len(causes) == 1 else ""
    beside = [("other axes", other_axes(causes))] if len(causes) > 1 else []
    return PageCard(title + symbol, [*facts, *_bench(entry), *beside])


def _bench(entry: Effect) -> list[tuple[str, str]]:
    facts = [("what it is", entry.cause), ("on the bench", entry.advice), ("in the model", entry.physics)]
    return [(name, text) for name, text in [*facts, ("source", entry.source)] if text]


def _outside(diagnosis: Diagnosis) -> list[str]:
    """Which statistics are not as the model would make them, before and after."""
    lines = []
    for name, checks in (("nominal", diagnosis.checks), ("extended", diagnosis.checks_after)):
        outside = [check.name for check in checks if check.outside]
        if name == "nominal" or diagnosis.extended is not diagnosis.nominal:
            said = f"not as it would make them: {', '.join(outside)}" if outside else "all as it would make them"
            lines.append(f"Residuals of the {name} model, {len(checks)} statistics: {said}.")
    return lines


def _cannot_say(diagnosis: Diagnosis, drawn: dict[str, PageFigure]) -> Iterator[Section]:
    if diagnosis.limits:
        yield Section(
            "Detection limits",
            words=[
                "The size that each coefficient must have, by itself, to be found with 80 % probability in data like "
                "these. Smaller ones could still be there."
            ],
            figures=_chosen(drawn, "limits.svg"),
        )
        yield Section("Detection limits in numbers", tables=[tables.limits_table(diagnosis)])
    if diagnosis.invisible:
        yield Section(
            "What these positions cannot show",
            words=[
                "The fitted parameters take up these effects, or directions of them, whole: no residual tells of them, "
                "however large they are. They still falsify the calibration: what one of the size stated, met in practice, "
                "would do."
            ],
            tables=[tables.invisible_table(diagnosis)],
        )
    if diagnosis.model.not_testable:
        yield Section("Not testable", tables=[tables.not_testable_table(diagnosis)])


def _next(plan: NextPlan) -> Iterator[Section]:
    if plan.singles or plan.together:
        yield _measure_next(plan)
    if plan.confirming:
        rival = label_words(plan.confirming[0].rival)
        yield Section(
            "Confirm it",
            words=[
                "Readings that test what was named: where it and "
                + (f"{rival}, its strongest rival," if rival else "the nominal model, refitted to these data,")
                + " predict different ones. Each sd is that of the reading less the prediction before it. What drifts is "
                "counted on in time, at the median temperature."
            ],
            tables=[tables.confirming_table(plan.confirming)],
        )


def _measure_next(plan: NextPlan) -> Section:
    worth = (
        "Worth: what it adds to the expected log Bayes factor between the explanations (3 decides)"
        if plan.purpose == SEPARATE
        else "Worth: the share by which it lowers that standard deviation"
    )
    words = [f"To {plan.purpose}. {worth}; in the first table beside those above it, in the last for each alone."]
    chosen = [positions for positions in (plan.together, plan.singles) if positions]
    return Section(
        "Measure next", words=[*words, *plan.notes], tables=[tables.next_table(positions) for positions in chosen]
    )


def _provenance(diagnosis: Diagnosis) -> Section:
    test = diagnosis.screened.detection
    rows = [
        ["data", diagnosis.data.source],
        *([key, value] for key, value in diagnosis.data.comments.items()),
        ["positions in the fit", f"{int(diagnosis.extended.kept.sum())} of {len(diagnosis.data)}"],
        ["noise", _noise(diagnosis)],
        *([["noise model", diagnosis.noise_words]] if diagnosis.noise_words else []),
        ["residual sd after the best explanation", f"{diagnosis.sigma_g * 1e3:.4g} mg"],
        ["degrees of freedom", f"{diagnosis.nominal.dof} nominal, {diagnosis.extended.dof} extended"],
        ["test", f"statistic {test.statistic:.3g}, threshold {test.threshold:.3g}, {p_words(test.p_value)}"],
        ["entries of the catalogue", f"{len(diagnosis.entries)}"],
    ]
    return Section("Provenance", tables=[PageTable(["", ""], rows, text=(1,))])

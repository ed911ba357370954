"""`diagnosis.html`: all of a diagnosis on one page that opens anywhere and prints."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from tumblecal.diagnosis.candidates import Candidate
from tumblecal.diagnosis.diagnose import Diagnosis
from tumblecal.diagnosis.next_positions import SEPARATE
from tumblecal.diagnosis.verdict import coefficients, label_words, p_words, verdict_text
from tumblecal.effects import Effect
from tumblecal.report import diagnosis_tables as tables
from tumblecal.report.page import PageCard, PageFigure, PageTable, Section, inline_figure, write_page


_TONES = {"adequate": "good", "identified": "named", "ambiguous": "open", "unexplained": "bad"}
_CAPTIONS = {
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


def write_diagnosis_page(path: Path, found: Diagnosis, figures: Sequence[str]) -> Path:
    """Write the page.

    **Arguments:**

    - `path`: the HTML file.
    - `found`: the diagnosis.
    - `figures`: names of the SVG files that lie beside it; they are put into the page.
    """
    drawn = {name: inline_figure(path.parent / name, _caption(found, name)) for name in figures}
    head, *lines = verdict_text(found).replace("+- ", "± ").replace(" -> ", " → ").splitlines()
    word, _, rest = head.partition(": ")
    write_page(
        path,
        f"Diagnosis of {Path(found.data.source).name}",
        _lead(found),
        lines,
        list(_sections(found, drawn)),
        headline=f"{word.capitalize()}: {rest}",
        tone=_TONES[found.verdict],
    )
    return path


def _caption(found: Diagnosis, name: str) -> str:
    marks = " Grey rings: the nominal model; filled: the extended one."
    both = name.startswith("residuals_by") and found.extended is not found.nominal
    shared = _SHARED if name.startswith("residuals_by") and found.how.whiten is not None else ""
    return _CAPTIONS[name] + (marks if both else "") + shared


def _lead(found: Diagnosis) -> str:
    data = found.data
    parts = [f"{len(data)} positions at {len(np.unique(data.beta_deg))} pitch settings"]
    if len(data.runs) > 1:
        parts.append(f"{len(data.runs)} runs")
    if data.mount is not None and len(set(data.mount)) > 1:
        parts.append(f"{len(set(data.mount))} mountings")
    return ", ".join(parts) + "; " + _noise(found) + "."


def _noise(found: Diagnosis) -> str:
    """Where the noise comes from, and its sd: of all readings, or the smallest and the largest."""
    sd = (1e3 if found.how.known else 1e3 * found.extended.sigma) / found.how.weights
    low, high = float(np.min(sd)), float(np.max(sd))
    size = f"{low:.3g} mg" if high < 1.005 * low else f"{low:.3g} to {high:.3g} mg"
    corrected = ", corrected to" if found.noise_labels else ""
    if found.samples is not None:
        level = "" if found.how.known else ", its level estimated from the residuals"
        return f"noise of {found.samples.origin}{level}, {size}"
    return f"stated noise{corrected} {size}" if found.how.known else f"noise estimated from the residuals, {size}"


def _sections(found: Diagnosis, drawn: dict[str, PageFigure]) -> Iterator[Section]:
    inserted = found.extended is not found.nominal
    yield _causes(found)
    if inserted:
        yield Section(
            "What was gained",
            words=[
                "The gain is measured where nothing was tuned: predictions of data that took no part in the fit, and the "
                "error expected of a new measurement at the same positions. ± is the standard error of the gain."
            ],
            tables=[tables.gain_table(found)],
        )
    yield Section(
        "Explanations",
        words=[
            "Probability that the truth is this set of causes or one of those that these data cannot tell from it; beside "
            "it the share of this set alone. Probabilities are of the linear screen and of the causes in the catalogue."
        ],
        tables=[tables.explanations_table(found)],
        figures=_chosen(drawn, "explanations.svg"),
    )
    yield Section(
        "Residuals",
        words=[] if "residual_harmonics.svg" in drawn else [_NO_HARMONICS],
        figures=_chosen(drawn, "residuals_by_angle.svg", "residuals_by_column.svg", "residual_harmonics.svg"),
    )
    yield Section("Does the fitted model make such data?", _outside(found), figures=_chosen(drawn, "predictive.svg"))
    yield Section(
        "How far the calibration moved" if inserted else "The calibration",
        words=["Standard deviations are those of the extended model."] if inserted else [_NOTHING_INSERTED],
        tables=[tables.parameters_table(found)],
    )
    yield from _cannot_say(found, drawn)
    yield from _next(found)
    yield _provenance(found)


# Of residuals under correlated noise.
_SHARED = (
    " The noise is correlated: what neighbouring positions share is still in these points, though not in the tests, so that "
    "they may wander out of the band together."
)
_NO_HARMONICS = "Harmonics of the spindle angle are not shown: no pitch setting has four or more spindle angles."
_LOOK = "Look for what changes in this way; measure once more in another order to see whether it follows the angles or time."
_NOTHING_INSERTED = "Nothing was inserted in the model: these are the estimates of the nominal one."


def _chosen(drawn: dict[str, PageFigure], *names: str) -> list[PageFigure]:
    return [drawn[name] for name in names if name in drawn]


def _causes(found: Diagnosis) -> Section:
    cards = [
        PageCard(one.label, [("found", one.words), *_bench(found.entries[one.label])])
        for one in dict.fromkeys(found.mix_ups)
    ]
    cards += [
        PageCard(label, [("found", found.noise_found[label]), *_bench(found.entries[label])])
        for label in found.noise_labels
    ]
    cards += [_member(found, one) for one in found.members if one.family != "generic"]
    generic = [("depends like", one.words) for one in found.members if one.family == "generic"]
    if generic:
        facts = [*generic, ("what it is", "No entry of the catalogue describes it; it is not named.")]
        cards.append(PageCard("unexplained", [*facts, ("on the bench", _LOOK)]))
    words = [] if cards else ["None: nothing in these data contradicts the model."]
    if found.best.equivalents:
        same = "; ".join(label_words(labels) for labels in found.best.equivalents[:8])
        more = len(found.best.equivalents) - 8
        words.append(
            f"These data cannot tell what follows from: {same}{f'; and {more} more' if more > 0 else ''}. The one most "
            "probable by itself is shown."
        )
    return Section("Causes", words=words, cards=cards)


def _member(found: Diagnosis, one: Candidate) -> PageCard:
    """A cause with its coefficients or its position."""
    entry = found.entries[one.id]
    if one.slot is None:
        where = one.label.partition(":")[2].replace("+", " and ") + (f" ({one.words})" if one.words else "")
        return PageCard(one.id, [("position", where), *_bench(entry)])
    sizes = [
        ("coefficient", f"{name} = {value['value']:.3g} ± {value['sd']:.2g} {value['unit']}")
        for name, value in coefficients(found, one).items()
    ]
    return PageCard(one.id + (f" ({entry.symbol})" if entry.symbol else ""), [*sizes, *_bench(entry)])


def _bench(entry: Effect) -> list[tuple[str, str]]:
    facts = [("what it is", entry.cause), ("on the bench", entry.advice), ("in the model", entry.physics)]
    return [(name, text) for name, text in [*facts, ("source", entry.source)] if text]


def _outside(found: Diagnosis) -> list[str]:
    """Which statistics are not as the model would make them, before and after."""
    lines = []
    for name, checks in (("nominal", found.checks), ("extended", found.checks_after)):
        outside = [check.name for check in checks if check.outside]
        if name == "nominal" or found.extended is not found.nominal:
            said = f"not as it would make them: {', '.join(outside)}" if outside else "all as it would make them"
            lines.append(f"Residuals of the {name} model, {len(checks)} statistics: {said}.")
    return lines


def _cannot_say(found: Diagnosis, drawn: dict[str, PageFigure]) -> Iterator[Section]:
    if found.limits:
        yield Section(
            "Detection limits",
            words=[
                "The size that each coefficient must have, by itself, to be found with 80 % probability in data like "
                "these. Smaller ones could still be there."
            ],
            figures=_chosen(drawn, "limits.svg"),
        )
        yield Section("Detection limits in numbers", tables=[tables.limits_table(found)])
    if found.invisible:
        yield Section(
            "What these positions cannot show",
            words=[
                "The fitted parameters take up these effects, or directions of them, whole: no residual tells of them, "
                "however large they are. They still falsify the calibration: what one of the size stated, met in practice, "
                "would do."
            ],
            tables=[tables.invisible_table(found)],
        )
    if found.model.not_testable:
        yield Section("Not testable", tables=[tables.not_testable_table(found)])


def _next(found: Diagnosis) -> Iterator[Section]:
    plan = found.next_plan
    if not plan.singles:
        return
    worth = (
        "Worth: what it adds to the expected log Bayes factor between the explanations (3 decides)"
        if plan.purpose == SEPARATE
        else "Worth: the share by which it lowers that standard deviation"
    )
    words = [f"To {plan.purpose}. {worth}; in the first table beside those above it, in the last for each alone."]
    chosen = [one for one in (plan.together, plan.singles) if one]
    yield Section("Measure next", words=[*words, *plan.notes], tables=[tables.next_table(one) for one in chosen])


def _provenance(found: Diagnosis) -> Section:
    test = found.screened.detection
    rows = [
        ["data", found.data.source],
        *([key, value] for key, value in found.data.comments.items()),
        ["positions in the fit", f"{int(found.extended.keep.sum())} of {len(found.data)}"],
        ["noise", _noise(found)],
        *([["noise model", found.noise_words]] if found.noise_words else []),
        ["residual sd after the best explanation", f"{found.sigma_g * 1e3:.4g} mg"],
        ["degrees of freedom", f"{found.nominal.dof} nominal, {found.extended.dof} extended"],
        ["test", f"statistic {test.statistic:.3g}, threshold {test.threshold:.3g}, {p_words(test.p_value)}"],
        ["entries of the catalogue", f"{len(found.entries)}"],
    ]
    return Section("Provenance", tables=[PageTable(["", ""], rows, text=(1,))])

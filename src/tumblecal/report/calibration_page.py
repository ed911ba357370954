"""`calibration.html`: a calibration on one page that opens anywhere and prints."""

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import numpy as np

from tumblecal import __version__
from tumblecal.data.calibration import Calibration
from tumblecal.data.source_of import source_of
from tumblecal.estimation.curves_of_fit import reported
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.intrinsic import one_sensor
from tumblecal.estimation.methods import Calibrated
from tumblecal.estimation.plausibility import implausible_words
from tumblecal.ground.numbers_shown import decimals, rounded, with_decimals
from tumblecal.ground.suggested_command import suggested
from tumblecal.ground.units import shown
from tumblecal.lab.judgements import remedy_words
from tumblecal.report.calibration_words import (
    TITLES,
    UNLIKELY,
    methods_words,
    noise_words,
    notes,
    sensor_values,
    wrong_methods,
)
from tumblecal.report.page import PageFigure, Section, chosen, inline_figure, page, write_page
from tumblecal.report.result_file import calibration_of, strong_correlations
from tumblecal.report.tables import Table
from tumblecal.report.verdict import Finding, Unresolved, Verdict, as_sentence, command_at_end, ended
from tumblecal.show.figures.calibration import overview_figure


_CAPTIONS = {
    "residuals.svg": (
        "Measured minus predicted against the spindle angle, by axis and pitch setting. Bars, or the band, are two standard "
        "deviations of the noise."
    ),
    "methods.svg": (
        "Difference of every method from the exact fit for every parameter, in standard uncertainties of the exact fit. Beyond "
        "ten the scale is logarithmic."
    ),
}
_APPLY = (
    "import json, numpy as np",
    "c = json.load(open('calibration.json'))",
    "matrix, bias = np.array(c['matrix']), np.array(c['bias'])",
    "force = (readings - bias) @ matrix.T  # readings (rows, 3) in g",
)
_LOAD = ("import tumblecal", "calibration = tumblecal.load('calibration.json')")
_CONTRADICTED = (
    " Both are based on the stated noise. The residuals contradict it, so do not rely on these uncertainties."
)
_MOST_PAIRS = 8


@page
def write_calibration_page(path: Path, calibrated: Calibrated, figures: Sequence[str]) -> None:
    """Write the page.

    `path`: the HTML file. `figures`: names of the SVG files in the same folder; they are inserted into the page.
    """
    exact, judged, verdict = calibrated.exact, calibrated.judgements, calibration_verdict(calibrated)
    drawn = {name: inline_figure(path.parent / name, _CAPTIONS[name]) for name in figures}
    write_page(
        path,
        f"Calibration of {Path(exact.data.source).name}",
        _lead(exact),
        verdict,
        _sections(calibrated, drawn, path.parent),
        tone=judged[0].tone,
        values=sensor_values(exact),
        pictures={min(1, len(verdict.found)): partial(overview_figure, exact)},
    )


def _lead(exact: Fit) -> str:
    data = exact.data
    parts = [f"serial number {data.serial_number}"] if data.serial_number else []
    parts += [f"{len(data)} positions at {len(np.unique(data.pitch_setting_deg))} pitch settings"]
    parts += [f"{len(data.runs)} runs"] if len(data.runs) > 1 else []
    return ", ".join(parts) + "."


def calibration_verdict(calibrated: Calibrated) -> Verdict:
    """Use, judgements as findings, tests as evidence, and what to do."""
    exact, judged = calibrated.exact, calibrated.judgements
    use = calibrated.use
    corrected = (as_sentence(setup_error.description) for setup_error in calibrated.setup_errors)
    found = [
        *(f"{words}; corrected in this calibration" for words in corrected),
        *(as_sentence(judgement.words_of_finding) for judgement in judged if judgement.tone != "good"),
        *(f"Implausible: {words}" for words in implausible_words(calibrated.implausible)),
    ]
    remedy = remedy_words(exact) if _poorly_determined(exact) else ""
    advised = [*(judgement.advice for judgement in judged), *([f"{as_sentence(remedy)}."] if remedy else [])]
    headline = "One reservation." if len(found) == 1 else f"{len(found)} reservations."
    return Verdict(
        _BADGES[use.answer or "yes"],
        as_sentence(judged[0].words_of_finding) if judged[0].tone == "good" else headline,
        Path(exact.data.source).name,
        use.words,
        found=tuple(map(Finding, found)),
        unresolved=tuple(Unresolved(words) for words in _poorly_determined(exact)),
        evidence=tuple(_evidence(exact, calibrated)),
        next=tuple(dict.fromkeys(text for advice in advised for text in _steps(advice))),
        details=tuple(("", words) for words in _details(calibrated)),
    )


def _poorly_determined(exact: Fit) -> list[str]:
    """Combinations of parameters that the positions determine poorly."""
    weak = exact.identifiability.weak if exact.identifiability else ()
    return [
        f"Poorly determined: {direction.words}; uncertainty {direction.sd_ratio:.0f} times the median"
        for direction in weak
    ]


_BADGES = {
    "yes": "usable",
    "within": "usable",
    "only": "usable in part",
    "not tested": "not tested",
    "no": "do not use",
}


def _steps(advice: str) -> Iterator[str]:
    """An instruction, and the command at its end separately."""
    words, command = command_at_end(advice)
    yield from filter(None, (as_sentence(words) if command else ended(as_sentence(words)) if words else "", command))


def _evidence(exact: Fit, calibrated: Calibrated) -> Iterator[str]:
    yield f"Residuals: {exact.rms * 1e3:.3g} mg rms, {exact.parameters} parameters, {exact.dof} degrees of freedom."
    yield f"{as_sentence(command_at_end(noise_words(exact, calibrated.level))[0].removesuffix('run:').rstrip('; '))}."
    wrong = wrong_methods(calibrated)
    if wrong:
        yield f"Do not use the values of {' and '.join(wrong)} for these data (see Methods)."


def _details(calibrated: Calibrated) -> list[str]:
    """The notes as sentences."""
    return [ended(as_sentence(text).rstrip(".")) for text in notes(calibrated)]


def _sections(calibrated: Calibrated, drawn: dict[str, PageFigure], folder: Path) -> Iterator[Section]:
    exact = calibrated.exact
    p_value = exact.chi2_p_value
    contradicted = _CONTRADICTED if p_value is not None and p_value < UNLIKELY else ""
    yield Section(
        "Parameters",
        words=[
            *_details(calibrated),
            "The exact fit. u is the standard uncertainty of the data alone (type A), U the expanded uncertainty: 95 % by "
            f"{'the normal distribution' if exact.noise == 'stated' else 'Student’s t'}.{contradicted}",
        ],
        tables=[_parameters(exact)],
    )
    yield Section("Residuals", figures=chosen(drawn, "residuals.svg"))
    yield from _weak(exact)
    yield Section(
        "Methods",
        words=list(methods_words(calibrated)),
        tables=[_methods(calibrated)] if len(calibrated.fits) > 1 else [],
        figures=chosen(drawn, "methods.svg"),
    )
    if exact.code.good and one_sensor(exact):
        yield _applied(calibration_of(exact, calibrated.entries), folder)
    yield _provenance(exact)


def _parameters(exact: Fit) -> Table:
    rows, stated = [], reported(exact)
    for name, unit, value, sd in zip(
        stated.names, stated.units, stated.values.tolist(), stated.sd.tolist(), strict=True
    ):
        unit, factor = shown(unit)
        half = factor * sd * exact.coverage_factor(0.95)
        cells = rounded(value * factor, sd * factor)
        rows.append([name, *cells, with_decimals(half, decimals(half)), unit])
    return Table(["parameter", "value", "u", "U (95 %)", "unit"], rows, text=(0, 4))


def _weak(exact: Fit) -> Iterator[Section]:
    words = [f"{text}." for text in _poorly_determined(exact)]
    pairs = strong_correlations(exact)[:_MOST_PAIRS]
    if not words and not pairs:
        return
    if remedy := remedy_words(exact):
        words.append(f"To determine it, {remedy}.")
    rows = [[pair["first"], pair["second"], f"{pair['correlation']:+.3f}"] for pair in pairs]
    table = Table(["parameter", "correlated with", "correlation"], rows, text=(0, 1))
    yield Section("Poorly determined parameters", words=words, tables=[table] if rows else [])


def _methods(calibrated: Calibrated) -> Table:
    exact = calibrated.exact
    others = [name for name in calibrated.fits if name != "exact"]
    rows = []
    for k in exact.shared:
        unit, factor = shown(exact.units[k])
        places, name = decimals(exact.sd[k] * factor), exact.names[k]
        fits = (calibrated.fits[other] for other in others)
        values = [exact.values[k], *(fit.value(name) if name in fit.names else None for fit in fits)]
        cells = [name, *("" if value is None else with_decimals(value * factor, places) for value in values)]
        rows.append([*cells, unit])
    return Table(["parameter", *(TITLES[name] for name in ("exact", *others)), "unit"], rows, text=(0, 2 + len(others)))


def _applied(calibration: Calibration, folder: Path) -> Section:
    columns = ", ".join(["readings", *(f"{name}={name}" for name in calibration.columns_needed)])
    with_terms = (*_LOAD, f"force = calibration.corrected({columns})  # readings (rows, 3) in g")
    terms, curves = bool(calibration.extra.get("terms")), calibration.temperature
    extended = terms or curves is not None
    followed = [] if curves is None else [f"The table is {curves.words}."]
    return Section(
        "Apply it",
        words=[
            f"f = matrix (A - bias{' - terms' if terms else ''}), in the triad's own frame: x along its x input axis, y in the "
            "plane of its x and y axes.",
            *followed,
            f"A log of raw readings: {suggested('apply', folder / 'calibration.json', 'log.csv')}",
            f"In Python, {'three' if extended else 'four'} lines:",
        ],
        code=with_terms if extended else _APPLY,
        tables=[Table(["", "matrix A_x", "A_y", "A_z", "bias / mg"], calibration.rows)],
    )


def _provenance(exact: Fit) -> Section:
    data, source = exact.data, source_of(exact.data)
    rows = [
        ["data", data.source],
        ["SHA-256", str(source["sha256"])],
        *([key, value] for key, value in data.comments.items()),
        ["positions", str(len(data))],
        ["links of the chain", ", ".join(type(link).__name__ for link in exact.chain.links)],
        ["fit", f"{exact.method}: {exact.message}"],
        ["date (UTC)", datetime.now(UTC).strftime("%Y-%m-%d %H:%M:%S")],
        ["program", f"tumblecal {__version__}"],
    ]
    return Section("Provenance", tables=[Table(["", ""], rows, text=(1,))])

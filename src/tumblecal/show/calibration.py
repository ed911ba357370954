"""A calibration for people: its words, its verdict, its text on a terminal, and `calibration.html`."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from tumblecal import __version__
from tumblecal.chain import followings_of
from tumblecal.data.position_comments import identity_words
from tumblecal.data.source_of import digest_of
from tumblecal.estimation.contradicted import UNLIKELY
from tumblecal.estimation.curves_of_fit import Reported, reported
from tumblecal.estimation.methods import Calibrated
from tumblecal.estimation.mountings import mounting_words, turns_of
from tumblecal.estimation.plausibility import implausible_words
from tumblecal.lab.record import STRONG_CORRELATION, strong_correlations, written_calibration
from tumblecal.lab.terms import effects_in, held_words, lacking_words
from tumblecal.lab.use import remedy_words
from tumblecal.show.fit import TITLES, fit_words
from tumblecal.show.verdict import WIDTH, verdict_lines
from tumblecal.show.words import Words, words_of
from tumblecal.words import command_at_end, sentence


# With typical coefficients such a change (degC) causes several times the noise of a good measurement.
_MUCH_DEGC = 2.0


def words_of_calibration(calibrated: Calibrated, file: Path = Path("calibration.json")) -> Words:
    """The words of a calibration; `file`: its `calibration.json`, for suggested commands."""
    exact, entries = calibrated.exact, calibrated.entries
    data, chain, where = exact.data, exact.problem.chain, exact.problem.where
    stated, remedy, written = reported(exact), remedy_words(exact), written_calibration(calibrated)
    differences = _differences(calibrated, stated)
    advice = [*(each.advice for each in calibrated.judgements), f"{remedy}." if remedy else ""]
    parts = [command_at_end(words) for words in advice]
    thermal = any("reference_degc" in form for effect in effects_in(chain, where, entries) for form in effect.forms)
    warmed_degc = 0.0 if thermal or data.temperature_degc is None else float(np.ptp(data.temperature_degc))
    return words_of(
        "calibration",
        c=calibrated,
        fit=exact,
        data=data,
        of_fit=fit_words(exact, calibrated.level),
        source=Path(data.source).name,
        settings=len(np.unique(data.pitch_setting_deg)),
        implausible=implausible_words(calibrated.implausible),
        advice=dict.fromkeys(words.removesuffix("Run:").strip() for words, _ in parts),
        to_diagnose=any(command for _, command in parts),
        identity=identity_words(data),
        mountings=mounting_words(turns_of(chain, where)),
        following=[leaf for leaf in followings_of(chain) if leaf.change.free],
        warmed_degc=warmed_degc if warmed_degc >= _MUCH_DEGC else 0.0,
        held=held_words(written),
        lacking=lacking_words(written),
        lacking_of_sensor=lacking_words(written, of_sensor=True),
        no_gravity=sentence("use/gravity"),
        unlikely=UNLIKELY,
        estimates=zip(stated.names, stated.units, stated.values, stated.sd, strict=True),
        differences=differences,
        farthest={
            name: max((abs(size), parameter) for parameter, size in sizes.items())
            for name, sizes in differences.items()
            if sizes
        },
        titles=TITLES,
        pairs=strong_correlations(exact),
        strong=STRONG_CORRELATION,
        applied=written,
        file=file,
        sha256=digest_of(data.source),
        now=datetime.now(UTC),
        version=__version__,
    )


def calibration_text(words: Words, width: int = WIDTH) -> str:
    """The parameters and the verdict for a terminal."""
    table = words.table("parameters")
    lines = [line for part in table.parts(width) for lines in part for line in lines] if table else []
    return "\n".join([*lines, "", *verdict_lines(words.verdict, width)])


def _differences(calibrated: Calibrated, exact: Reported) -> dict[str, dict[str, float]]:
    """The other methods minus the exact fit, in standard uncertainties of that, by method and parameter."""
    known = [item for item in zip(exact.names, exact.values, exact.sd, strict=True) if item[2] > 0]
    return {
        method: {name: float(fit.value(name) - value) / u for name, value, u in known if name in fit.names}
        for method, fit in calibrated.fits.items()
        if method != "exact"
    }

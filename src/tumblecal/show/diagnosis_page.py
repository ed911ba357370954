"""`diagnosis.html`: the verdict with a picture for each finding, and everything it rests on."""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from tumblecal.diagnosis import Diagnosis
from tumblecal.ground.numbers_shown import decimals
from tumblecal.ground.units import shown
from tumblecal.planning import NextPlan
from tumblecal.show.diagnosis import verdict_of_diagnosis, words_of_diagnosis
from tumblecal.show.figures.finding import card_figures, finding_signals
from tumblecal.show.fit import fit_words
from tumblecal.show.page import write_page
from tumblecal.show.verdict import Verdict


def write_diagnosis_page(
    path: Path, diagnosis: Diagnosis, plan: NextPlan, drawn: Mapping[str, str], verdict: Verdict | None = None
) -> list[str]:
    """Write the page.

    `path`: the HTML file. `plan`: what to measure next. `drawn`: SVG texts by the names of their files. `verdict`: by default
    that of the diagnosis, with commands for the page's folder.
    """
    verdict = verdict or verdict_of_diagnosis(diagnosis, plan, path.parent)
    signals, data = finding_signals(diagnosis), diagnosis.data
    words = words_of_diagnosis(
        diagnosis,
        template="diagnosis_page",
        plan=plan,
        verdict=verdict,
        drawn=drawn,
        sd_mg=1e3 * diagnosis.level * diagnosis.problem.sd,
        pitch_settings=len(np.unique(data.pitch_setting_deg)),
        mountings_measured=len({*(data.mount or "1")}),
        values=[] if diagnosis.calibration is None else fit_words(diagnosis.in_use.as_fit).lines("values"),
        signals={number: signal.label for number, signal in signals.items()},
        parameters=list(_parameters(diagnosis)),
    )
    cards = {f"card_{number}": draw for number, draw in card_figures(diagnosis, signals).items()}
    return write_page(path, words, {**cards, **drawn}, verdict=verdict)


def _parameters(diagnosis: Diagnosis) -> Iterator[tuple]:
    """Each nominal parameter of sensor and set-up in calibration.json, in display units: name, unit, decimals, nominal value,
    numbers (value, standard uncertainty and its contributions; none if no position depends on it), and change in u."""
    nominal, used = diagnosis.nominal, diagnosis.in_use
    for k, name in enumerate(diagnosis.model.nominal_chain.names):
        if diagnosis.model.layout.of_positions[k]:  # the tilts of a hand-held set
            continue
        unit, scale = shown(nominal.units[k])
        value, u = float(nominal.values[k]), float(used.sd[k])
        numbers = [] if used.idle[k] else [used.values[k], u, *(part[k] for part in used.parts.values())]
        change = (numbers[0] - value) / u if numbers else 0.0
        yield name, unit, decimals(u * scale), value * scale, [float(each * scale) for each in numbers], change

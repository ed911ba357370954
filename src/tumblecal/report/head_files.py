"""All files of units on one head: record, verdict, head.toml, and the page with its figure and a table of units and effects."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from tumblecal.diagnosis.units import JointDiagnosis
from tumblecal.effects import Catalogue
from tumblecal.ground.atomic import write_texts
from tumblecal.ground.json_file import json_text
from tumblecal.ground.numbers_shown import rounded, rounded_together
from tumblecal.report.cause_words import label_words
from tumblecal.report.diagnosis_files import SCHEMA
from tumblecal.report.head_amounts import (
    UnitRows,
    level_sizes,
    origins,
    origins_by_class,
    own_estimates,
    shared_coefficients,
    shown_in,
    spread_sizes,
)
from tumblecal.report.head_words import explanation_words, session, units_text, units_verdict
from tumblecal.report.page import TONES, PageFigure, Section, inline_figure, page, write_page
from tumblecal.report.tables import Table
from tumblecal.show.figures.drawing import write_each
from tumblecal.show.figures.units import shared_figure


_MOST_EXPLANATIONS, _LEAST_SHOWN = 10, 1e-4


def write_units(
    folder: Path, found: JointDiagnosis, units: UnitRows, entries: Catalogue, *, figures: bool = True
) -> list[str]:
    """Write all files of units on one head.

    `units`: folder and summary line of each, in order. `figures`: whether to write the page and its figure.

    **Returns:** the files' names.
    """
    text = units_text(found, units, entries)
    texts = {"diagnosis.json": json_text(record(found, units, entries, text)), "verdict.txt": text + "\n"}
    if found.measured is not None:
        texts["head.toml"] = found.measured.text()
    write_texts(folder, texts)
    names = [*texts]
    names.insert(2, "summary.csv")  # written by the command
    if not figures:
        return names
    drawn = write_each(folder, {_FIGURE: shared_figure}, found, entries)
    return [*names, *drawn, *write_head_page(folder / "diagnosis.html", found, units, entries, drawn)]


def record(found: JointDiagnosis, units: UnitRows, entries: Catalogue, text: str) -> dict[str, Any]:
    """The batch as plain numbers, lists and texts, in the schema of one diagnosis, with `units` added."""
    joint, fit, best = found.joint, found.fit, found.joint.best
    known = all(unit.at.problem.known for unit in found.batch.units)
    shown = [one for one in joint.explanations if one.probability > _LEAST_SHOWN or one is best][:_MOST_EXPLANATIONS]
    shown.sort(key=lambda explanation: explanation is not best)
    return {
        "schema": SCHEMA,
        "source": session(found, len(units)),
        "verdict": found.verdict,
        "text": text,
        "implausible": [vars(unusual) for unusual in found.implausible],
        "causes": list(best.shared.labels),
        "detection": {
            "statistic": joint.statistic,
            "threshold": joint.threshold,
            "dof": joint.dof,
            "p_value": joint.p_value,
            "noise": "stated" if known else "estimated",
        },
        "explanations": [
            {
                "effects": list(explanation.shared.labels),
                "equivalents": [list(labels) for labels in explanation.shared.equivalents],
                "by_unit": list(explanation.by_unit),
                "probability": explanation.probability,
                "chosen": explanation is best,
                "coefficients": shared_coefficients(found, entries) if explanation is best else {},
            }
            for explanation in shown
        ],
        "unexplained": "; ".join(found.unexplained) or None,
        "origins": origins(found, entries),
        "by_unit": spread_sizes(found, entries),
        "shown_in": {id: [units[k][0] for k in numbers] for id, numbers in shown_in(found).items()},
        "levels": [
            levels
            | {"parts": [part | {key: units[part[key]][0] for key in ("first", "last")} for part in levels["parts"]]}
            for levels in level_sizes(found, entries)
        ],
        "pitch_settings": {
            "p_value": fit.pitch.p_value,
            "common": fit.pitch.common,
            "other_in": [units[k][0] for k in fit.pitch.alone],
            "changed_at": units[fit.pitch.changed][0] if fit.pitch.changed is not None else None,
        },
        "units": [_unit_record(found, number, name, row, entries) for number, (name, row) in enumerate(units)],
    }


def _unit_record(found: JointDiagnosis, number: int, name: str, row: Mapping, entries: Catalogue) -> dict:
    causes = row["causes"].split(" + ") if row.get("causes") else []
    return {
        "source": row["file"],
        "folder": name,
        "verdict": row["verdict"],
        "effects": [cause.split(":")[0] for cause in causes],
        "causes": causes,
        "probability": row.get("probability"),
        "p_value": row.get("p_value"),
        "outlying": number in found.outlying,
        "left_out": number in found.fit.excluded,
        "same_as_shared": bool(causes) and number in found.nothing_of_their_own,
        "agrees_p_value": found.fit.consistent[number],
        "shared": own_estimates(found, number, entries),
        "fault": row.get("fault"),
    }


_FIGURE = "shared_by_unit.svg"
_CAPTION = (
    "Estimate of the common errors by each unit, with its standard uncertainty. Band: common value, plus and minus two "
    "standard uncertainties. Filled: outlying units."
)


@page
def write_head_page(
    path: Path, found: JointDiagnosis, units: UnitRows, entries: Catalogue, figures: Sequence[str]
) -> None:
    """Write the page; `figures`: names of the SVG files in its folder."""
    drawn = [inline_figure(path.parent / name, _CAPTION) for name in figures]
    positions = sum(len(unit.at.problem.readings) for unit in found.batch.units)
    write_page(
        path,
        session(found, len(units)),
        f"{positions} positions of {len(units)} units.",
        units_verdict(found, units, entries),
        _sections(found, units, entries, drawn),
        tone=TONES[found.verdict],
    )


def _sections(
    found: JointDiagnosis, units: UnitRows, entries: Catalogue, figures: list[PageFigure]
) -> Iterator[Section]:
    if found.fit.head or figures:
        yield Section("The head", tables=[_head_table(found, entries)] if found.fit.head else [], figures=figures)
    if not found.hand_held:
        words = (
            "Shared: probability that all units have the effect with one coefficient, that of the head. By unit: probability "
            "that the coefficient differs between units. The rest belongs to single units."
        )
        yield Section("Head or sensor", [words], tables=[_origins_table(found, entries), _explanations_table(found)])
    spreads = [size for sizes in spread_sizes(found, entries).values() for size in sizes.items()]
    if spreads:
        rows = [
            [
                name,
                "–" if size["mean"] is None else rounded_together(size["mean"], size["mean_sd"]),
                f"{size['sd_between_units']:.2g}",
                size["unit"],
            ]
            for name, size in spreads
        ]
        table = Table(["coefficient", "mean", "standard deviation between units", "unit"], rows, text=(3,))
        yield Section("Effects that differ between units", tables=[table])
    rows_of_levels = [
        [
            f"{name} / {size['unit']}",
            " to ".join(units[part[end]][0] for end in ("first", "last")),
            *rounded(size["value"], size["sd"]),
        ]
        for levels in level_sizes(found, entries)
        for part in levels["parts"]
        for name, size in part["coefficients"].items()
    ]
    if rows_of_levels:
        table = Table(["error", "units", "level", "u"], rows_of_levels, text=(1,))
        yield Section("Two levels of the head", tables=[table])
    words = (
        "Causes of each unit with their probability."
        if found.hand_held
        else "Each unit is diagnosed with the head as determined by the other units: its causes with their probability, "
        "and the agreement of its estimate of the shared coefficients with theirs (p-value)."
    )
    yield Section("Units and effects", [words], tables=[_units_table(found, units, entries)])


def _head_table(found: JointDiagnosis, entries: Catalogue) -> Table:
    rows = [
        [name, *rounded(size["value"], size["sd"]), size["unit"]]
        for name, size in shared_coefficients(found, entries).items()
    ]
    return Table(["error", "value", "u", "unit"], rows, text=(3,))


def _origins_table(found: JointDiagnosis, entries: Catalogue) -> Table:
    rows = [
        [" or ".join(ids), origin["belongs_to"], f"{origin['shared']:.3f}", f"{origin['by_unit']:.3f}"]
        for ids, origin in origins_by_class(found, entries)
    ]
    return Table(["effect, or class of indistinguishable effects", "belongs to", "shared", "by unit"], rows, text=(1,))


def _explanations_table(found: JointDiagnosis) -> Table:
    rows = [
        [
            explanation_words(explanation) + (" (acted on)" if explanation is found.joint.best else ""),
            f"{explanation.probability:.3f}",
            "; ".join(label_words(labels) for labels in explanation.shared.stated[:8]),
        ]
        for explanation in found.joint.explanations[:10]
        if explanation.probability > 1e-3 or explanation is found.joint.best
    ]
    return Table(["explanation", "probability", "indistinguishable from"], rows, text=(0, 2))


def _units_table(found: JointDiagnosis, units: UnitRows, entries: Catalogue) -> Table:
    ids = sorted({cause.split(":")[0] for _, row in units for cause in (row.get("causes") or "").split(" + ") if cause})
    rows = []
    for number, (name, row) in enumerate(units):
        causes = (row.get("causes") or "").split(" + ")
        yes = "as shared" if number in found.nothing_of_their_own else "yes"
        places = [
            ", ".join(cause.partition(":")[2] or yes for cause in causes if cause.split(":")[0] == id) for id in ids
        ]
        probability = f"{row['probability']:.2f}" if row.get("probability") is not None else ""
        agrees = f"{found.fit.consistent[number]:.2g}" + (" (outlying)" if number in found.outlying else "")
        shared = list(_sizes_by_unit(found, number, entries))
        rows.append([name, *shared, *places, probability, agrees, row["verdict"]])
    shared_names = [f"{signal.label} / {entries[signal.label].unit}" for signal in found.shared]
    header = ["unit", *shared_names, *ids, "probability", "agreement, p", "verdict"]
    return Table(header, rows, text=tuple(range(1, len(header))))


def _sizes_by_unit(found: JointDiagnosis, number: int, entries: Catalogue) -> Iterator[str]:
    """Estimate of each common effect by one unit, in display units; "" if it does not determine it."""
    estimates = own_estimates(found, number, entries)
    for signal in found.shared:
        sizes = [estimates[name] for name in signal.slot.names if name in estimates]
        yield ", ".join(rounded_together(size["value"], size["sd"]) for size in sizes)

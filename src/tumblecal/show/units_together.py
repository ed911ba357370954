"""Units on one head, or of a hand-held session, for people: words, verdict, files, and `diagnosis.html`."""

from pathlib import Path

from tumblecal.chain.nominal import PITCH_ERROR
from tumblecal.diagnosis.causes.cause import label_words
from tumblecal.diagnosis.units import JointDiagnosis
from tumblecal.diagnosis.units.record import UnitRows, head_sizes, level_sizes, origins, spread_sizes, units_record
from tumblecal.effects import Catalogue
from tumblecal.estimation.plausibility import implausible_words
from tumblecal.ground.atomic import write_texts
from tumblecal.ground.json_file import json_text
from tumblecal.show.figures.drawing import write_each
from tumblecal.show.figures.units import shared_figure
from tumblecal.show.page import write_page
from tumblecal.show.verdict import verdict_lines
from tumblecal.show.words import Words, words_of


_FIGURE = "shared_by_unit.svg"


def words_of_units(found: JointDiagnosis, units: UnitRows, entries: Catalogue) -> Words:
    """The words of units together; `units`: folder and summary line of each."""
    head = head_sizes(found, entries)
    levels, again = level_sizes(found, entries, units), {*found.nothing_of_their_own}
    of_levels = {one.effect for one in levels}
    sources = dict[tuple[str, float, float], list[str]]()
    for id, one in origins(found, entries).items():
        sources.setdefault((one.belongs_to, round(one.shared, 3), round(one.by_unit, 3)), []).append(id)
    causes = {k: row["causes"] for k, (_, row) in enumerate(units) if row.get("causes")}
    return words_of(
        "units_together",
        r=found,
        units=units,
        entries=entries,
        named=lambda numbers: [units[k][0] for k in sorted(numbers)],
        label=label_words,
        positions=sum(len(unit.at.problem.readings) for unit in found.batch.units),
        implausible=implausible_words(found.implausible),
        head=head,
        pitch_names=[name for name in head if name.startswith(PITCH_ERROR)],
        estimates=[head_sizes(found, entries, number) for number in range(len(units))],
        origins=dict(sorted(sources.items(), key=lambda row: -row[0][1] - row[0][2])),
        levels=levels,
        spreads=spread_sizes(found, entries),
        deviating={*found.outlying, *found.fit.pitch.alone},
        again=[units[k][0] for k in causes if k in again],
        alone=[
            f"{units[k][0]}: {words} ({units[k][1]['probability']:.2f})"
            for k, words in causes.items()
            if k not in again and not of_levels >= {*words.split(" + ")}
        ],
    )


def write_units(
    folder: Path, found: JointDiagnosis, units: UnitRows, entries: Catalogue, words: Words, *, figures: bool = True
) -> list[str]:
    """Write all files of units together; `figures`: whether to write the page and its figure.

    **Returns:** the names of the files, with summary.csv, which the command writes.
    """
    text = "\n".join(verdict_lines(words.verdict))
    record = units_record(found, units, entries, words.text("title"), text)
    texts = {"diagnosis.json": json_text(record), "verdict.txt": f"{text}\n"}
    if found.measured is not None:
        texts["head.toml"] = found.measured.text()
    write_texts(folder, texts)
    first, second, *others = texts
    names = [first, second, "summary.csv", *others]
    if figures:
        drawn = write_each(folder, {_FIGURE: shared_figure}, found, entries)
        names += [*drawn, *write_page(folder / "diagnosis.html", words, drawn)]
    return names

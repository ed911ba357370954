"""The answer of a study: its words, its table, and the terminal."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from typing import Any

import numpy as np
import polars as pl
from rich.console import Console

from tumblecal.ground.strict_toml import toml_lines
from tumblecal.ground.units import in_words, shown
from tumblecal.show.narrow import print_table, print_words
from tumblecal.show.tables import Table
from tumblecal.show.words import Words, words_of


Frames = Mapping[str, pl.DataFrame]
# A deviation counts if it exceeds this many standard errors and this share of a standard deviation, or of a probability.
_ERRORS, _SHARE_OF_SD, _SHARE = 4.0, 0.05, 0.005
_DETECTED = 0.8


@dataclass(frozen=True)
class Answer:
    """The answer of a study of this `kind`.

    - `content` of its JSON file; `frames`: its tables. `tone` of the page: good, named, open, bad.
    - `table` of the results; `values`: those in its words.
    """

    kind: str
    content: Mapping[str, Any]
    frames: Frames
    tone: str
    table: Table
    values: Mapping[str, object]

    @cached_property
    def words(self) -> Words:
        """Question, answer, and the layout of the page."""
        return words_of(
            "study",
            kind=self.kind,
            tone=self.tone,
            content=self.content,
            frames=self.frames,
            settings=toml_lines({"study": self.content["study"], "rig": self.content["rig"]}),
            now=datetime.now(UTC),
            **self.values,
        )


def print_answer(answer: Answer, console: Console) -> None:
    """Print the answer, then the table behind it."""
    print_words(console, answer.words.verdict.headline, style="bold")
    for words in answer.words.verdict.evidence:
        print_words(console, words)
    print_table(console, answer.table)


def answer_of(kind: str, content: Mapping[str, Any], frames: Frames) -> Answer:
    """The answer of a study of that kind; `content` of its JSON file, `frames` its tables."""
    tone, table, values = _ANSWERS[kind](content, frames)
    return Answer(kind, content, frames, tone, table, values)


_Found = tuple[str, Table, dict[str, object]]


def _coverage(content: Mapping[str, Any], frames: Frames) -> _Found:
    rows, good = frames["parameters"], content["trials"] - content["failed"]
    covered = rows["covered_95_stated"].to_numpy()
    bias = rows["bias"].to_numpy() / rows["predicted_sd"].to_numpy()
    margins = _ERRORS * np.sqrt(np.array([0.95 * 0.05, 1.0]) / max(good, 1))
    far, moved = int(np.argmax(np.abs(covered - 0.95))), int(np.argmax(np.abs(bias)))
    trusted = abs(covered[far] - 0.95) <= max(margins[0], _SHARE) and abs(bias[moved]) <= max(margins[1], _SHARE_OF_SD)
    table = []
    for row in rows.iter_rows(named=True):
        unit, factor = shown(row["unit"])
        numbers = (f"{row[name] * factor:.5f}" for name in ("bias", "bias_se", "sd", "predicted_sd"))
        shares = (f"{100 * row[f'covered_95_{name}']:.2f} %" for name in ("stated", "estimated"))
        table.append([row["parameter"], *numbers, unit, *shares])
    header = ["parameter", "bias", "se", "sd", "predicted", "unit", "95 % stated", "95 % estimated"]
    values = {"trusted": trusted, "least": 100 * covered.min(), "most": 100 * covered.max(), "bias": bias[moved]}
    values |= {"farthest": rows["parameter"][far], "biased": rows["parameter"][moved]}
    return "good" if trusted else "bad", Table(header, table), values


def _sweep(content: Mapping[str, Any], frames: Frames) -> _Found:
    rows, lowest, units = [], (1.0, ""), content["units"]
    for number, point in enumerate(content["points"]):
        chosen = frames["parameters"].filter(pl.col("point") == number)
        chosen = chosen.with_columns((pl.col("bias") / pl.col("predicted_sd")).abs().alias("z"))
        worst, covered = chosen.sort("z").row(-1, named=True), float(chosen["covered_95_stated"].to_numpy().min())
        where = ", ".join(point_words(name, value, units) for name, value in point["values"].items())
        lowest = min(lowest, (covered, where))
        found = [str(point["failed"]), f"{point['chi2_mean'] / point['dof']:.3f}", f"{worst['z']:.3f}"]
        found += [worst["parameter"], f"{100 * covered:.2f} %", point["path"]]
        rows.append([*map(str, point["values"].values()), *found])
    header = [f"{_short(path)}, {units[path]}" if path in units else _short(path) for path in content["grid"]]
    header += ["failed", "chi2 / dof", "largest bias / sd", "of", "worst 95 % coverage", "path"]
    margin = max(_SHARE, _ERRORS * np.sqrt(0.95 * 0.05 / max(content["points"][0]["trials"], 1)))
    table = Table(header, rows)
    return "good" if lowest[0] >= 0.95 - margin else "open", table, {"least": 100 * lowest[0], "where": lowest[1]}


def point_words(path: str, value: object, units: Mapping[str, str]) -> str:
    """A value of a grid by its dotted path, with its unit from `units`: `second_order.y 0.3 mg/g^2`."""
    return f"{_short(path)} {in_words(str(value), units[path]) if path in units else value}"


def _short(path: str) -> str:
    """The last two parts of a dotted path."""
    return ".".join(path.split(".")[-2:])


def _convergence(content: Mapping[str, Any], frames: Frames) -> _Found:
    last = frames["consistency"].filter(pl.col("data_sets") == content["data_sets"])
    thresholds, rows, sets_of = list(next(iter(content["settled"].values()))), [], dict[str, int | None]()
    for method in content["methods"]:
        row = last.filter(pl.col("method") == method).row(0, named=True)
        settled = [content["settled"][method][threshold] for threshold in thresholds]
        sets = [one["median_data_sets"] for one in settled]
        cells = [
            f"> {content['data_sets']}" if count is None else f"{count} ({one['parameter']})"
            for count, one in zip(sets, settled, strict=True)
        ]
        sets_of[method] = sets[0]
        nis = "-" if row["nis"] is None else f"{row['nis'] / content['nis_expected']:.3f}"
        rows.append([method, *cells, f"{row['nees'] / content['nees_expected']:.3f}", nis])
    fewest = min((sets for sets in sets_of.values() if sets), default=None)
    header = ["method", *(f"all below {threshold}" for threshold in thresholds)]
    header += [f"NEES / {content['nees_expected']}", f"NIS / {content['nis_expected']}"]
    values = {"threshold": thresholds[0], "fewest": fewest}
    values |= {"fastest": [method for method, sets in sets_of.items() if sets == fewest]}
    return "named", Table(header, rows), values


def _linearization(content: Mapping[str, Any], frames: Frames) -> _Found:
    """The largest errors for which the bias of each parameter stays below its standard deviation, by kind of errors and number
    of data sets."""
    crossings, sizes = frames["crossings"], 1e3 * frames["biases"]["size"].to_numpy()
    paths, rows = list(dict.fromkeys(crossings["path"])), []
    for (case, sets), group in crossings.group_by("case", "data_sets", maintain_order=True):
        cells = [str(case), str(sets)]
        for path in paths:
            known = group.filter(pl.col("path") == path).drop_nulls("size").sort("size")
            size = 1e3 * float(known["size"][0]) if len(known) else np.inf
            limit = f"> {sizes.max():.3g}" if not len(known) else f"{size:.2g}"
            cells.append(f"< {sizes.min():.3g}" if size <= sizes.min() else limit)
            cells.append(str(known["parameter"][0]) if len(known) else "")
        rows.append(cells)
    header = ["errors of", "data sets", *(cell for path in paths for cell in (f"{path} / mrad", "first"))]
    table = Table(header, rows)
    return "named", table, {"paths": paths, "worst": next(row for row in rows if row[0] == rows[-1][0])}


def _power(content: Mapping[str, Any], frames: Frames) -> _Found:
    rates = frames["rates"]
    rows = [
        [
            row["effect"], f"{row['size']:g}", row["unit"], str(row["runs"]),
            f"{row['detected']:.1%}", f"{row['named']:.1%}", str(row["failed"]),
        ]
        for row in rates.iter_rows(named=True)
    ]  # fmt: skip
    detected = []
    for effect in dict.fromkeys(rates["effect"]):
        enough = rates.filter((pl.col("effect") == effect) & (pl.col("size") > 0) & (pl.col("detected") >= _DETECTED))
        smallest = f"{enough['size'].to_numpy().min():g} {enough['unit'][0]}" if len(enough) else ""
        detected.append((effect, smallest))
    header = ["effect", "size", "unit", "runs", "detected", "named", "failed"]
    return "named", Table(header, rows), {"detected": detected}


_ANSWERS = dict(coverage=_coverage, sweep=_sweep, convergence=_convergence, linearization=_linearization, power=_power)

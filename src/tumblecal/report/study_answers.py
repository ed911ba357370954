"""The answer of a study: a headline, its meaning and the table; for the terminal and the page."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl
from rich.console import Console

from tumblecal.ground.units import in_words, shown
from tumblecal.show.narrow import print_table, print_words
from tumblecal.show.tables import Table


Frames = Mapping[str, pl.DataFrame]
# A deviation counts if it exceeds this many standard errors and this share of a standard deviation, or of a probability.
_ERRORS, _SHARE_OF_SD, _SHARE = 4.0, 0.05, 0.005
_DETECTED = 0.8


@dataclass(frozen=True)
class Answer:
    """`headline` in a line, `tone` of the page (good, named, open, bad), `words`: its meaning, `table`."""

    headline: str
    tone: str
    words: tuple[str, ...]
    table: Table


def print_answer(answer: Answer, console: Console) -> None:
    """Print the answer, then the table behind it."""
    print_words(console, answer.headline, style="bold")
    for words in answer.words:
        print_words(console, words)
    print_table(console, answer.table)


def answer_of(kind: str, content: Mapping[str, Any], frames: Frames) -> Answer:
    """The answer of a study of that kind; `content` of its JSON file, `frames` its tables."""
    return _ANSWERS[kind](content, frames)


def _path_line(content: Mapping[str, Any]) -> str:
    """The estimator in words."""
    if content["path"] == "harmonic":
        return "Estimator: exact fit of the harmonics (fast path: uniform plan, nominal chain)."
    return f"Estimator: exact fit of all readings (general path: {content['path_reason']})."


def _coverage(content: Mapping[str, Any], frames: Frames) -> Answer:
    rows, good = frames["parameters"], content["trials"] - content["failed"]
    covered = rows["covered_95_stated"].to_numpy()
    bias = rows["bias"].to_numpy() / rows["predicted_sd"].to_numpy()
    margins = _ERRORS * np.sqrt(np.array([0.95 * 0.05, 1.0]) / max(good, 1))
    far, moved = int(np.argmax(np.abs(covered - 0.95))), int(np.argmax(np.abs(bias)))
    trusted = abs(covered[far] - 0.95) <= max(margins[0], _SHARE) and abs(bias[moved]) <= max(margins[1], _SHARE_OF_SD)
    result = (
        f"95 % intervals contain the true value in {100 * covered.min():.2f} to {100 * covered.max():.2f} % of trials"
    )
    worst = (
        f"{rows['parameter'][far]} farthest from 95 %; largest estimation bias {bias[moved]:+.3f} standard deviations "
        f"({rows['parameter'][moved]})"
    )
    table_rows = []
    for row in rows.iter_rows(named=True):
        unit, factor = shown(row["unit"])
        numbers = (f"{row[name] * factor:.5f}" for name in ("bias", "bias_se", "sd", "predicted_sd"))
        shares = (f"{100 * row[f'covered_95_{name}']:.2f} %" for name in ("stated", "estimated"))
        table_rows.append([row["parameter"], *numbers, unit, *shares])
    header = ["parameter", "bias", "se", "sd", "predicted", "unit", "95 % stated", "95 % estimated"]
    return Answer(
        f"{'Estimates and intervals can be trusted' if trusted else 'Do not trust them'}: {result}.",
        "good" if trusted else "bad",
        (
            _path_line(content),
            f"{content['trials']} trials, {content['failed']} failed; {worst}.",
            f"chi2 {content['chi2_mean']:.2f} for {content['dof']} degrees of freedom, NEES {content['nees_mean']:.2f} for "
            f"{content['nees_expected']} parameters.",
            "Stated, estimated: the interval uses the stated noise, or that of the residuals.",
        ),
        Table(header, table_rows, text=(0, 5)),
    )


def _sweep(content: Mapping[str, Any], frames: Frames) -> Answer:
    rows, lowest, units = [], (1.0, ""), content["units"]
    for number, point in enumerate(content["points"]):
        chosen = frames["parameters"].filter(pl.col("point") == number)
        chosen = chosen.with_columns((pl.col("bias") / pl.col("predicted_sd")).abs().alias("z"))
        worst, covered = chosen.sort("z").row(-1, named=True), float(chosen["covered_95_stated"].to_numpy().min())
        where = ", ".join(point_words(name, value, units) for name, value in point["values"].items())
        lowest = min(lowest, (covered, where))
        rows.append(
            [
                *(str(value) for value in point["values"].values()),
                str(point["failed"]),
                f"{point['chi2_mean'] / point['dof']:.3f}",
                f"{worst['z']:.3f}",
                worst["parameter"],
                f"{100 * covered:.2f} %",
                point["path"],
            ]
        )
    header = [
        *(f"{_short(path)}, {units[path]}" if path in units else _short(path) for path in content["grid"]),
        "failed",
        "chi2 / dof",
        "largest bias / sd",
        "of",
        "worst 95 % coverage",
        "path",
    ]
    sufficient = lowest[0] >= 0.95 - max(
        _SHARE, _ERRORS * np.sqrt(0.95 * 0.05 / max(content["points"][0]["trials"], 1))
    )
    return Answer(
        f"The worst 95 % interval of {len(rows)} points contains the true value in {100 * lowest[0]:.2f} % ({lowest[1]}).",
        "good" if sufficient else "open",
        (
            "Each point is a separate coverage study. The estimation bias is in standard uncertainties stated by the fit; it "
            "shifts the interval by this amount.",
        ),
        Table(header, rows, text=(len(content["grid"]) + 3, len(header) - 1)),
    )


def point_words(path: str, value: object, units: Mapping[str, str]) -> str:
    """A value of a grid by its dotted path, with its unit from `units`: `second_order.y 0.3 mg/g^2`."""
    return f"{_short(path)} {in_words(str(value), units[path]) if path in units else value}"


def _short(path: str) -> str:
    """The last two parts of a dotted path."""
    return ".".join(path.split(".")[-2:])


def _convergence(content: Mapping[str, Any], frames: Frames) -> Answer:
    last = frames["consistency"].filter(pl.col("data_sets") == content["data_sets"])
    thresholds, rows, sets_at = list(next(iter(content["settled"].values()))), [], []
    for method in content["methods"]:
        row = last.filter(pl.col("method") == method).row(0, named=True)
        cells = []
        for threshold in thresholds:
            settled = content["settled"][method][threshold]
            sets = settled["median_data_sets"]
            cells.append(f"> {content['data_sets']}" if sets is None else f"{sets} ({settled['parameter']})")
        sets_at.append((content["settled"][method][thresholds[0]]["median_data_sets"] or np.inf, method))
        nis = "-" if row["nis"] is None else f"{row['nis'] / content['nis_expected']:.3f}"
        rows.append([method, *cells, f"{row['nees'] / content['nees_expected']:.3f}", nis])
    fewest, first = min(sets_at)
    fastest = [method for sets, method in sets_at if sets == fewest]
    header = ["method", *(f"all below {threshold}" for threshold in thresholds)]
    header += [f"NEES / {content['nees_expected']}", f"NIS / {content['nis_expected']}"]
    headline = (
        f"No method has all errors below {thresholds[0]} after {content['data_sets']} data sets in half of the runs."
        if np.isinf(fewest)
        else f"All errors stay below {thresholds[0]} after {fewest:.0f} data sets by {' and '.join(fastest) or first}."
    )
    return Answer(
        headline,
        "named",
        (
            f"{content['runs']} runs of {content['data_sets']} data sets, {content['noise']} noise. Median number of data "
            "sets after which the slowest parameter stays below; errors of dK are numbers, of biases in g, of angles in rad.",
            "NEES and NIS after the last set, divided by their expectation: 1 if the stated covariance of a filter is correct, "
            "more if it is too small.",
        ),
        Table(header, rows, text=(0,)),
    )


def _linearization(content: Mapping[str, Any], frames: Frames) -> Answer:
    """The largest errors for which the bias of each parameter stays below its standard deviation, by kind of errors and number
    of data sets."""
    crossings, sizes = frames["crossings"], frames["biases"]["size"]
    least, most = 1e3 * float(sizes.to_numpy().min()), 1e3 * float(sizes.to_numpy().max())
    paths = list(dict.fromkeys(crossings["path"]))

    def limit(chosen: pl.DataFrame) -> list[str]:
        known = chosen.drop_nulls("size").sort("size")
        if not len(known):
            return [f"> {most:.3g}", ""]
        size, name = 1e3 * float(known["size"][0]), str(known["parameter"][0])
        return [f"< {least:.3g}" if size <= least else f"{size:.2g}", name]

    rows = []
    for (case, sets), group in crossings.group_by("case", "data_sets", maintain_order=True):
        cells = [cell for path in paths for cell in limit(group.filter(pl.col("path") == path))]
        rows.append([str(case), str(sets), *cells])
    header = ["errors of", "data sets"]
    header += [cell for path in paths for cell in (f"{path} / mrad", "first")]
    worst = next(row for row in rows if row[0] == rows[-1][0])
    limits = ", ".join(f"{path} up to {worst[2 + 2 * k]} mrad" for k, path in enumerate(paths))
    return Answer(
        f"Small-angle equations are adequate for {worst[1]} data set (errors of {worst[0]}): {limits}.",
        "named",
        (
            "The table lists the largest standard deviation of the errors for which the rms bias of every parameter stays "
            "below its standard deviation, and the first parameter beyond it. More data sets reduce the standard deviation, "
            "and so require smaller errors.",
            f"{content['instruments']} random instruments a size, without noise; {content['failed']} fits failed.",
        ),
        Table(header, rows, text=(0, *(3 + 2 * k for k in range(len(paths))))),
    )


def _power(content: Mapping[str, Any], frames: Frames) -> Answer:
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
        size = f"from {enough['size'].to_numpy().min():g} {enough['unit'][0]}" if len(enough) else "at no size tried"
        detected.append(f"{effect} {size}")
    return Answer(
        f"Detected in {_DETECTED:.0%} of the runs: {'; '.join(detected)}.",
        "named",
        ("Named: the effect is among those that the diagnosis names. Size 0: false alarms.",),
        Table(["effect", "size", "unit", "runs", "detected", "named", "failed"], rows, text=(0, 2)),
    )


_ANSWERS = dict(coverage=_coverage, sweep=_sweep, convergence=_convergence, linearization=_linearization, power=_power)

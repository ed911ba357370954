"""What `tumblecal study` prints: the answer first, then the table behind it."""

from collections.abc import Mapping
from typing import Any

import polars as pl
from rich.console import Console
from rich.table import Table

from tumblecal.ground.units import shown


def path_line(content: Mapping[str, Any]) -> str:
    """Which estimator ran, in words."""
    if content["path"] == "harmonic":
        return "estimator: exact fit of the harmonics (fast path: uniform plan, nominal chain)"
    return f"estimator: exact fit of all readings (general path: {content['path_reason']})"


def print_study(kind: str, content: Mapping[str, Any], frames: Mapping[str, pl.DataFrame], console: Console) -> None:
    """Print a study's result."""
    {
        "coverage": _coverage,
        "sweep": _sweep,
        "convergence": _convergence,
        "linearization": _linearization,
        "power": _power,
    }[kind](content, frames, console)


def _coverage(content: Mapping[str, Any], frames: Mapping[str, pl.DataFrame], console: Console) -> None:
    console.print(path_line(content), highlight=False)
    console.print(
        f"{content['trials']} trials, {content['failed']} failed; chi2 {content['chi2_mean']:.2f} for {content['dof']} "
        f"degrees of freedom, NEES {content['nees_mean']:.2f} for {content['nees_expected']} parameters",
        highlight=False,
    )
    table = Table(box=None, header_style="bold", pad_edge=False)
    for name in ("parameter", "bias", "se", "sd", "predicted", "unit", "95 % stated", "95 % estimated"):
        table.add_column(name, justify="left" if name in ("parameter", "unit") else "right")
    for row in frames["parameters"].iter_rows(named=True):
        unit, factor = shown(row["unit"])
        numbers = (f"{row[name] * factor:.5f}" for name in ("bias", "bias_se", "sd", "predicted_sd"))
        covered = (f"{100 * row[f'covered_95_{name}']:.2f} %" for name in ("stated", "estimated"))
        table.add_row(row["parameter"], *numbers, unit, *covered)
    console.print(table)


def _sweep(content: Mapping[str, Any], frames: Mapping[str, pl.DataFrame], console: Console) -> None:
    table = Table(box=None, header_style="bold", pad_edge=False)
    for name in (*content["grid"], "failed", "chi2 / dof", "largest bias / sd", "of", "worst 95 % coverage", "path"):
        table.add_column(name, justify="right")
    for number, point in enumerate(content["points"]):
        rows = frames["parameters"].filter(pl.col("point") == number)
        rows = rows.with_columns((pl.col("bias") / pl.col("predicted_sd")).abs().alias("z"))
        worst = rows.sort("z").row(-1, named=True)
        table.add_row(
            *(str(value) for value in point["values"].values()),
            str(point["failed"]),
            f"{point['chi2_mean'] / point['dof']:.3f}",
            f"{worst['z']:.3f}",
            worst["parameter"],
            f"{100 * rows['covered_95_stated'].to_numpy().min():.2f} %",
            point["path"],
        )
    console.print(table)


def _convergence(content: Mapping[str, Any], frames: Mapping[str, pl.DataFrame], console: Console) -> None:
    last = frames["consistency"].filter(pl.col("data_sets") == content["data_sets"])
    table = Table(box=None, header_style="bold", pad_edge=False)
    thresholds = list(next(iter(content["settled"].values())))
    table.add_column("method")
    for threshold in thresholds:
        table.add_column(f"all below {threshold}", justify="right")
    table.add_column(f"NEES / {content['nees_expected']}", justify="right")
    table.add_column(f"NIS / {content['nis_expected']}", justify="right")
    for method in content["methods"]:
        row = last.filter(pl.col("method") == method).row(0, named=True)
        cells = []
        for threshold in thresholds:
            settled = content["settled"][method][threshold]
            sets = settled["median_data_sets"]
            cells.append(f"> {content['data_sets']}" if sets is None else f"{sets} ({settled['parameter']})")
        nis = "-" if row["nis"] is None else f"{row['nis'] / content['nis_expected']:.3f}"
        table.add_row(method, *cells, f"{row['nees'] / content['nees_expected']:.3f}", nis)
    console.print(
        f"{content['runs']} runs of {content['data_sets']} data sets, {content['noise']} noise; median number of data "
        f"sets after which the slowest parameter stays below; consistency after the last set (1 expected)",
        highlight=False,
    )
    console.print(table)


def _linearization(content: Mapping[str, Any], frames: Mapping[str, pl.DataFrame], console: Console) -> None:
    for answer in content["answers"]:
        console.print(answer, highlight=False)


def _power(content: Mapping[str, Any], frames: Mapping[str, pl.DataFrame], console: Console) -> None:
    table = Table(box=None, header_style="bold", pad_edge=False)
    for name in ("effect", "size", "unit", "runs", "detected", "named", "failed"):
        table.add_column(name, justify="left" if name in ("effect", "unit") else "right")
    for row in frames["rates"].iter_rows(named=True):
        table.add_row(
            row["effect"], f"{row['size']:g}", row["unit"], str(row["runs"]),
            f"{row['detected']:.1%}", f"{row['named']:.1%}", str(row["failed"]),
        )  # fmt: skip
    console.print(table)

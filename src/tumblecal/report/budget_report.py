"""An uncertainty budget: `budget.json`, tables, a figure and a page."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from tumblecal.budget.budget import Budget
from tumblecal.budget.monte_carlo import MonteCarlo
from tumblecal.data.calibration import ORDER
from tumblecal.data.source_of import source_of
from tumblecal.estimation.intrinsic import intrinsic, matrix_and_bias, one_sensor
from tumblecal.ground.atomic import write_text
from tumblecal.ground.json_file import json_text
from tumblecal.ground.numbers_shown import decimals, rounded, with_decimals
from tumblecal.ground.units import shown
from tumblecal.report.page import Section, inline_figure, page, write_page
from tumblecal.report.tables import Table
from tumblecal.report.verdict import Verdict
from tumblecal.show.figures.budget import TYPE_A, contributions_of, shares_figure
from tumblecal.show.figures.drawing import write_each


SCHEMA = "tumblecal.budget_result/1"
# A contribution below this share of the total is shown as none.
_NOTHING = 1e-4
_NONE = "-"
# Below this many degrees of freedom a tenth changes the second digit of the coverage factor.
_FEW_DOF = 10


def write_budget(folder: Path, budget: Budget, checked: MonteCarlo | None, notes: Sequence[str] = ()) -> list[str]:
    """Write budget.json, budget.svg and budget.html; returns the names of those written.

    `notes`: reservations about the fit, for the page.
    """
    write_text(folder / "budget.json", json_text(budget_content(budget, checked)))
    drawn = write_each(folder, {"budget.svg": shares_figure}, budget)
    return ["budget.json", *drawn, *_write_page(folder / "budget.html", budget, checked, notes, drawn)]


@page
def _write_page(
    path: Path, budget: Budget, checked: MonteCarlo | None, notes: Sequence[str], figures: Sequence[str]
) -> None:
    alone = [Section("Independent of the mounting", tables=[intrinsic_table(budget)])] if one_sensor(budget.fit) else []
    drawn = [inline_figure(path.parent / name, _CAPTION) for name in figures]
    sections = [
        Section("Expanded uncertainties", [combined_words(budget)], tables=[combined_table(budget)]),
        *alone,
        Section("Contributions", tables=[contributions_table(budget)], figures=drawn),
        Section("Inputs", tables=[inputs_table(budget)]),
    ]
    if checked is not None:
        words, table = monte_carlo_words(budget, checked), monte_carlo_table(budget, checked)
        sections.append(Section("Monte Carlo", [words], tables=[table]))
    name = Path(budget.fit.data.source).name
    lead = f"{len(budget.fit.data)} positions, {len(budget.inputs)} inputs in addition to the noise."
    verdict = Verdict("", advice(budget), evidence=tuple(notes))
    write_page(path, f"Uncertainty budget of {name}", lead, verdict, sections)


_CAPTION = "Share of each input in the variance of each parameter."


def budget_content(budget: Budget, checked: MonteCarlo | None) -> dict[str, Any]:
    """Contents of `budget.json`, base units."""
    labels, without = contributions_of(budget), _without_each(budget)
    parameters = {}
    for j, (name, best) in enumerate(zip(budget.names, np.argmin(without, axis=0).tolist(), strict=True)):
        parameters[name] = {
            "value": float(budget.fit.values[j]),
            "unit": budget.fit.units[j],
            "u_type_a": float(budget.type_a[j]),
            "contributions": dict(zip(labels[1:], budget.sizes[:, j].tolist(), strict=True)),
            "u": float(budget.combined[j]),
            "effective_dof": float(budget.dof[j]),
            "k": float(budget.coverage[j]),
            "U": float(budget.expanded[j]),
            "would_reduce_most": {"input": labels[best], "U_without": float(without[best, j])},
        }
    content = {
        "schema": SCHEMA,
        "source": source_of(budget.fit.data),
        "level": budget.level,
        "inputs": {given.label: _input_content(given) for given in budget.inputs},
        "parameters": parameters,
        "covariance": budget.covariance.tolist(),
        "type_b_covariance": budget.type_b.tolist(),
        "monte_carlo": None if checked is None else _listed(budget, checked),
    }
    if budget.diagnosis_parts:
        content["diagnosis"] = list(budget.diagnosis_parts)
    if one_sensor(budget.fit):
        content["intrinsic"] = {name: {"value": v, "u": u, "unit": unit} for name, v, u, unit in _of_triad(budget)}
        content["calibration_covariance"] = matrix_and_bias(budget.as_fit)[2].tolist()
        content["calibration_covariance_order"] = list(ORDER)
    return content


def _input_content(given) -> dict[str, Any]:
    stated = given.stated.model_dump(exclude_defaults=True)
    return {**stated, "names": list(given.names), "standard_uncertainty": given.u}


def _listed(budget: Budget, checked: MonteCarlo) -> dict[str, Any]:
    columns = {key: getattr(checked, key) for key in ("shift", "sd", "half_width", "within")}
    by_name = {name: {key: float(column[j]) for key, column in columns.items()} for j, name in enumerate(budget.names)}
    return {"trials": checked.trials, "failed": checked.failed, "parameters": by_name}


def _without_each(budget: Budget) -> Float[np.ndarray, "contributions free"]:
    """Expanded uncertainties without each contribution."""
    return np.array([budget.without(k) for k in range(len(budget.labels) + 1)])


def _of_triad(budget: Budget) -> list[tuple[str, float, float, str]]:
    """Name, value, standard uncertainty and unit of the mounting-independent parameters."""
    triad = intrinsic(budget.as_fit)
    sizes = np.sqrt(np.diag(triad.covariance))
    return list(zip(triad.names, triad.values.tolist(), sizes.tolist(), triad.units, strict=True))


def _part(size: float, total: float, factor: float) -> str:
    """A contribution to an uncertainty in its display unit."""
    return with_decimals(size * factor, decimals(size * factor)) if size > _NOTHING * total else _NONE


def combined_words(budget: Budget) -> str:
    """Description of the columns."""
    more = " and, from the diagnosis, other explanations and undetected effects" if budget.diagnosis_parts else ""
    return (
        f"u_A: type A (noise); u_B: type B (inputs){more}; u: combined standard uncertainty; nu: effective degrees of "
        f"freedom; U = k u with a coverage probability of {100 * budget.level:.4g} %. Last columns: the dominant input, and U "
        "without it. "
        f"{_NONE}: less than {_NOTHING:g} of u (of U)."
    )


def combined_table(budget: Budget) -> Table:
    """Value, uncertainties and dominant input of each parameter."""
    rows, labels, without = [], contributions_of(budget), _without_each(budget)
    type_b = np.linalg.norm(budget.sizes, axis=0)
    for j in budget.fit.shared:
        unit, factor = shown(budget.fit.units[j])
        best = int(np.argmin(without[:, j]))
        u, expanded, dof = budget.combined[j], budget.expanded[j], budget.dof[j]
        value, *sizes = rounded(budget.fit.values[j] * factor, u * factor, expanded * factor, without[best, j] * factor)
        cells = [value, *(_part(size, u, factor) for size in (budget.type_a[j], type_b[j])), sizes[0]]
        cells += [
            f"{dof:.{1 if dof < _FEW_DOF else 0}f}" if dof < 1e4 else "inf",
            f"{budget.coverage[j]:.2f}",
            sizes[1],
        ]
        rest = sizes[2] if without[best, j] > _NOTHING * expanded else _NONE
        rows.append([budget.names[j], unit, *cells, labels[best], rest])
    header = ["parameter", "unit", "value", "u_A", "u_B", "u", "nu", "k", "U", "largest input", "U without"]
    return Table(header, rows, text=(0, 1, 9))


def intrinsic_table(budget: Budget) -> Table:
    """Mounting-independent parameters: scale along the input axes, biases, angles between the input axes."""
    rows = []
    for name, value, u, unit in _of_triad(budget):
        display, factor = shown(unit)
        rows.append([name, display, *rounded(value * factor, u * factor)])
    return Table(["of the triad alone", "unit", "value", "u"], rows, text=(0, 1))


def contributions_table(budget: Budget) -> Table:
    """The standard uncertainty of each parameter by each input."""
    rows = []
    for j in budget.fit.shared:
        unit, factor = shown(budget.fit.units[j])
        sizes, u = [budget.type_a[j], *budget.sizes[:, j], budget.combined[j]], budget.combined[j]
        rows.append([budget.names[j], unit, *(_part(size, u, factor) for size in sizes)])
    return Table(["parameter", "unit", *contributions_of(budget), "u"], rows, text=(0, 1))


def inputs_table(budget: Budget) -> Table:
    """The inputs as they were stated."""
    rows = []
    for given in budget.inputs:
        stated = given.stated
        description = stated.what or f"added to {stated.adds_to}"
        size = stated.size + (f" (k = {stated.coverage:g})" if stated.coverage != 1 else "")
        row = [given.label, description, size, stated.distribution, f"each {stated.per}" if stated.per else ""]
        rows.append([*row, "" if stated.dof is None else f"{stated.dof:g}", stated.source])
    header = ["input", "description", "size", "distribution", "independent", "nu", "source"]
    return Table(header, rows, text=(0, 1, 3, 4, 6))


def monte_carlo_words(budget: Budget, checked: MonteCarlo) -> str:
    """Description of the trials, and why fewer of them are within U if sizes have few degrees of freedom."""
    failed = f"; {checked.failed} had no fit" if checked.failed else ""
    few = [given.label for given in budget.inputs if given.stated.freedom < _FEW_DOF]
    few = [TYPE_A, *few] if budget.fit.noise == "estimated" and budget.fit.dof < _FEW_DOF else few
    tails = (
        f" The size of {', '.join(few)} has few degrees of freedom. The trials draw it from Student's t (JCGM 101, 6.4.9), "
        "whose tails are longer than those of the effective degrees of freedom in U (JCGM 100, G.4). Fewer trials are then "
        "within U, and their standard deviation exceeds u. This is no error of the linearisation."
    )
    return (
        f"{checked.trials} trials with drawn noise and inputs, each fitted again{failed}. Half width: half the interval that "
        f"contains {100 * budget.level:.4g} % of the trials; within U: fraction of trials with an error below U."
        f"{tails if few else ''}"
    )


def monte_carlo_table(budget: Budget, checked: MonteCarlo) -> Table:
    """The trials compared with the budget."""
    rows = []
    for j in budget.fit.shared:
        unit, factor = shown(budget.fit.units[j])
        sizes = (budget.combined[j], checked.sd[j], budget.expanded[j], checked.half_width[j])
        cells = rounded(0.0, *(size * factor for size in sizes))[1:]
        rows.append([budget.names[j], unit, *cells, f"{checked.within[j]:.3f}"])
    header = ["parameter", "unit", "u", "standard deviation of trials", "U", "half width", "within U"]
    return Table(header, rows, text=(0, 1))


def advice(budget: Budget) -> str:
    """The input whose improvement would reduce the uncertainties most on average."""
    gains = np.mean((1 - _without_each(budget) / budget.expanded)[:, budget.fit.shared], axis=1)
    best = int(np.argmax(gains))
    largest = contributions_of(budget)[best]
    return f"Largest contribution: {largest}. Without it U would be {100 * gains[best]:.0f} % smaller on average."


def budget_text(budget: Budget, checked: MonteCarlo | None) -> str:
    """The budget for a terminal."""
    parts = [combined_table(budget), combined_words(budget), ""]
    parts += ["standard uncertainties by input", contributions_table(budget), ""]
    parts += [intrinsic_table(budget), ""] if one_sensor(budget.fit) else []
    parts.append(advice(budget))
    if checked is not None:
        parts += ["", monte_carlo_words(budget, checked), monte_carlo_table(budget, checked)]
    return "\n".join(map(str, parts))

"""An uncertainty budget for people: its text on a terminal, and `budget.html` with its figure."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from tumblecal.budget.budget import TYPE_A, Budget
from tumblecal.budget.monte_carlo import MonteCarlo
from tumblecal.budget.record import budget_content
from tumblecal.estimation.intrinsic import intrinsic, one_sensor
from tumblecal.ground.atomic import write_text
from tumblecal.ground.json_file import json_text
from tumblecal.ground.numbers_shown import decimals, rounded, with_decimals
from tumblecal.ground.units import shown
from tumblecal.show.figures.budget import shares_figure
from tumblecal.show.figures.drawing import draw_each
from tumblecal.show.page import page, write_page
from tumblecal.show.tables import Table
from tumblecal.show.words import Words, words_of


# A contribution below this share of the total is shown as none.
_NEGLIGIBLE = 1e-4
_NONE = "-"
# Below this many degrees of freedom a tenth changes the second digit of the coverage factor.
_FEW_DOF = 10


def words_of_budget(budget: Budget, checked: MonteCarlo | None, notes: Sequence[str] = ()) -> Words:
    """The words of a budget; `notes`: reservations about the fit."""
    gains = np.mean((1 - budget.without_each / budget.expanded)[:, budget.fit.shared], axis=1)
    return words_of(
        "budget",
        b=budget,
        checked=checked,
        notes=notes,
        source=Path(budget.fit.data.source).name,
        best=int(np.argmax(gains)),
        gain=float(np.max(gains)),
        few_noise=[TYPE_A] if budget.fit.noise == "estimated" and budget.fit.dof < _FEW_DOF else [],
        few=_FEW_DOF,
        negligible=_NEGLIGIBLE,
    )


def tables_of_budget(budget: Budget, checked: MonteCarlo | None, words: Words) -> dict[str, Table]:
    """The tables by name."""
    header, *inputs = words.blocks["inputs"]
    tables = {
        "combined": Table(
            ("parameter", "unit", "value", "u_A", "u_B", "u", "nu", "k", "U", "largest input", "U without"),
            list(_combined(budget)),
            text=(0, 1, 9),
        ),
        "contributions": Table(("parameter", "unit", *budget.sources, "u"), list(_contributions(budget)), text=(0, 1)),
        "inputs": Table(header, inputs, text=(0, 1, 3, 4, 6)),
    }
    if one_sensor(budget.fit):
        tables["intrinsic"] = Table(("of the triad alone", "unit", "value", "u"), list(_intrinsic(budget)), text=(0, 1))
    if checked is not None:
        header = ("parameter", "unit", "u", "standard deviation of trials", "U", "half width", "within U")
        tables["trials"] = Table(header, list(_trials(budget, checked)), text=(0, 1))
    return tables


def budget_text(budget: Budget, checked: MonteCarlo | None) -> str:
    """The budget for a terminal: the sections of the page."""
    words = words_of_budget(budget, checked)
    tables = tables_of_budget(budget, checked, words)
    lines = list[str]()
    for section in words.sections:
        entries = [cells[0] for cells in section.entries]
        held = [str(table) for name, table in tables.items() if f"[table {name}]" in entries]
        if held:
            lines += [section.title, *(entry for entry in entries if not entry.startswith("[")), *held, ""]
    return "\n".join([*lines, words.text("headline")])


def write_budget(folder: Path, budget: Budget, checked: MonteCarlo | None, notes: Sequence[str] = ()) -> list[str]:
    """Write budget.json, budget.svg and budget.html; returns the names of those written.

    `notes`: reservations about the fit, for the page.
    """
    write_text(folder / "budget.json", json_text(budget_content(budget, checked)))
    drawn = draw_each(folder, {"budget.svg": shares_figure}, budget, write=True)
    return ["budget.json", *drawn, *_write_page(folder / "budget.html", budget, checked, notes, drawn)]


@page
def _write_page(
    path: Path, budget: Budget, checked: MonteCarlo | None, notes: Sequence[str], drawn: Mapping[str, str]
) -> None:
    words = words_of_budget(budget, checked, notes)
    write_page(path, words, words.verdict("", ""), tables=tables_of_budget(budget, checked, words), figures=drawn)


def _in_units(budget: Budget) -> Iterator[tuple[int, list[str], float]]:
    """Number, name with unit, and factor to the unit of each parameter that is no position's."""
    for j in budget.fit.shared:
        unit, factor = shown(budget.fit.units[j])
        yield j, [budget.names[j], unit], factor


def _part(size: float, total: float, factor: float) -> str:
    """A contribution to an uncertainty in its display unit."""
    return with_decimals(size * factor, decimals(size * factor)) if size > _NEGLIGIBLE * total else _NONE


def _combined(budget: Budget) -> Iterator[list[str]]:
    """Value, uncertainties and dominant input of each parameter."""
    without, type_b = budget.without_each, np.linalg.norm(budget.sizes, axis=0)
    for j, named, factor in _in_units(budget):
        best = int(np.argmin(without[:, j]))
        u, expanded, dof = budget.combined[j], budget.expanded[j], budget.dof[j]
        sizes = np.array([budget.fit.values[j], u, expanded, without[best, j]]) * factor
        value, combined, U, rest = rounded(*sizes)
        nu = f"{dof:.{1 if dof < _FEW_DOF else 0}f}" if dof < 1e4 else "inf"
        parts = [_part(size, u, factor) for size in (budget.type_a[j], type_b[j])]
        yield [*named, value, *parts, combined, nu, f"{budget.coverage[j]:.2f}", U, budget.sources[best], rest]


def _intrinsic(budget: Budget) -> Iterator[list[str]]:
    """Mounting-independent parameters: scale along the input axes, biases, angles between the input axes."""
    triad = intrinsic(budget.as_fit)
    for name, value, u, unit in zip(triad.names, triad.values, triad.sd, triad.units, strict=True):
        display, factor = shown(unit)
        yield [name, display, *rounded(value * factor, u * factor)]


def _contributions(budget: Budget) -> Iterator[list[str]]:
    """The standard uncertainty of each parameter by each input."""
    sizes = np.vstack([budget.type_a, budget.sizes, budget.combined])
    for j, named, factor in _in_units(budget):
        yield [*named, *(_part(size, sizes[-1, j], factor) for size in sizes[:, j])]


def _trials(budget: Budget, checked: MonteCarlo) -> Iterator[list[str]]:
    """The trials compared with the budget."""
    sizes = np.array([budget.combined, checked.sd, budget.expanded, checked.half_width])
    for j, named, factor in _in_units(budget):
        yield [*named, *rounded(0.0, *(sizes[:, j] * factor))[1:], f"{checked.within[j]:.3f}"]

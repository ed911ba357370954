"""An uncertainty budget for people: its text on a terminal, and `budget.html` with its figure."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tumblecal.budget.budget import TYPE_A, Budget
from tumblecal.budget.monte_carlo import MonteCarlo
from tumblecal.budget.record import budget_record
from tumblecal.estimation.intrinsic import intrinsic, one_sensor
from tumblecal.show.figures.budget import shares_figure
from tumblecal.show.figures.drawing import write_each
from tumblecal.show.page import write_page
from tumblecal.show.tables import Table
from tumblecal.show.words import Words, words_of


# A contribution below this share of the total is shown as none.
_NEGLIGIBLE = 1e-4
# Below this many degrees of freedom a tenth changes the second digit of the coverage factor.
_FEW_DOF = 10


def words_of_budget(budget: Budget, checked: MonteCarlo | None, notes: Sequence[str] = ()) -> Words:
    """The words of a budget; `notes`: reservations about the fit."""
    without = budget.without_each
    gains = np.mean((1 - without / budget.expanded)[:, budget.fit.shared], axis=1)
    triad = intrinsic(budget.as_fit) if one_sensor(budget.fit) else None
    few_noise = budget.fit.noise == "estimated" and budget.fit.dof < _FEW_DOF
    return words_of(
        "budget",
        b=budget,
        checked=checked,
        notes=notes,
        source=Path(budget.fit.data.source).name,
        best=int(np.argmax(gains)),
        gain=float(np.max(gains)),
        type_b=np.linalg.norm(budget.table[1:], axis=0),
        dominant=[budget.sources[number] for number in np.argmin(without, axis=0)],
        least=np.min(without, axis=0),
        triad=zip(triad.names, triad.units, triad.values, triad.sd, strict=True) if triad else (),
        few_noise=[TYPE_A] if few_noise else [],
        few=_FEW_DOF,
        negligible=_NEGLIGIBLE,
    )


def budget_lines(budget: Budget, checked: MonteCarlo | None) -> list[str | Table]:
    """The budget for a terminal: the sections of the page, with their tables."""
    words = words_of_budget(budget, checked)
    lines = list[str | Table]()
    for section in words.sections:
        entries = [cells[0] for cells in section.entries]
        held = [table for name in words.blocks if f"[table {name}]" in entries and (table := words.table(name))]
        if held:
            lines += [section.title, *(entry for entry in entries if not entry.startswith("[")), *held, ""]
    return [*lines, words.text("headline")]


def write_budget(folder: Path, budget: Budget, checked: MonteCarlo | None, notes: Sequence[str] = ()) -> list[str]:
    """Write budget.json, budget.svg and budget.html; returns the names of those written.

    `notes`: reservations about the fit, for the page.
    """
    budget_record(budget, checked).write(folder / "budget.json")
    drawn = write_each(folder, {"budget.svg": shares_figure}, budget)
    words = words_of_budget(budget, checked, notes)
    return ["budget.json", *drawn, *write_page(folder / "budget.html", words, drawn)]

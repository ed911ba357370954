"""`tumblecal effects`."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def effects(
    id: str | None = None, *, effects: Annotated[tuple[Path, ...], Parameter(name="--effects", negative=())] = ()
) -> None:
    """List the catalogue of effects, or explain one.

    Parameters
    ----------
    id
        Effect to explain; without it all are listed.
    effects
        Python files with effects of your own.
    """
    from rich.console import Console
    from rich.table import Table

    from tumblecal.cli.start import start

    start()
    from tumblecal.effects import catalogue, entry

    entries = catalogue(*effects)
    console = Console()
    if id is None:
        table = Table("id", "symbol", "unit", "needs", "physics", box=None, header_style="bold")
        for one in entries.values():
            table.add_row(one.id, one.symbol, one.unit, " ".join(one.needs), one.physics)
        console.print(table)
        return
    one = entry(entries, id)
    console.print(f"[bold]{one.id}[/bold]  {one.symbol}", highlight=False)
    rows = {
        "physics": one.physics,
        "cause": one.cause,
        "what to do": one.advice,
        "unit": one.unit,
        "typical size": f"{one.typical:g} {one.unit}" if one.typical else "",
        "needs": ", ".join(one.needs),
        "source": one.source,
    }
    for name, text in rows.items():
        if text:
            console.print(f"  {name + ':':13s} {text}", highlight=False, markup=False)

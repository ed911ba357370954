"""`tumblecal effects`."""

from tumblecal.cli.options import EffectFiles


# Columns that words get at least, however narrow the terminal.
_LEAST_WORDS = 20


def effects(id: str | None = None, *, effects: EffectFiles = ()) -> None:
    """List the catalogue of effects, or explain one.

    Parameters
    ----------
    id
        Effect to explain; without it all are listed.
    """
    from rich.console import Console, Group
    from rich.measure import Measurement
    from rich.table import Table
    from rich.text import Text

    from tumblecal.cli.start import start

    start()
    from tumblecal.effects import catalogue, entry
    from tumblecal.ground.units import in_words

    entries = catalogue(*effects)
    console = Console()
    if id is None:
        table = Table(box=None, header_style="bold", pad_edge=False)
        for title in ("id", "symbol", "unit"):
            table.add_column(title, no_wrap=True)
        table.add_column("physics")
        for one in entries.values():
            needs = f" (needs {' and '.join(one.needs)})" if one.needs else ""
            table.add_row(Text(one.id), Text(one.symbol), Text(one.unit), Text(one.physics + needs))
    else:
        one = entry(entries, id)
        console.print(Text.assemble((one.id, "bold"), f"  {one.symbol}" if one.symbol else ""), soft_wrap=True)
        rows = {
            "physics": one.physics,
            "cause": one.cause,
            "what to do": one.advice,
            "unit": one.unit,
            "typical size": in_words(one.typical, one.unit) if one.typical else "",
            "needs": ", ".join(one.needs),
            "source": one.source,
        }
        table = Table.grid(padding=(0, 1))
        table.add_column(no_wrap=True)
        table.add_column()
        for name, text in rows.items():
            if text:
                table.add_row(f"  {name}:", Text(text))
    # A pipe gets every row on one line; in a narrow terminal the words fold, never the ids.
    wide = console.options.update(width=10_000)
    columns = [Measurement.get(console, wide, Group(*column.cells, column.header)).maximum for column in table.columns]
    fixed = sum(columns[:-1]) + 2 * len(columns)
    width = max(console.width, fixed + _LEAST_WORDS) if console.is_terminal else fixed + columns[-1]
    Console(width=width, highlight=False).print(table)

"""`tumblecal effects`."""

from tumblecal.cli.options import EffectFiles


# Smallest width of the column of words in a narrow terminal.
_LEAST_WORDS = 20


def effects(id: str | None = None, *, effects: EffectFiles = ()) -> None:
    """List the catalogue of effects, or explain one effect.

    Parameters
    ----------
    id
        Effect to explain, such as bias_drift.x. Default: a list of all effects.
    """
    from rich.console import Console, Group
    from rich.measure import Measurement
    from rich.table import Table
    from rich.text import Text

    from tumblecal.cli.start import start

    start()
    from tumblecal.effects import catalogue, entry
    from tumblecal.effects.catalogue import belongs_to
    from tumblecal.ground.units import in_words

    entries = catalogue(*effects)
    console = Console()
    if id is None:
        table = Table(box=None, header_style="bold", pad_edge=False)
        for title in ("id", "symbol", "unit"):
            table.add_column(title, no_wrap=True)
        table.add_column("physics")
        for effect in entries.values():
            needs = f" (needs {' and '.join(effect.needs)})" if effect.needs else ""
            table.add_row(Text(effect.id), Text(effect.symbol), Text(effect.unit), Text(effect.physics + needs))
    else:
        effect = entry(entries, id)
        console.print(Text.assemble((effect.id, "bold"), f"  {effect.symbol}" if effect.symbol else ""), soft_wrap=True)
        rows = {
            "physics": effect.physics,
            "cause": effect.cause,
            "what to do": effect.advice,
            "unit": effect.unit,
            "typical size": in_words(effect.typical, effect.unit) if effect.typical else "",
            "belongs to": belongs_to(effect),
            "needs": ", ".join(effect.needs),
            "not tested": f"diagnose finds it as {effect.found_as}" if effect.found_as else "",
            "source": effect.source,
        }
        table = Table.grid(padding=(0, 1))
        table.add_column(no_wrap=True)
        table.add_column()
        for name, text in rows.items():
            if text:
                table.add_row(f"  {name}:", Text(text))
    # In a pipe each row is one line; in a narrow terminal only the words are folded, never the ids.
    wide = console.options.update(width=10_000)
    columns = [Measurement.get(console, wide, Group(*column.cells, column.header)).maximum for column in table.columns]
    fixed = sum(columns[:-1]) + 2 * len(columns)
    width = max(console.width, fixed + _LEAST_WORDS) if console.is_terminal else fixed + columns[-1]
    Console(width=width, highlight=False).print(table)

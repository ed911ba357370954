"""`tumblecal effects`."""

import textwrap

from tumblecal.cli.options import EffectFiles
from tumblecal.cli.terminal import terminal_width


# Smallest width of the column of words in a narrow terminal, and the width of a row in a pipe.
_LEAST_WORDS, _PIPE = 20, 10_000


def effects(id: str | None = None, *, effects: EffectFiles = ()) -> None:
    """List the catalogue of effects, or explain one effect.

    Parameters
    ----------
    id
        Effect to explain, such as bias_drift.x. Default: a list of all effects.
    """
    from tumblecal.cli.start import start

    start()
    from tumblecal.effects import catalogue, entry
    from tumblecal.effects.catalogue import belongs_to
    from tumblecal.ground.units import in_words

    entries = catalogue(*effects)
    if id is None:
        rows = [("id", "symbol", "unit", "physics")]
        for effect in entries.values():
            needs = f" (needs {' and '.join(effect.needs)})" if effect.needs else ""
            rows.append((effect.id, effect.symbol, effect.unit, effect.physics + needs))
    else:
        effect = entry(entries, id)
        print(f"{effect.id}  {effect.symbol}".rstrip())
        facts = {
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
        rows = [(f"  {name}:", text) for name, text in facts.items() if text]
    # In a pipe each row is one line; in a narrow terminal only the words are folded, never the ids.
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)][:-1]
    room = (terminal_width() or _PIPE) - sum(widths) - 2 * len(widths)
    for *cells, words in rows:
        start_of_row = "".join(f"{cell:{width}}  " for cell, width in zip(cells, widths, strict=True))
        lines = textwrap.wrap(words, max(room, _LEAST_WORDS), break_on_hyphens=False)
        print(start_of_row + f"\n{' ' * len(start_of_row)}".join(lines))

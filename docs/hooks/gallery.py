"""How the gallery finds pictures: a `matplotlib` Figure that a block gives a name is drawn below the block."""

from pathlib import Path

from matplotlib.figure import Figure
from mkdocs_gallery.scrapers import figure_md_or_html


def figures(block, script):
    """Save the figures that a block has named and no block before it, and return their Markdown."""
    namespace = script.run_vars.example_globals
    drawn, new = namespace.setdefault("__drawn__", []), []
    for name, value in list(namespace.items()):
        if isinstance(value, Figure) and not name.startswith("_") and all(value is not figure for figure in drawn):
            path = Path(next(script.run_vars.image_path_iterator))
            value.savefig(path, dpi=110, bbox_inches="tight")
            drawn.append(value)
            new.append(path)
    return figure_md_or_html(new, script) if new else ""


conf = {"image_scrapers": (figures,), "reset_modules": ()}

"""The site's own rules: the catalogue of effects is a page made from the code; links out of docs/ go to the repository."""

import re

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the catalogue of effects as a page."""
    files.append(File.generated(config, "effects.md", content=_effects()))
    return files


def on_page_markdown(markdown: str, config: MkDocsConfig, **_: object) -> str:
    """Let links to files outside docs/ lead to the repository."""
    return re.sub(r"\]\(\.\./", f"]({config.repo_url}/blob/main/", markdown)


def _effects() -> str:
    from tumblecal.effects import catalogue
    from tumblecal.effects.catalogue import belongs_to
    from tumblecal.ground.units import in_words

    lines = ["# Catalogue of effects", ""]
    lines += [
        "All effects that `tumblecal diagnose` tests, generated from the code. `tumblecal effects ID` prints one.",
        "",
    ]
    entries = list(catalogue().values())
    for place in dict.fromkeys(belongs_to(effect) for effect in entries):
        lines += [f"## {place[:1].upper()}{place[1:]}", ""]
        for effect in entries:
            if belongs_to(effect) != place:
                continue
            rows = {
                "symbol, unit": ", ".join(filter(None, (effect.symbol, effect.unit))),
                "typical size": in_words(effect.typical, effect.unit) if effect.typical else "",
                "cause": effect.cause,
                "action": effect.advice,
                "required columns": ", ".join(f"`{column}`" for column in effect.needs),
                "source": effect.source,
            }
            lines += [f"### {effect.id}", "", effect.physics, "", "| property | value |", "|---|---|"]
            lines += [f"| {name} | {text} |" for name, text in rows.items() if text] + [""]
    return "\n".join(lines)

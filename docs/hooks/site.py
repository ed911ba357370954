"""The site's own rules: effects and commands are pages made from the code; links out of docs/ go to the repository."""

import re

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the catalogue of effects and the commands with their options as pages."""
    files.append(File.generated(config, "effects.md", content=_effects()))
    files.append(File.generated(config, "commands.md", content=_commands()))
    return files


def on_page_markdown(markdown: str, config: MkDocsConfig, **_: object) -> str:
    """Let links to files outside docs/ lead to the repository."""
    return re.sub(r"\]\(\.\./", f"]({config.repo_url}/blob/main/", markdown)


def _commands() -> str:
    from tumblecal.cli.commands import app

    # The site has a table of contents of its own.
    written = re.sub(r"## Table of Contents\n.*?(?=\*\*Commands\*\*)", "", app.generate_docs(), flags=re.DOTALL)
    return written.replace(
        "# tumblecal\n", "# Commands\n\nGenerated from the code, as `tumblecal COMMAND --help` prints it.\n", 1
    )


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

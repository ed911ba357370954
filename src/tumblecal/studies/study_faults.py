"""Faults of study files that a table alone cannot detect: unknown effects, options in place of keys."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tumblecal.effects.catalogue import Catalogue, entry
from tumblecal.ground.errors import InputError


def unknown_effects(content: Mapping[str, Any], path: Path, entries: Catalogue) -> list[str]:
    """Faults of effects that a checked study names and that are in no catalogue."""
    faults = []
    for key in ("inject", "effects"):
        for id in content.get(key, ()):
            try:
                entry(entries, id)
            except InputError as error:
                faults.append(f"{path}: {key}.{id}: {error}")
    return faults


def of_options(faults: Sequence[str], path: Path, changes: Mapping[str, object]) -> list[str]:
    """Faults of keys that the command line replaced, attributed to the options and not to the file."""
    begin = re.compile(rf"{re.escape(str(path))}(?::line \d+)?: ({'|'.join(changes)}): ")
    return [begin.sub(r"--\1: ", fault) for fault in faults] if changes else list(faults)

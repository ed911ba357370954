"""Faults of study files that no table of its own can tell: effects that there are not, options in place of keys."""

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
    """Faults of what the command line gave in place of a file's keys are the options', not the file's."""
    begin = re.compile(rf"{re.escape(str(path))}(?::line \d+)?: ({'|'.join(changes)}): ")
    return [begin.sub(r"--\1: ", fault) for fault in faults] if changes else list(faults)

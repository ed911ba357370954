"""Faults of study files that a table alone cannot detect: unknown effects."""

from collections.abc import Mapping
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

"""Units of the effects that a study puts into its data."""

from collections.abc import Mapping
from typing import Any

from tumblecal.effects.catalogue import entry
from tumblecal.studies.study_tables import entries_of


# Tables of a study whose keys are effects.
_TABLES = ("study.inject.", "study.effects.")


def injected_units(study: Mapping[str, Any]) -> dict[str, str]:
    """Unit of each effect at its dotted path (`study.inject.second_order.y`), in a table or a grid of the study, as the
    catalogue shows it; none of an effect without one."""
    stated, entries = study["study"], entries_of(study)
    paths = [f"study.{table}.{id}" for table in ("inject", "effects") for id in stated.get(table) or ()]
    paths += [path for path in stated.get("grid") or () if path.startswith(_TABLES)]
    units = {
        path: entry(entries, next(path.removeprefix(t) for t in _TABLES if path.startswith(t))).unit for path in paths
    }
    return {path: unit for path, unit in units.items() if unit}

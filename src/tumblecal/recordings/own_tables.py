"""Tables of this program among the inputs: their columns, and the positions of one."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tumblecal.data.conditions import are_kelvin, temperature_faults
from tumblecal.data.positions import PositionSet
from tumblecal.data.raw import column_names
from tumblecal.ground.errors import InputError
from tumblecal.recordings.options import KnownContext


def own_columns(path: Path) -> set[str]:
    """The columns of a CSV or Parquet file with accelerations by the names of this program; none for other files."""
    table = path.suffix in (".csv", ".parquet") and path.is_file()
    names = set(column_names(path)) if table else set[str]()
    return names if names & {"ax_g", "ax_mg", "ax_ms2"} else set()


def are_samples(data: PositionSet) -> bool:
    """Whether the rows of a table are samples of dwells, not means."""
    return data.of_samples


def with_context(data: PositionSet, context: KnownContext) -> PositionSet:
    """Positions with the stated labels of run and mounting, and temperatures that are possible, if there are any.

    **Raises:** as `check_temperatures`.
    """
    if data.temperature_degc is not None:
        check_temperatures(data.temperature_degc, data.source, lambda row: f"position {data.names[row]}")
    labels = {name: (text,) * len(data) for name in ("run", "mount") if (text := getattr(context, name))}
    return replace(data, **labels)  # type: ignore[arg-type]


def check_temperatures(degc: NDArray[np.float64], source: str, place: Callable[[int], str]) -> None:
    """Check that temperatures are possible.

    **Arguments:** `degc`: degC. `place`: the place of one in the source.

    **Raises:** `InputError` for temperatures in kelvin, and for impossible ones.
    """
    if len(degc) and are_kelvin(degc):
        raise InputError(
            f"{source}: temperatures {degc.min():.4g} to {degc.max():.4g} are in kelvin; write degC, or give a column in degC "
            "by --columns temperature=..."
        )
    for row, fault in temperature_faults(degc):
        raise InputError(f"{source}: {place(row)}: temperature {fault}")

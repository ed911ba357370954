"""The file of a budget's inputs."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from tumblecal.chain.considered import Considered
from tumblecal.chain.rig import Rig
from tumblecal.ground.errors import InputError
from tumblecal.ground.strict_toml import Strict, checked, read_toml


class BudgetTable(Strict):
    """A whole file of considered inputs, by label."""

    schema_: Annotated[Literal["tumblecal.budget/1"], Field(alias="schema")]
    considered: Annotated[dict[str, Considered], Field(min_length=1)]


def considered_inputs(path: Path | None, rig: Rig | None) -> tuple[Mapping[str, Considered], str]:
    """The inputs of a file, otherwise those of a rig, and the file that has them.

    **Raises:** `InputError` with every fault and its dotted path, and if neither has inputs.
    """
    if path is not None:
        return checked(path, read_toml(path), BudgetTable).considered, str(path)
    if rig is None or not rig.considered:
        raise InputError(
            "no inputs to consider: give a file of inputs after the data, or a rig with [considered.NAME] tables"
        )
    return rig.considered, str(rig.source)

"""The file of a budget's inputs."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from tumblecal.chain.considered import Considered
from tumblecal.ground.strict_toml import Strict, checked, read_toml


class BudgetTable(Strict):
    """A whole file of considered inputs, by label."""

    schema_: Annotated[Literal["tumblecal.budget/1"], Field(alias="schema")]
    considered: Annotated[dict[str, Considered], Field(min_length=1)]


def read_considered(path: Path) -> Mapping[str, Considered]:
    """The inputs of a file.

    **Raises:** `InputError` with every fault and its dotted path.
    """
    return checked(path, read_toml(path), BudgetTable).considered

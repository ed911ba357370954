"""Options that several commands share: one declaration and one text each, so that every --help has the same words."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, TypeVar, dataclass_transform

from cyclopts import Parameter
from cyclopts.validators import Number

from tumblecal.ground.option_texts import LARGEST_SEED


Declared = TypeVar("Declared")


@dataclass_transform(frozen_default=True)
def options(declared: type[Declared]) -> type[Declared]:
    """Declare options that belong together: the fields of a frozen dataclass, with the texts of its docstring."""
    return Parameter(name="*")(dataclass(frozen=True)(declared))


def within(**limits: float) -> Parameter:
    """The limits of a number: gt, gte, lt, lte."""
    return Parameter(validator=Number(**limits))


Texts = Annotated[tuple[str, ...], Parameter(show_default=False)]
Files = Annotated[tuple[Path, ...], Parameter(show_default=False)]
Seed = Annotated[int, within(gte=0, lte=LARGEST_SEED)]
Count = Annotated[int, within(gte=1)]
Positive = Annotated[float, within(gt=0, lt=math.inf)]
Probability = Annotated[float, within(gt=0, lt=1)]

# With this option `cli.run.run` discards what a command prints to stdout.
Quiet = Annotated[bool, Parameter(name=("--quiet", "-q"), help="No output except warnings and errors.")]
RigFile = Annotated[
    Path | None,
    Parameter(help="Rig file (TOML). Default: inferred from the angle columns. Example: --rig configs/paper24.toml."),
]
NoiseSd = Annotated[
    str | None,
    Parameter(
        help="Standard deviation of a reading, with its unit. Default: the rig's, then the sd columns; if neither exists, "
        "the noise is unknown. Example: --noise-sd 0.1mg."
    ),
]
Priors = Annotated[
    Texts,
    Parameter(
        help="Gaussian prior on a parameter: standard deviation about zero. Repeatable. Example: --prior 'dbeta=3 arcmin'."
    ),
]
EffectFiles = Annotated[
    Files,
    Parameter(
        name="--effects",
        help="Python file with user-defined effects. Repeatable. Example: --effects my_effects.py.",
    ),
]


@options
class ResultOptions:
    """Results in addition to the files of the output folder.

    Parameters
    ----------
    figures
        Figures (SVG) and HTML page. Default: for a single measurement only. Example: --no-figures.
    history
        History of all units to which the results are added; created if missing, read by tumblecal history. Default: none.
        Example: --history lab.db.
    """

    figures: Annotated[bool | None, Parameter(negative="--no-figures")] = None
    history: Path | None = None

    def require_history(self) -> None:
        """Check, before the work begins, that results can be added to the history, if one is given.

        **Raises:** `InputError`.
        """
        if self.history is not None:
            from tumblecal.history.database import ready

            ready(self.history)

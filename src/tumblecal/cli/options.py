"""Options that several commands share: one declaration and one text each, so that every --help has the same words."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, TypeVar, dataclass_transform

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

# With this option `commands.run` discards what a command prints to stdout.
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
class ModelOptions:
    """The model that is fitted.

    Parameters
    ----------
    fix
        Parameter fixed at its nominal value. Repeatable. Example: --fix dbeta.
    head
        Measured errors of the dividing head: head.toml of tumblecal diagnose --units. Their covariance is used; if the noise is
        unknown, they are treated as exact. Example: --head units/head.toml.
    gravity
        Gravity at the bench: m/s^2, such as 9.8123, or the site, such as lat=48.14,height=520 (degrees, metres). Readings in
        m/s^2 are divided by it, and it is stored with the results. Default: the value in the files. Example: --gravity 9.8123.
    columns
        Names of the columns in the files, as NAME=COLUMN. Unknown columns that are not listed are then ignored. Default: the
        standard names. Example: --columns alpha_deg=angle,ax_g=AccX,ay_g=AccY,az_g=AccZ.
    attitudes
        How the attitudes were set: by a head at the angles of the file, by hand near these angles (each position has a tilt,
        dbeta is fixed), or unknown. Default: the comment `# attitudes:` of the file, then head with --rig or --head; otherwise
        tilts are used if the data show them. Example: --attitudes hand.
    """

    rig: RigFile = None
    noise_sd: NoiseSd = None
    prior: Priors = ()
    fix: Texts = ()
    head: Path | None = None
    gravity: str | None = None
    columns: str | None = None
    effects: EffectFiles = ()
    attitudes: Literal["head", "hand", "unknown"] | None = None

    @property
    def files(self) -> tuple[Path | None, ...]:
        """The files that the options name."""
        return (self.rig, self.head, *self.effects)


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


@options
class NextPositions:
    """Angles and mountings allowed for the proposed positions.

    Parameters
    ----------
    allow_alpha
        Spindle angles (deg) allowed for the proposed positions: a number, numbers separated by commas, or START:END:STEP.
        Repeatable. Default: every 15 deg. Example: --allow-alpha 0:360:45.
    allow_beta
        Pitch angles (deg) allowed for the proposed positions: a number, numbers separated by commas, or START:END:STEP.
        Repeatable. Default: every 15 deg within those of the data. Example: --allow-beta 0,30.
    allow_mount
        Remounting of the triad in its fixture for the proposed positions: turns (allowed) or none. Example: --allow-mount none.
    """

    allow_alpha: Texts = ()
    allow_beta: Texts = ()
    allow_mount: Literal["none", "turns"] = "turns"

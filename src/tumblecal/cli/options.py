"""Options that several commands have: one type and one text each, so that they read alike in every --help."""

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from tumblecal.ground.errors import InputError
from tumblecal.ground.strict_toml import LARGEST_SEED
from tumblecal.ground.suggested_command import suggested
from tumblecal.ground.text_file import shown


if TYPE_CHECKING:
    from tumblecal.planning import Allowed


RigFile = Annotated[
    Path | None, Parameter(help="The rig, a TOML file; inferred from the angle columns where left out.")
]
NoiseSd = Annotated[
    str | None,
    Parameter(
        help="Standard deviation of a reading with its unit, e.g. 0.1mg; else the rig's, else the sd columns; else it "
        "counts as unknown."
    ),
]
Priors = Annotated[
    tuple[str, ...],
    Parameter(
        negative=(),
        show_default=False,
        help="What is known of a parameter, e.g. --prior 'dbeta=3 arcmin' (sd around zero); may be given several times.",
    ),
]
Fixed = Annotated[
    tuple[str, ...],
    Parameter(
        negative=(),
        show_default=False,
        help="Keep a parameter at its nominal value, e.g. --fix dbeta; may be given several times.",
    ),
]
HeadFile = Annotated[
    Path | None,
    Parameter(
        help="Measured errors of the head: head.toml of tumblecal diagnose --units. They count with their covariance; "
        "where the noise is unknown, as exact."
    ),
]
LocalGravity = Annotated[
    str | None,
    Parameter(
        help="Gravity at the bench: m/s^2, such as 9.8123, or the site, such as lat=48.14,height=520 (degrees, metres). It is "
        "what columns in m/s^2 are divided by, and is kept with the results; goes before the files' own."
    ),
]
Columns = Annotated[
    str | None,
    Parameter(
        help="What columns are called in the files, e.g. --columns alpha_deg=angle,ax_g=AccX,ay_g=AccY,az_g=AccZ; other "
        "columns that are not known are then left out."
    ),
]
EffectFiles = Annotated[
    tuple[Path, ...],
    Parameter(
        name="--effects",
        negative=(),
        show_default=False,
        help="Python file with effects of your own; may be given several times.",
    ),
]
_ANGLES = "a number, numbers with commas, or START:END:STEP; may be given several times. Default: every 15 deg"
AllowedAlpha = Annotated[
    tuple[str, ...],
    Parameter(
        negative=(),
        show_default=False,
        help=f"Spindle angles (deg) that proposed next positions may use: {_ANGLES}.",
    ),
]
AllowedBeta = Annotated[
    tuple[str, ...],
    Parameter(
        negative=(),
        show_default=False,
        help=f"Pitch angles (deg) that proposed next positions may use: {_ANGLES} within those of the data.",
    ),
]
AllowedMount = Annotated[
    Literal["none", "turns"],
    Parameter(help="Whether the triad can be turned in its fixture for the next positions."),
]

_MOST_ANGLES = 720


@Parameter(name="*")
@dataclass(frozen=True)
class ModelOptions:
    """The model that is fitted."""

    rig: RigFile = None
    noise_sd: NoiseSd = None
    prior: Priors = ()
    fix: Fixed = ()
    head: HeadFile = None
    gravity: LocalGravity = None
    columns: Columns = None
    effects: EffectFiles = ()


@Parameter(name="*")
@dataclass(frozen=True)
class ResultOptions:
    """What is kept of the results beside the files.

    Parameters
    ----------
    figures
        Draw the figures (SVG) and write the page; by default only for a single measurement.
    history
        Add the results to this history of all units (made where it is missing); tumblecal history reads it.
    """

    figures: bool | None = None
    history: Path | None = None

    def ready(self) -> None:
        """Make the history where it is missing, before the work begins.

        **Raises:** `InputError` for a file that is none.
        """
        if self.history is not None:
            from tumblecal.history.database import ready

            ready(self.history)

    def in_history(self, folder: Path, kind: str, serial: str | None) -> None:
        """Add what was written into a folder, where a history is kept.

        **Raises:** `InputError` where it cannot be added; the folder then has it all the same.
        """
        if self.history is not None:
            from tumblecal.history.database import add
            from tumblecal.history.folders import of_folder

            try:
                add(self.history, of_folder(folder, kind, serial))
            except InputError as error:
                later = f"the results are in {folder}/; later: {suggested('history', self.history, '--add', folder)}"
                raise InputError([f"{fault}; {later}" for fault in error.faults]) from error
            if serial is None:
                print(
                    f"WARNING: {self.history}: {folder} is kept without a serial number: state it in the data "
                    "(# serial_number: ...), or nothing can be said of this unit over time",
                    file=sys.stderr,
                )


@Parameter(name="*")
@dataclass(frozen=True)
class NextPositions:
    """Where the next positions may be."""

    allow_alpha: AllowedAlpha = ()
    allow_beta: AllowedBeta = ()
    allow_mount: AllowedMount = "turns"

    def allowed(self) -> "Allowed":
        """The same, as `next_plan` takes it.

        **Raises:** `InputError` for angles that are none.
        """
        from tumblecal.planning import Allowed

        alpha, beta = angles("--allow-alpha", self.allow_alpha), angles("--allow-beta", self.allow_beta)
        return Allowed(alpha, beta, self.allow_mount == "turns")


def seed_in_range(seed: int) -> None:
    """Check a seed.

    **Raises:** `InputError` where random numbers cannot start from it.
    """
    if not 0 <= seed <= LARGEST_SEED:
        raise InputError(f"--seed {shown(seed)}: must be from 0 to {LARGEST_SEED}")


def angles(option: str, texts: Sequence[str]) -> tuple[float, ...] | None:
    """The angles (deg) of an option given as `0,45`, `0:360:15` (the end included) or several times; None without any.

    **Raises:** `InputError` for a text that is none of these.
    """
    given: list[float] = []
    for text in texts:
        for part in text.split(","):
            given += _angles(f"{option} {text}", part.strip())
    if len(given) > _MOST_ANGLES:
        raise InputError(f"{option}: {len(given)} angles; give at most {_MOST_ANGLES}")
    return tuple(dict.fromkeys(given)) or None


def _angles(given: str, part: str) -> list[float]:
    try:
        numbers = [float(number) for number in part.split(":")]
    except ValueError:
        raise InputError(f"{given}: {part!r} is no angle; write degrees such as 45, 0,45,90 or 0:360:15") from None
    if not all(math.isfinite(number) and abs(number) <= 360 for number in numbers):
        raise InputError(f"{given}: angles are in degrees, from -360 to 360")
    if len(numbers) == 1:
        return numbers
    start, end, step = numbers if len(numbers) == 3 else (0.0, 0.0, 0.0)
    if step <= 0 or end < start:
        raise InputError(f"{given}: write a range as START:END:STEP with END above START and STEP above 0")
    count = math.floor((end - start) / step + 1e-9) + 1
    if count > _MOST_ANGLES:
        raise InputError(f"{given}: {count} angles; give at most {_MOST_ANGLES}")
    values = [round(start + step * number, 9) for number in range(count)]
    # A whole turn ends where it began.
    return values[:-1] if count > 1 and math.isclose(values[-1] - values[0], 360.0) else values

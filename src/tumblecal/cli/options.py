"""Options that several commands share: one type and one text each, so that every --help has the same words."""

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
    tuple[str, ...],
    Parameter(
        negative=(),
        show_default=False,
        help="Gaussian prior on a parameter: standard deviation about zero. Repeatable. Example: --prior 'dbeta=3 arcmin'.",
    ),
]
Fixed = Annotated[
    tuple[str, ...],
    Parameter(
        negative=(),
        show_default=False,
        help="Parameter fixed at its nominal value. Repeatable. Example: --fix dbeta.",
    ),
]
HeadFile = Annotated[
    Path | None,
    Parameter(
        help="Measured errors of the dividing head: head.toml of tumblecal diagnose --units. Their covariance is used; if "
        "the noise is unknown, they are treated as exact. Example: --head units/head.toml."
    ),
]
LocalGravity = Annotated[
    str | None,
    Parameter(
        help="Gravity at the bench: m/s^2, such as 9.8123, or the site, such as lat=48.14,height=520 (degrees, metres). "
        "Readings in m/s^2 are divided by it, and it is stored with the results. Default: the value in the files. "
        "Example: --gravity 9.8123."
    ),
]
Columns = Annotated[
    str | None,
    Parameter(
        help="Names of the columns in the files, as NAME=COLUMN. Unknown columns that are not listed are then ignored. "
        "Default: the standard names. Example: --columns alpha_deg=angle,ax_g=AccX,ay_g=AccY,az_g=AccZ."
    ),
]
Attitudes = Annotated[
    Literal["head", "hand", "unknown"] | None,
    Parameter(
        help="How the attitudes were set: by a head at the angles of the file, by hand near these angles (each position has a "
        "tilt, dbeta is fixed), or unknown. Default: the comment `# attitudes:` of the file, then head with --rig or --head; "
        "otherwise tilts are used if the data show them. Example: --attitudes hand."
    ),
]
EffectFiles = Annotated[
    tuple[Path, ...],
    Parameter(
        name="--effects",
        negative=(),
        show_default=False,
        help="Python file with user-defined effects. Repeatable. Example: --effects my_effects.py.",
    ),
]
_ANGLES = "a number, numbers separated by commas, or START:END:STEP. Repeatable. Default: every 15 deg"
AllowedAlpha = Annotated[
    tuple[str, ...],
    Parameter(
        negative=(),
        show_default=False,
        help=f"Spindle angles (deg) allowed for the proposed positions: {_ANGLES}. Example: --allow-alpha 0:360:45.",
    ),
]
AllowedBeta = Annotated[
    tuple[str, ...],
    Parameter(
        negative=(),
        show_default=False,
        help=f"Pitch angles (deg) allowed for the proposed positions: {_ANGLES} within those of the data. "
        "Example: --allow-beta 0,30.",
    ),
]
AllowedMount = Annotated[
    Literal["none", "turns"],
    Parameter(
        help="Remounting of the triad in its fixture for the proposed positions: turns (allowed) or none. "
        "Example: --allow-mount none."
    ),
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
    attitudes: Attitudes = None


@Parameter(name="*")
@dataclass(frozen=True)
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

    figures: bool | None = None
    history: Path | None = None

    def ready(self) -> None:
        """Create the history if it is missing, before the work begins.

        **Raises:** `InputError` for a file that is not a history.
        """
        if self.history is not None:
            from tumblecal.history.database import ready

            ready(self.history)

    def in_history(self, folder: Path, kind: str, serial: str | None) -> None:
        """Add the results of a folder to the history, if one is given.

        **Raises:** `InputError` if they cannot be added; the folder keeps them.
        """
        if self.history is not None:
            from tumblecal.history.database import add
            from tumblecal.history.folders import of_folder

            try:
                add(self.history, of_folder(folder, kind, serial))
            except InputError as error:
                later = f"the results are in {folder}/; add them later: {suggested('history', self.history, '--add', folder)}"
                raise InputError([f"{fault}; {later}" for fault in error.faults]) from error
            if serial is None:
                print(
                    f"WARNING: {self.history}: {folder} was added without a serial number, so it belongs to no unit: state "
                    "the number in the data (# serial_number: ...)",
                    file=sys.stderr,
                )


@Parameter(name="*")
@dataclass(frozen=True)
class NextPositions:
    """Angles and mountings allowed for the proposed positions."""

    allow_alpha: AllowedAlpha = ()
    allow_beta: AllowedBeta = ()
    allow_mount: AllowedMount = "turns"

    def allowed(self) -> "Allowed":
        """The options as an argument of `next_plan`.

        **Raises:** `InputError` for texts that are not angles.
        """
        from tumblecal.planning import Allowed

        alpha, beta = angles("--allow-alpha", self.allow_alpha), angles("--allow-beta", self.allow_beta)
        return Allowed(alpha, beta, self.allow_mount == "turns")


def seed_in_range(seed: int) -> None:
    """Check a seed.

    **Raises:** `InputError` for a number below 0 or above `LARGEST_SEED`.
    """
    if not 0 <= seed <= LARGEST_SEED:
        raise InputError(f"--seed {shown(seed)}: must be from 0 to {LARGEST_SEED}")


def angles(option: str, texts: Sequence[str]) -> tuple[float, ...] | None:
    """The angles (deg) of an option given as `0,45`, `0:360:15` (end included) or several times; None if not given.

    **Raises:** `InputError` for a text in none of these forms.
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
        raise InputError(f"{given}: {part!r} is not an angle; write degrees such as 45, 0,45,90 or 0:360:15") from None
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

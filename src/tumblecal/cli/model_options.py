"""The options of the model that is fitted."""

from pathlib import Path
from typing import Literal

from tumblecal.cli.options import EffectFiles, NoiseSd, Priors, RigFile, Texts, options


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

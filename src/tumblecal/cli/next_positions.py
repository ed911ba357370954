"""The options of the next positions that `tumblecal diagnose` proposes."""

from typing import TYPE_CHECKING, Literal

from tumblecal.cli.options import Texts, options
from tumblecal.ground.option_texts import angles


if TYPE_CHECKING:
    from tumblecal.planning import Allowed


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

    def allowed(self) -> "Allowed":
        """The positions that may be proposed.

        **Raises:** `InputError` for texts that are no angles.
        """
        from tumblecal.planning import Allowed

        alpha, beta = angles("--allow-alpha", self.allow_alpha), angles("--allow-beta", self.allow_beta)
        return Allowed(alpha or None, beta or None, self.allow_mount == "turns")

"""Options of `tumblecal check`: its conditions, and the update."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from tumblecal.cli.options import Priors, RigFile
from tumblecal.ground.errors import InputError


@Parameter(name="*")
@dataclass(frozen=True)
class ConditionOptions:
    """Conditions of the check.

    Parameters
    ----------
    noise_sd
        Standard deviation of a position mean, with its unit. Default: by the dwells, or the sd columns; at least the dispersion
        of the positions of the calibration, if its noise was estimated. Example: --noise-sd 0.1mg.
    repeatability
        Standard deviation of a parameter or kind of parameter from one switch-on to the next, if the uncertainty of the
        calibration does not include it. Repeatable. Default: 0. Example: --repeatability 'bias=0.3 mg'.
    u_gravity
        Standard uncertainty of --gravity relative to its value. Default: 0 for the gravity of the calibration, otherwise 3e-5
        (anomalies). Example: --u-gravity 1e-6.
    largest_error
        Largest error of a corrected force that is acceptable in use. A changed calibration within it may be used. Default:
        none, so a changed calibration must not be used. Example: --largest-error 5mg.
    other_unit
        Check with a recording whose serial number differs from that of the calibration. Default: an error.
    extrapolate
        Check at temperatures outside the range of the calibration. Default: an error.
    use_anyway
        Check of a calibration with the judgement `use: no`. Default: an error.
    """

    noise_sd: str | None = None
    rig: RigFile = None
    prior: Priors = ()
    repeatability: Annotated[tuple[str, ...], Parameter(negative=(), show_default=False)] = ()
    u_gravity: float | None = None
    largest_error: str = ""
    other_unit: Annotated[bool, Parameter(negative=())] = False
    extrapolate: Annotated[bool, Parameter(negative=())] = False
    use_anyway: Annotated[bool, Parameter(negative=())] = False

    def repeated(self) -> dict[str, float]:
        """The stated repeatabilities, base units.

        **Raises:** `InputError` for texts that are not sizes.
        """
        return _sizes("--repeatability", self.repeatability)

    def sizes(self) -> tuple[float | None, float | None]:
        """Stated noise, and largest acceptable error, g.

        **Raises:** `InputError` for texts that are not sizes.
        """
        from tumblecal.ground.units import reading_sd

        read = []
        for option, text in (("--noise-sd", self.noise_sd), ("--largest-error", self.largest_error or None)):
            try:
                read.append(None if text is None else reading_sd(text))
            except InputError as error:
                raise InputError(f"{option}: {error}") from error
        return read[0], read[1]


@Parameter(name="*")
@dataclass(frozen=True)
class UpdateOptions:
    """A new calibration from the old one and the recording.

    Parameters
    ----------
    update
        File for the updated calibration. It is not written if the recording contradicts the calibration. Default: none.
        Example: --update updated.json.
    free
        Parameter or kind of parameter that changed: its old value is not used. Repeatable. Example: --free bias_x.
    drift
        Standard deviation of the drift of a parameter or kind of parameter, per month. Repeatable. Default: the drift of the
        unit by --history, if it has three or more results; otherwise none. Example: --drift 'bias=0.1 mg/month'.
    months
        Months from the calibration to the recording. Default: by their dates. Example: --months 12.
    """

    update: Path | None = None
    free: Annotated[tuple[str, ...], Parameter(negative=(), show_default=False)] = ()
    drift: Annotated[tuple[str, ...], Parameter(negative=(), show_default=False)] = ()
    months: float | None = None

    def rates(self) -> dict[str, float]:
        """The stated drifts per month, base units.

        **Raises:** `InputError` for texts that are not drifts.
        """
        return _sizes("--drift", self.drift, per="/month")


def _sizes(option: str, texts: Sequence[str], *, per: str = "") -> dict[str, float]:
    """Sizes NAME=SIZE of parameters or kinds of parameters, base units.

    **Raises:** `InputError` for other texts.
    """
    from tumblecal.data.sensor_parameters import GROUPS, SENSOR, leaf_of
    from tumblecal.ground.units import quantity

    sizes = dict[str, float]()
    for text in texts:
        name, _, size = (part.strip() for part in text.partition("="))
        leaf, amount = leaf_of(name), "".join(size.split(" ")).removesuffix(per)
        if (name not in SENSOR and name not in GROUPS) or leaf == "dtheta" or (per and not size.endswith(per)):
            raise InputError(
                f"{option} {text!r}: write NAME=SIZE{per} with dK, bias, gamma or a parameter, e.g. 'bias=0.1 mg{per}'"
            )
        try:
            sizes[name] = quantity(amount, GROUPS[leaf][1])
        except InputError as error:
            raise InputError(f"{option} {text!r}: {error}") from error
        if not sizes[name] >= 0:
            raise InputError(f"{option} {text!r}: must be 0 or more")
    return sizes

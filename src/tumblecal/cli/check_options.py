"""Options of `tumblecal check`: its conditions, and the update."""

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
    u_gravity: float | None = None
    largest_error: str = ""
    other_unit: Annotated[bool, Parameter(negative=())] = False
    extrapolate: Annotated[bool, Parameter(negative=())] = False
    use_anyway: Annotated[bool, Parameter(negative=())] = False

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
        from tumblecal.data.sensor_parameters import GROUPS, SENSOR, leaf_of
        from tumblecal.ground.units import quantity

        rates = dict[str, float]()
        for text in self.drift:
            name, _, size = (part.strip() for part in text.partition("="))
            amount, _, per = size.rpartition("/")
            leaf = leaf_of(name)
            if (name not in SENSOR and name not in GROUPS) or leaf == "dtheta" or per.strip() != "month":
                raise InputError(
                    f"--drift {text!r}: write NAME=SIZE/month with dK, bias, gamma or a parameter, e.g. 'bias=0.1 mg/month'"
                )
            try:
                rates[name] = quantity(amount, GROUPS[leaf][1])
            except InputError as error:
                raise InputError(f"--drift {text!r}: {error}") from error
            if not rates[name] >= 0:
                raise InputError(f"--drift {text!r}: must be 0 or more")
        return rates

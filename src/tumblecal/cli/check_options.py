"""The conditions of `tumblecal check`."""

from typing import Annotated, Any

from tumblecal.cli.model_options import ModelOptions
from tumblecal.cli.options import Priors, RigFile, Texts, options, within
from tumblecal.cli.terminal import warn


@options
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
    repeatability: Texts = ()
    u_gravity: Annotated[float | None, within(gte=0, lt=0.1)] = None
    largest_error: str = ""
    other_unit: bool = False
    extrapolate: bool = False
    use_anyway: bool = False

    def stated(self) -> dict[str, Any]:
        """Model, noise, gravity, acceptable error, repeatability and exceptions, as keyword arguments of a check.

        **Raises:** `InputError` for a text or rig that cannot be read.
        """
        from tumblecal.check.drift import by_parameter
        from tumblecal.cli.read_model import read_model
        from tumblecal.data.sensor_parameters import UNITS
        from tumblecal.ground.option_texts import sd_of_reading, sizes

        model = read_model(ModelOptions(rig=self.rig, prior=self.prior))
        if model.rig is not None and (unused := model.rig.tables_of_head):
            warn(model.rig.source, [f"not used by `check`: {', '.join(unused)}"])
        again = sizes("--repeatability ", self.repeatability, UNITS, "'bias=0.3 mg'", zero=True)
        return {
            "stated": model,
            "noise_sd": sd_of_reading("--noise-sd", self.noise_sd),
            "largest_g": sd_of_reading("--largest-error", self.largest_error),
            "repeatability": by_parameter(again),
            "extrapolate": self.extrapolate,
            "other_unit": self.other_unit,
            "u_gravity": self.u_gravity,
        }

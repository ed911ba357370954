"""The update of `tumblecal check`."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tumblecal.cli.options import Texts, options, within
from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    from tumblecal.check.drift import ProcessNoise
    from tumblecal.check.result import CheckResult
    from tumblecal.check.update import Update


@options
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
    free: Texts = ()
    drift: Texts = ()
    months: Annotated[float | None, within(gte=0, lt=1200)] = None

    def rates(self, inputs: Sequence[Path | None]) -> dict[str, float]:
        """The drifts of `--drift` per month in base units, once the file of the update can be written.

        **Raises:** `InputError` for one that cannot be read, for an option without an update, and for a file that is an input
        of the command or cannot be written.
        """
        from tumblecal.data.overwriting import protect_inputs
        from tumblecal.data.sensor_parameters import UNITS
        from tumblecal.ground.atomic import writable_file
        from tumblecal.ground.option_texts import sizes

        if self.update is not None:
            protect_inputs(inputs, out=self.update)
            writable_file(self.update)
        elif self.free or self.drift:
            raise InputError(f"--{'free' if self.free else 'drift'} is for an update; give --update updated.json")
        drifts = [text.replace(" ", "").removesuffix("/month") for text in self.drift]
        return sizes("--drift ", drifts, UNITS, "'bias=0.1 mg/month'", zero=True)

    def updated(
        self, result: "CheckResult", source: dict[str, Any], rates: Mapping[str, float], history: Path | None
    ) -> "tuple[tuple[Update, ProcessNoise] | None, InputError | None]":
        """The updated calibration with the process noise since the old one, if it is asked for, or the fault for which there is
        none.

        **Arguments:**

        - `source`: provenance of the check. `rates`: as from `rates`. `history`: of the unit.
        """
        from tumblecal.check.drift import process_noise
        from tumblecal.check.update import freed_names, updated
        from tumblecal.history.database import of_unit

        if self.update is None:
            return None, None
        serial = result.serial_number
        entries = of_unit(history, serial) if history is not None and serial else None
        try:
            process = process_noise(result.calibration, result.data, rates, self.months, entries, str(history))
            return (updated(result.test, process, freed_names(self.free), source), process), None
        except InputError as fault:
            return None, fault

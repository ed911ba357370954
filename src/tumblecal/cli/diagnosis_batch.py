"""The options common to all files of one call of `tumblecal diagnose`, and the files of a result."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from tumblecal.cli.command import Command
from tumblecal.cli.model_options import ModelOptions
from tumblecal.cli.options import ResultOptions
from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    from tumblecal.cli.positions_read import Read
    from tumblecal.diagnosis import Diagnoser
    from tumblecal.estimation.stated_model import StatedModel
    from tumblecal.planning import Allowed
    from tumblecal.recordings.dwells.dwell_samples import DwellSamples


# The files of one diagnosis.
DIAGNOSIS_SET = (
    "diagnosis.json", "verdict.txt", "calibration.json", "extended_rig.toml", "suggested_effect.py",
    "next_positions.toml", "next_positions_*.toml", "diagnosis.html", "finding_*.svg",
    "residuals_by_angle.svg", "residuals_by_column.svg", "residual_harmonics.svg",
    "explanations.svg", "predictive.svg", "limits.svg", "unexplained.svg",
)  # fmt: skip
# Files for all units together.
UNITS_SET = ("diagnosis.json", "verdict.txt", "head.toml", "diagnosis.html", "shared_by_unit.svg")


@dataclass
class Batch:
    """Options common to all files of one call; sent to the worker processes."""

    options: ModelOptions
    holdout: tuple[str, str] | None
    samples: "DwellSamples | None"
    allowed: "Allowed"
    single: bool
    more: ResultOptions
    max_rows: int | None
    command: Command

    @cached_property
    def model(self) -> "StatedModel":
        """The model of the options."""
        from tumblecal.cli.read_model import read_model

        return read_model(self.options)

    @cached_property
    def diagnoser(self) -> "Diagnoser":
        """The diagnoser of all files."""
        from tumblecal.diagnosis import Diagnoser

        return Diagnoser(self.model.entries, self.single, self.model.usual)

    def stated(self, read: "Read", model: "StatedModel") -> dict[str, Any]:
        """Averaged positions, their stated model and their samples, as keyword arguments of a diagnosis.

        **Raises:** `InputError` for a file that could not be read, and for more positions than allowed.
        """
        if isinstance(read, InputError):
            raise read
        stated = model.for_diagnosis(read, self.max_rows, sampled=self.samples is not None)
        if words := stated.pop("words") * self.single:
            self.command.say(words)
        return stated | {"samples": self.samples}

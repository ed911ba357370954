"""Tables of a plan for captures over temperature: the criterion of a soak, and the line to a chamber."""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from tumblecal.ground.strict_toml import Number, Strict


# The rate of a temperature is determined over this fraction of the time for which it must be stable.
RATE_FRACTION = 0.2

Celsius = Annotated[Number, Field(ge=-200, le=400)]


def _setting_command(text: str) -> str:
    try:
        inserted = text.format(40.0)
    except (ValueError, IndexError, KeyError, AttributeError) as error:
        raise ValueError("must have {} where the temperature is inserted, such as 'SOUR:TEMP:SPO {}'") from error
    if "40" not in inserted:
        raise ValueError("must have {} where the temperature is inserted, such as 'SOUR:TEMP:SPO {}'")
    return text


class SoakTable(Strict):
    """The criterion of a stable temperature, and whether the pitch settings of each soak are new.

    For `stable_min` minutes, the sensor's temperature is within `tolerance_degc` of the requested one plus `offset_degc`
    (self-heating), and changes by less than `rate_degc_per_min`. `timeout_min`: longest wait. `new_pitch_settings`: each soak
    is a run, so the errors of its pitch settings differ from those of the other soaks.
    """

    tolerance_degc: Number = Field(default=3.0, gt=0)
    rate_degc_per_min: Number = Field(default=0.05, gt=0)
    stable_min: Number = Field(default=10.0, gt=0)
    timeout_min: Number = Field(default=240.0, gt=0)
    offset_degc: Number = 0.0
    new_pitch_settings: bool = False

    @property
    def words(self) -> str:
        """The criterion in words."""
        about = f" plus {self.offset_degc:g}" if self.offset_degc else ""
        return (
            f"for {self.stable_min:g} min, the sensor's temperature is within {self.tolerance_degc:g} degC of the requested one"
            f"{about} and changes by less than {self.rate_degc_per_min:g} degC/min (over {RATE_FRACTION * self.stable_min:g} "
            f"min); longest wait {self.timeout_min:g} min"
        )


class ChamberTable(Strict):
    """The line to a temperature chamber with commands in text; without `url`, the operator sets the chamber.

    `set`: command with {} for the temperature, degC. `query`: asks for the temperature of the chamber; its reply is the number
    at `query_field` of a line (1: the first). `set_query`, `set_query_field`: the same for the set point, "" for no check.
    `start`: commands sent first. `finish_degc`: temperature to set when all positions are done.
    """

    url: str = ""
    baud: int = Field(default=9600, gt=0)
    set: Annotated[str, AfterValidator(_setting_command)] = "SOUR:TEMP:SPO {}"
    query: str = Field(default="MEAS:TEMP?", min_length=1)
    query_field: int = Field(default=1, ge=1)
    set_query: str = ""
    set_query_field: int = Field(default=1, ge=1)
    start: list[str] = Field(default_factory=list)
    terminator: Literal["LF", "CR", "CRLF"] = "LF"
    timeout_s: Number = Field(default=2.0, gt=0)
    finish_degc: Celsius | None = None

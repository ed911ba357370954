"""One calibration or diagnosis of a unit, as the history keeps it. Nothing here needs numpy: lists are made at once."""

from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING


if TYPE_CHECKING:
    from tumblecal.data.sensor_parameters import SensorParameters

# Before the answer of the use, at the end of an outcome.
USE = "; use: "
# How a date is written.
WHEN = "%Y-%m-%dT%H:%M:%SZ"


@dataclass(frozen=True)
class Entry:
    """One result of one unit.

    - `kind`: calibration or diagnosis. `serial`: the unit, "" where nobody said.
    - `date_utc`: when it was measured where the data say so (comment `measured_utc`), else when it was computed.
    - `source`, `sha256`: the data. `outcome`: how it went, or the verdict; with the answer of its use, if it has a calibration.
    - `parameters`: None where the fit gave no calibration. `documents`: the files, by name.
    - `damaged`: the parts that are not as they were written; "" for none. Such an entry has no parameters.
    - `combined`: whether the covariance has a budget's inputs in it; `diagnosed`: whether it has other explanations and
      undetected effects of a diagnosis in it. If neither, it is of the noise alone (type A).
    """

    kind: str
    serial: str
    date_utc: str
    source: str
    sha256: str
    outcome: str
    rms_g: float | None = None
    p_value: float | None = None
    parameters: "SensorParameters | None" = None
    documents: dict[str, str] = field(default_factory=dict)
    number: int = 0
    combined: bool = False
    diagnosed: bool = False
    damaged: str = ""

    @property
    def refused(self) -> bool:
        """Whether its calibration must not be used, as it states itself."""
        return self.outcome.endswith(f"{USE}no")

    @property
    def dated(self) -> bool:
        """Whether the date is one; that of a damaged row may be none."""
        try:
            return bool(self.when)
        except ValueError:
            return False

    @property
    def when(self) -> datetime:
        """The date as a time."""
        return datetime.strptime(self.date_utc, WHEN).replace(tzinfo=UTC)

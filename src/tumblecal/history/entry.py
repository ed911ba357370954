"""One calibration, diagnosis or check of a unit in a history. Without numpy, so that lists are fast."""

from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING


if TYPE_CHECKING:
    from tumblecal.data.sensor_parameters import SensorParameters

# Text before the answer of `use`, at the end of an outcome.
USE = "; use: "
# Format of a date.
WHEN = "%Y-%m-%dT%H:%M:%SZ"


@dataclass(frozen=True)
class Entry:
    """One result of one unit.

    - `kind`: calibration, diagnosis or check. `serial`: the unit, "" if not stated.
    - `date_utc`: date of the measurement, if stated (comment `measured_utc`), otherwise of the computation.
    - `source`, `sha256`: the data. `outcome`: result of the fit, or verdict; with the answer of `use`, for a calibration.
    - `parameters`: None without a calibration. `documents`: the files, by name.
    - `damaged`: damaged parts; "" for none. Such an entry has no parameters.
    - `combined`: whether the covariance includes inputs of a budget; `diagnosed`: whether it includes other explanations and
      undetected effects of a diagnosis. If neither, it includes only the noise (type A).
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
        """Whether its calibration states that it must not be used."""
        return self.outcome.endswith(f"{USE}no")

    @property
    def dated(self) -> bool:
        """Whether the date is valid, because that of a damaged row may not be."""
        try:
            return bool(self.when)
        except ValueError:
            return False

    @property
    def when(self) -> datetime:
        """The date as a time."""
        return datetime.strptime(self.date_utc, WHEN).replace(tzinfo=UTC)

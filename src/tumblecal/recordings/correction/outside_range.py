"""Rows at temperatures outside the measured range of a calibration whose parameters follow temperature."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from tumblecal.data.reading_checks import Occurrences
from tumblecal.data.sensor_parameters import GROUPS, SENSOR, leaf_of
from tumblecal.data.temperature_curves import TemperatureCurves
from tumblecal.ground.errors import InputError
from tumblecal.ground.units import in_words, shown


@dataclass
class OutsideRange:
    """Counts of such rows, piece by piece; `farthest_degc`: the temperature with the largest distance from the range."""

    curves: TemperatureCurves
    row_word: str
    rows: int = 0
    at: Occurrences = field(default_factory=Occurrences)
    farthest_degc: float | None = None

    def add(self, degc: Float[np.ndarray, " rows"], rows: Int[np.ndarray, " rows"]) -> None:
        """Count the temperatures of a piece; `rows`: the number of each row."""
        self.rows += len(degc)
        if (beyond := self.curves.beyond(degc)).any():
            self.at.add(rows[beyond])
            known = degc if self.farthest_degc is None else np.append(self.farthest_degc, degc)
            self.farthest_degc = float(known[np.argmax(np.abs(known - np.clip(known, *self.curves.range_degc)))])

    @property
    def _counted(self) -> str:
        return (
            f"temperatures in {self.at.count} of {self.rows} rows (the first: {self.row_word} {self.at.first}) are outside "
            f"the measured {self.curves.range_words}, up to {self.farthest_degc:.4g} degC"
        )

    def require_none(self, source: Path, calibration: Path) -> None:
        """Reject rows outside the range.

        **Raises:** `InputError` with their number, the range and the remedy.
        """
        if self.farthest_degc is not None:
            cure = "remove these rows, or give --extrapolate to correct them with a larger uncertainty"
            raise InputError(f"{source}: {self._counted}, where {calibration} was not measured; {cure}")

    def words(self) -> Iterator[str]:
        """The warning on extrapolated rows, with the standard uncertainties at the farthest temperature."""
        if self.farthest_degc is None:
            return
        end = float(np.clip(self.farthest_degc, *self.curves.range_degc))
        here, at_end = self.curves.sd(np.array([self.farthest_degc, end]))
        followed = [SENSOR.index(curve.parameter) for curve in self.curves.curves if curve.functions.count]
        # The largest of each kind of parameter.
        largest = {leaf_of(SENSOR[k]): k for k in sorted(followed, key=lambda place: here[place])}
        sizes = []
        for leaf in sorted(largest, key=[*GROUPS].index):
            k, (unit, scale) = largest[leaf], shown(GROUPS[leaf][1])
            size = in_words(f"{here[k] * scale:.2g}", unit)
            sizes.append(f"{size} for {SENSOR[k]} ({at_end[k] * scale:.2g} at {end:.4g} degC)")
        yield (
            f"extrapolated: {self._counted}. The largest standard uncertainties there are {', '.join(sizes)}, if the "
            "dependence on temperature continues"
        )

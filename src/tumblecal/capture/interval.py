"""An interval of a recording in which a triad may have been at rest."""

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Interval:
    """Rows `start` to `stop` of a recording, without those of `knocks` (pairs of rows).

    `reason`: why it is not used; empty if it is. `mean` (3): mean accelerations, in the recording's unit.
    """

    start: int
    stop: int
    start_s: float
    stop_s: float
    mean: NDArray[np.float64]
    knocks: tuple[tuple[int, int], ...] = ()
    reason: str = ""

    def as_dict(self) -> dict:
        """The interval as keys and values of a file."""
        record = asdict(self) | {"mean": self.mean.tolist(), "knocks": [list(pair) for pair in self.knocks]}
        return record | {"used": not self.reason}

"""Forms of hysteresis: what the readings of rising and falling temperature differ by, as functions of the history.

The half width of a branch depends on the history of the temperature by a law that differs between units. Three forms are
compared; the parameters over temperature are those of the middle between the branches.

- `hysteresis`: a difference by direction, complete from the first row after a reversal.
- `hysteresis_closed`: both branches meet at the ends of the range; Rayleigh's law is the first shape.
- `hysteresis_memory`: a sum of stop operators (Prandtl; Visintin, Differential Models of Hysteresis, 1994), which need a part
  of the range for a change of branch. Their mean over both branches depends on temperature, and no polynomial describes it.
"""

import numpy as np
from jaxtyping import Float

from tumblecal.recordings.thermal.thermal_table import ThermalTable


FORMS = ("hysteresis", "hysteresis_closed", "hysteresis_memory")
# Changes of temperature that reverse a stop operator, as parts of the range.
_WIDTHS = (1 / 4, 1 / 8, 1 / 2)


def forms_of(table: ThermalTable) -> dict[str, list[Float[np.ndarray, " rows"]]]:
    """The shapes of each form, nested; none if the temperature has one direction only."""
    if not {1, -1} <= set(table.reached_by.tolist()):
        return {}
    low, high = table.range_degc
    share = 2 * (table.temperature_degc - low) / (high - low) - 1
    direction = np.asarray(table.reached_by, float)
    # A soak at a reversal is on both branches.
    reversal = np.zeros(len(table), bool)
    for rows in _histories(table):
        reversal[rows[:-1]] = table.soak[rows[:-1]] & (direction[rows[:-1]] * direction[rows[1:]] < 0)
    closed = np.where(reversal, 0.0, direction) * (1 - share**2)
    forms = (
        [direction * shape for shape in (np.ones(len(table)), share, share**2 - 1 / 3)],
        [closed * shape for shape in (np.ones(len(table)), share, share**2 - 1 / 5)],
        [_stop_operator(table, width * (high - low)) for width in _WIDTHS],
    )
    return dict(zip(FORMS, forms, strict=True))


def _histories(table: ThermalTable) -> list[np.ndarray]:
    """Rows of each attitude and clock in the order of time."""
    labels = np.array([f"{a}\n{c}" for a, c in zip(table.attitude, table.clock, strict=True)])
    parts = [np.flatnonzero(labels == label) for label in dict.fromkeys(labels.tolist())]
    return [rows[np.argsort(table.time_s[rows], kind="stable")] for rows in parts]


def _stop_operator(table: ThermalTable, width_degc: float) -> Float[np.ndarray, " rows"]:
    """The state of a stop operator at each row, between -1 and 1 (the width is the change from -1 to 1); 0 at the start of each
    recording."""
    state = np.zeros(len(table))
    for rows in _histories(table):
        degc, sign = table.temperature_degc[rows], np.asarray(table.reached_by)[rows]
        ramp = ~table.soak[rows]
        # Rows of ramps are means, so a ramp extends by half of the distance between rows beyond its outer rows.
        joined = ramp[1:] & ramp[:-1] & (sign[1:] == sign[:-1])
        half = np.where(joined, np.abs(np.diff(degc)) / 2, 0.0)
        now, before = 0.0, degc[0] - (sign[0] * half[0] if len(half) else 0.0)
        for k, (row, value) in enumerate(zip(rows, degc, strict=True)):
            reversed_at = degc[k - 1] + sign[k - 1] * half[k - 2] if k > 1 and sign[k] != sign[k - 1] else before
            for reached in (reversed_at, value):
                now, before = float(np.clip(now + 2 * (reached - before) / width_degc, -1.0, 1.0)), reached
            state[row] = now
    return state

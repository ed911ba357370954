"""Temperatures of the next measurement in words: a further soak, the reverse order, another rate."""

from collections.abc import Iterator

import numpy as np

from tumblecal.diagnosis import Diagnosis
from tumblecal.effects.temperature import reached_from
from tumblecal.planning.conditions import between_soaks


def temperature_notes(diagnosis: Diagnosis) -> Iterator[str]:
    """Instructions that test the causes of temperature among the explanations; none without such a cause."""
    where, degc = diagnosis.problem.where, diagnosis.data.temperature_degc
    ids = {label.partition(":")[0] for labels in (diagnosis.best.labels, *diagnosis.best.stated) for label in labels}
    entries = [diagnosis.entries[id] for id in sorted(ids) if id in diagnosis.entries]
    thermal = [entry for entry in entries if "temperature_degc" in entry.needs]
    if degc is None or not thermal or where.soaks < 2:
        return
    between = between_soaks(np.asarray(degc, float))
    if between is not None and any(entry.over_temperature for entry in thermal):
        yield f"A further soak at {between:.1f} degC, between those measured, tests the order of the dependence on temperature."
    if where.time_s is None:
        return
    if not np.any(np.asarray(reached_from(where))):
        yield (
            "Measure the same temperatures again in the reverse order: these data reach them in one direction only, so a "
            "hysteresis or a drift is included in the dependence on temperature."
        )
    elif any(entry.id.startswith("bias_hysteresis") for entry in thermal):
        yield (
            "Measure the same temperatures again in the reverse order: a hysteresis changes its sign with the direction, a "
            "drift does not."
        )
    if any(entry.id.startswith(("temperature_rate", "temperature_lag")) for entry in thermal):
        yield (
            "Repeat the change of temperature at half of its rate: an error by the rate or by the lag of the thermometer is "
            "then half as large, a hysteresis is unchanged."
        )

"""Set-up errors found before the fit, and corrected.

An error with a unique correction is corrected and reported. Any other is rejected with the hypotheses that would explain it.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from tumblecal.chain import Chain
from tumblecal.chain.nominal import FreeAttitude
from tumblecal.data import PositionSet
from tumblecal.data.conditions import are_kelvin
from tumblecal.data.gravity_size import moving_fault
from tumblecal.estimation.position_problem import where_of
from tumblecal.estimation.setup.choice import turned, with_right_angles
from tumblecal.estimation.setup.error import SetupError
from tumblecal.estimation.setup.units import in_g
from tumblecal.estimation.setup.unmeasured import refuse_silent_axes, refuse_unmeasured
from tumblecal.ground.clocks import continued_times
from tumblecal.ground.errors import InputError


# 0 degC in kelvin.
_ICE_POINT_K = 273.15
# Clocks that start within this share of a step of one another were both set to the start of their run.
_SAME_START = 0.1


def correct_setup_errors(data: PositionSet, chain: Chain | None = None) -> tuple[PositionSet, list[SetupError]]:
    """Find set-up errors by comparison with the readings of a perfect instrument, and correct them.

    **Arguments:**

    - `data`: as given, readings assumed to be in g. `chain`: the given model with the intended attitudes of the mountings;
      None for the default model.

    **Returns:** the corrected set, and the errors found.

    **Raises:** `InputError` for errors without a unique correction: an axis without a separate signal, readings in an unknown
    unit, angles that the readings do not follow.
    """
    corrected, errors = _corrected(data, chain)
    if chain is not None and where_of(corrected).labels != where_of(data).labels:
        raise InputError(
            f"{data.source}: {errors[-1].description}; correct the file, because the given model "
            "numbers the pitch settings as the file lists them"
        )
    return corrected, errors


def _corrected(data: PositionSet, chain: Chain | None) -> tuple[PositionSet, list[SetupError]]:
    data, errors = _conditions(data)
    data, of_units = in_g(data)
    errors += of_units
    if data.hand_held and (fault := moving_fault(data)):
        raise InputError(f"{data.source}: {fault}")
    if data.hand_held or (chain is not None and any(isinstance(link, FreeAttitude) for link in chain.links)):
        return data, errors
    as_turned = turned(data, chain)
    refuse_silent_axes(as_turned.data, as_turned.ideal)
    data, of_angles = with_right_angles(as_turned)
    refuse_unmeasured(data)
    return data, [*errors, *filter(None, [as_turned.error]), *of_angles]


def _conditions(data: PositionSet) -> tuple[PositionSet, list[SetupError]]:
    """The set with temperatures in degC and times that increase through the file."""
    errors: list[SetupError] = []
    temperature, time = data.temperature_degc, data.time_s
    if temperature is not None and are_kelvin(temperature):
        words = f"the temperatures, {np.min(temperature):.4g} to {np.max(temperature):.4g}, are in kelvin"
        data = replace(data, temperature_degc=temperature - _ICE_POINT_K)
        errors.append(SetupError("temperature_unit", words))
    if time is not None and (parts := _restarted(time)):
        firsts = np.cumsum([len(part) for part in parts])[:-1]
        part = np.searchsorted(firsts, np.arange(len(time)), side="right")
        clock = tuple(f"{label}.{number}" for label, number in zip(data.labels("clock"), part, strict=True))
        data = replace(data, time_s=continued_times(parts), clock=clock)
        # One clock for each run is no error.
        if data.run is None or not np.array_equal(firsts, _changes(data.run)):
            errors.append(
                SetupError(
                    "time_restarts",
                    f"time_s restarts at position {', '.join(data.names[row] for row in firsts[:6])}; the pause before it is "
                    "assumed to have an unknown length",
                )
            )
    return data, errors


def _changes(labels: Sequence[str]) -> list[int]:
    """The rows whose label differs from that of the previous row."""
    return [row for row, (before, label) in enumerate(pairwise(labels), start=1) if before != label]


def _restarted(time: Float[np.ndarray, " positions"]) -> list[np.ndarray]:
    """The parts of the times between resets of the clock; empty if it was not reset.

    Times also decrease if the rows are not in measuring order, but then not to the same start.
    """
    back = np.flatnonzero(np.diff(time) < 0) + 1
    if not 0 < len(back) <= len(time) // 4:
        return []
    parts = np.split(time, back)
    step = float(np.median(np.concatenate([np.diff(part) for part in parts])))
    starts = np.array([part[0] for part in parts])
    return parts if np.max(np.abs(starts - starts[0])) <= _SAME_START * step else []

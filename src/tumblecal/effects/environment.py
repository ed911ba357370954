"""Effects of time and temperature: drift, warm-up, temperature coefficients."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from tumblecal.chain import Link, Where
from tumblecal.effects.added_terms import output_effect
from tumblecal.effects.drift import decays, drift_effect
from tumblecal.effects.effect import OF_RUN, RARE, Effect, elapsed
from tumblecal.ground.axes import AXES


REFERENCE_DEGC = 25.0
# Start values of the time constant, as shares of the duration of the measurement, and their prior weights. The last is nearly a
# linear drift of all axes, which is the simpler explanation.
_TAU_SHARES, _MET = (0.07, 0.2, 0.5, 3.0), (1.0, 1.0, 1.0, 0.1)


def _warm_up(where: Where) -> tuple[Link, ...]:
    duration = float(np.max(np.asarray(elapsed(where)))) or 1.0
    return decays("warm_up", elapsed, [share * duration for share in _TAU_SHARES], clocks=where.clocks)


def warmer(where: Where) -> Array:
    """Temperature above the reference, degC."""
    return jnp.asarray(where.temperature_degc) - REFERENCE_DEGC


def _square_from_mean(u, where: Where):
    return (jnp.asarray(where.time_s) - jnp.asarray(where.mean_time_s)) ** 2


def _axis_entries(number: int, axis: str) -> tuple[Effect, ...]:
    return (
        drift_effect(
            f"bias_drift.{axis}",
            axis,
            [lambda u: 1.0],
            unit="mg/h",
            typical=0.2,
            physics="bias linear in time_s",
            cause=f"The bias of the {axis} axis drifts steadily during the measurement.",
            advice="Let the unit settle longer; repeat the first position at the end; measure positions in another order.",
            source="IEEE 1293 (bias trending)",
            not_held=OF_RUN,
            of_time=1,
        ),
        output_effect(
            f"bias_drift_square.{axis}",
            axis,
            _square_from_mean,
            unit="mg/h/h",
            typical=0.2,
            physics="bias proportional to the square of time_s less its mean",
            needs=("time_s",),
            cause=f"The drift of the bias of the {axis} axis becomes slower or faster during the measurement.",
            advice="Let the unit settle longer; repeat the first position at the end; measure positions in another order.",
            source="IEEE 1293 (bias trending)",
            weight=RARE,
            not_held=OF_RUN,
            of_time=2,
        ),
        drift_effect(
            f"scale_drift.{axis}",
            axis,
            [lambda u: u[number]],
            unit="(mg/g)/h",
            typical=0.2,
            physics="scale factor linear in time_s",
            cause=f"The scale factor of the {axis} axis drifts steadily during the measurement.",
            advice="Check supply and reference voltage over time; repeat the first positions at the end.",
            source="IEEE 1293 (scale factor trending)",
            not_held=OF_RUN,
        ),
        output_effect(
            f"bias_temperature.{axis}",
            axis,
            lambda u, where: warmer(where),
            unit="mg/degC",
            typical=0.1,
            physics=f"bias linear in temperature_degc - {REFERENCE_DEGC:g}",
            forms=({"axis": axis, "powers": [0, 0, 0], "per_degc": True, "reference_degc": REFERENCE_DEGC},),
            needs=("temperature_degc",),
            cause=f"The bias of the {axis} axis follows the temperature.",
            advice="Keep the temperature constant, or apply the temperature term from the extended calibration.",
            source="IEEE 1293 (bias temperature sensitivity)",
        ),
        output_effect(
            f"scale_temperature.{axis}",
            axis,
            lambda u, where: u[number] * warmer(where),
            unit="(mg/g)/degC",
            typical=0.1,
            physics=f"scale factor linear in temperature_degc - {REFERENCE_DEGC:g}",
            forms=(
                {
                    "axis": axis,
                    "powers": [int(number == other) for other in range(3)],
                    "per_degc": True,
                    "reference_degc": REFERENCE_DEGC,
                },
            ),
            needs=("temperature_degc",),
            cause=f"The scale factor of the {axis} axis follows the temperature.",
            advice="Keep the temperature constant, or apply the temperature term from the extended calibration.",
            source="IEEE 1293 (scale factor temperature sensitivity)",
        ),
    )


ENTRIES = (
    *(entry for number, axis in enumerate(AXES) for entry in _axis_entries(number, axis)),
    Effect(
        "warm_up",
        "per-axis amplitude * exp(-t / tau)",
        "mg",
        1.0,
        "The outputs settle after power-on, with one time constant.",
        "Wait several time constants before the first position.",
        "IEEE 1293 (turn-on transient)",
        _warm_up,
        needs=("time_s",),
        shares=_MET,
        pauses="any",
        not_held=OF_RUN,
    ),
)

"""Effects of the past: the previous position, the last change of setting, earlier temperatures."""

import jax
import jax.numpy as jnp
import numpy as np

from tumblecal.chain import Link, Where
from tumblecal.effects.added_terms import output_effect
from tumblecal.effects.drift import decays
from tumblecal.effects.effect import MEAN, OF_PATH, OF_RUN, RARE, Effect
from tumblecal.ground.axes import AXES


# Hysteresis reverses within this change of the input, g.
TURN_OVER_G = 0.1
# Start values of the time constant of settling, in median steps between positions.
_TAU_STEPS = (1.0, 4.0)


def change(values, where: Where) -> jax.Array:
    """Change of the values since the previous position in the same run; 0 at the first of a run or clock."""
    values = jnp.asarray(values)
    before = where.earlier("run")
    if where.clocks > 1:
        clock = jnp.asarray(where.index("clock"))
        before = jnp.where(clock[before] == clock, before, jnp.arange(len(before)))
    return values - values[before]


def since_change(where: Where) -> jax.Array:
    """Time since the last change of the pitch setting, s, at its first position. A pause of unknown length counts as a
    change."""
    order, time = where.in_order, jnp.asarray(where.time_s)
    setting = jnp.asarray(where.index("run.pitch"))[order]
    changed = jnp.concatenate([jnp.array([True]), setting[1:] != setting[:-1]])
    if where.clocks > 1:
        clock = jnp.asarray(where.index("clock"))[order]
        changed = changed.at[1:].set(changed[1:] | (clock[1:] != clock[:-1]))
    number = jnp.cumsum(changed) - 1
    began = time[order][jnp.searchsorted(number, number, side="left")]
    return jnp.zeros_like(time).at[order].set(time[order] - began)


def _settling(where: Where) -> tuple[Link, ...]:
    time = np.asarray(where.time_s)
    order = np.argsort(time, kind="stable")
    clock = np.asarray(where.index("clock"))[order] if where.clocks > 1 else np.zeros(len(time), int)
    step = float(np.median(np.diff(time[order])[np.diff(clock) == 0])) or 1.0
    return decays("settling", since_change, [steps * step for steps in _TAU_STEPS])


def _warming(u, where: Where):
    """Change of temperature per minute, since the previous position."""
    passed = change(where.time_s, where)
    return jnp.where(passed > 0, 60.0 * change(where.temperature_degc, where) / jnp.maximum(passed, 1e-9), 0.0)


def _square_from_mean(u, where: Where):
    return (jnp.asarray(where.temperature_degc) - jnp.asarray(where.mean_degc)) ** 2


def _axis_entries(number: int, axis: str) -> tuple[Effect, ...]:
    def since_before(u, where: Where):
        assert where.inputs_before is not None
        return u[number] - where.inputs_before[number]

    def late(u, where: Where):
        return -since_before(u, where)

    def turning(u, where: Where):
        return jnp.clip(since_before(u, where) / TURN_OVER_G, -1.0, 1.0)

    return (
        output_effect(
            f"memory.{axis}",
            axis,
            late,
            unit="mg/g",
            typical=0.2,
            physics="K (u of the previous position - u)",
            cause=f"The {axis} axis still shows a part of the previous position when it is read (filter, read too early).",
            advice="Wait longer after each move; check the time constant of the filter and the delay of the log.",
            source="IEEE 1293 (settling after a change of input)",
            weight=RARE,
            looks_back=True,
            not_held=OF_PATH,
        ),
        output_effect(
            f"hysteresis.{axis}",
            axis,
            turning,
            unit="mg",
            typical=0.1,
            physics=f"K sgn(u - u of the previous position), reversing within {TURN_OVER_G:g} g",
            cause=f"The {axis} axis reads differently after an increase and after a decrease of its input.",
            advice="Approach each position from the same side; measure the same positions in the opposite order.",
            source="IEEE 1293 (hysteresis error)",
            weight=RARE,
            looks_back=True,
            not_held=OF_PATH,
        ),
        output_effect(
            f"bias_temperature_square.{axis}",
            axis,
            _square_from_mean,
            unit="mg/degC/degC",
            typical=0.05,
            physics="bias proportional to the square of temperature_degc less its mean",
            forms=({"axis": axis, "powers": [0, 0, 0], "degc_power": 2, "reference_degc": MEAN},),
            needs=("temperature_degc",),
            cause=f"The bias of the {axis} axis depends on the square of the temperature.",
            advice="Keep the temperature constant, or apply the temperature term from the extended calibration.",
            source="IEEE 1293 (bias temperature sensitivity, second order)",
            weight=RARE,
        ),
        output_effect(
            f"temperature_rate.{axis}",
            axis,
            _warming,
            unit="mg/degC",
            typical=0.1,
            physics="bias linear in the change of temperature_degc per minute",
            needs=("time_s", "temperature_degc"),
            pauses="any",
            cause=f"The {axis} axis is not yet at the temperature shown: its bias follows the rate of change (a sensor that "
            "leads or lags, such as a lag of the thermometer: in proportion to the slope of the bias over temperature).",
            advice="Let the temperature settle; put the temperature sensor on the unit itself.",
            source="IEEE 1293 (temperature gradient sensitivity)",
            not_held=OF_PATH,
            weight=RARE,
        ),
    )


ENTRIES = (
    *(entry for number, axis in enumerate(AXES) for entry in _axis_entries(number, axis)),
    Effect(
        "settling",
        "per-axis amplitude * exp(-t / tau), t since the last change of the pitch setting",
        "mg",
        0.5,
        "The outputs settle after each change of the pitch setting, with one time constant.",
        "Wait several time constants after each change of setting; measure the first position of a setting twice.",
        "IEEE 1293 (settling after a change of input)",
        _settling,
        needs=("time_s", "pitch"),
        weight=RARE,
        pauses="any",
        not_held=OF_RUN,
    ),
)

"""Effects that change with the pitch setting or the run: a different bias, scale factor, index zero, mount or drift."""

import math
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from tumblecal.chain import Link, Parameter, Place, State, Where, coefficients
from tumblecal.chain.link import turned
from tumblecal.effects.added_terms import Term
from tumblecal.effects.effect import BETWEEN_RUNS, OF_GROUPS, OF_MOUNT, RARE, Effect
from tumblecal.ground.axes import AXES
from tumblecal.ground.frames import rotate_x, rotate_y, rotate_z


class GroupTerms(Link):
    """A term with a coefficient for each group of an index column: `A += size_group * term(u, where)` on some axes.

    The first group has none: the nominal model includes its bias and scale factor.
    """

    place: ClassVar[Place] = Place.READING
    size: Parameter
    by: str = eqx.field(static=True)
    axes: tuple[int, ...] = eqx.field(static=True)
    terms: tuple[Term, ...] = eqx.field(static=True)

    def __call__(self, state: State, where: Where) -> State:
        sizes, reading = self.size.at(where), list(state.reading)
        for number, (axis, term) in enumerate(zip(self.axes, self.terms, strict=True)):
            size = _in_group(sizes[number :: len(self.axes)], where, self.by)
            reading[axis] = reading[axis] + size * term(state.f, where)
        return eqx.tree_at(lambda s: s.reading, state, tuple(reading))


class IndexZero(Link):
    """`alpha + e`, one e for each pitch setting after the first: the index does not return to its zero."""

    place: ClassVar[Place] = Place.INDEX
    by: ClassVar[str] = "pitch"
    zero: Parameter

    def __call__(self, state: State, where: Where) -> State:
        return eqx.tree_at(lambda s: s.alpha, state, state.alpha + _in_group(self.zero.at(where), where, "pitch"))


class MovedMount(Link):
    """`f4 = Rx Ry Rz f4'` at one pitch setting, after the fixed angles of the mount."""

    place: ClassVar[Place] = Place.MOUNT
    angles: Parameter
    setting: int = eqx.field(static=True)

    def __call__(self, state: State, where: Where) -> State:
        here = jnp.asarray(where.index("pitch")) == self.setting
        x, y, z = (jnp.where(here, angle, 0.0) for angle in self.angles.at(where))
        return turned(state, rotate_x(x, rotate_y(y, rotate_z(z, state.f))))


def _in_group(sizes: tuple, where: Where, by: str):
    """Coefficient of each position: that of its group, zero in the first group."""
    group = jnp.asarray(where.index(by))
    return sum(jnp.where(group == number, size, 0.0) for number, size in enumerate(sizes, start=1))


def _later(where: Where, by: str) -> list[str]:
    return [name.lstrip("_@") for name in where.names(by)][1:]


def _one(u, where: Where):
    return 1.0


def _run_bias(where: Where) -> tuple[Link, ...]:
    components = [f"{axis}_{name}" for name in _later(where, "run") for axis in AXES]
    size = coefficients("bias_repeatability", components, unit="g", scale=1e-3)
    return (GroupTerms(size, "run", (0, 1, 2), (_one, _one, _one)),)


def _moved_mounts(where: Where) -> tuple[Link, ...]:
    """A variant for each pitch setting at which the mount may be another; of two settings the second."""
    names = [name.lstrip("_@") for name in where.names("pitch")]
    return tuple(
        MovedMount(coefficients("mount_by_pitch", [f"{axis}_{name}" for axis in AXES], unit="rad", scale=2e-4), setting)
        for setting, name in enumerate(names)
        if len(names) > 2 or setting
    )


def _axis_entries(number: int, axis: str) -> tuple[Effect, ...]:
    def by_pitch(id: str, unit: str, term: Term, scale: float):
        def make(where: Where) -> tuple[Link, ...]:
            size = coefficients(id, _later(where, "pitch"), unit=unit, scale=scale)
            return (GroupTerms(size, "pitch", (number,), (term,)),)

        return make

    def drift(where: Where) -> tuple[Link, ...]:
        size = coefficients(f"run_drift.{axis}", ["first", *_later(where, "run")], unit="g/s", scale=5e-8)
        return (RunDrift(size, number),)

    return (
        Effect(
            f"bias_by_pitch.{axis}",
            "a different bias at each pitch setting after the first",
            "mg",
            0.2,
            f"The bias of the {axis} axis is not the same at every pitch setting: it changes with each new set-up.",
            "Do not switch off between settings; return to the first position after each change of setting.",
            "IEEE 1293 (bias repeatability, turn-on to turn-on)",
            by_pitch(f"bias_by_pitch.{axis}", "g", _one, 2e-4),
            needs=("pitch",),
            weight=RARE,
            not_held=OF_GROUPS,
        ),
        Effect(
            f"scale_by_pitch.{axis}",
            "a different scale factor at each pitch setting after the first",
            "mg/g",
            0.2,
            f"The scale factor of the {axis} axis is not the same at every pitch setting.",
            "Check supply and reference voltage when the setting is changed; measure the settings in another order.",
            "IEEE 1293 (scale factor repeatability)",
            by_pitch(f"scale_by_pitch.{axis}", "g/g", lambda u, where: u[number], 2e-4),
            needs=("pitch",),
            weight=RARE,
            not_held=OF_GROUPS,
            # As of the scale factor itself. Where the input is near zero, larger ones could explain any bias.
            largest=0.1,
        ),
        Effect(
            f"run_drift.{axis}",
            "bias linear in the time since each run's first position, a rate for each run",
            "mg/h",
            0.2,
            f"The bias of the {axis} axis drifts in each run, with a separate rate and start.",
            "Let the unit settle longer before each run; repeat the first position at the end of each run.",
            "IEEE 1293 (bias trending)",
            drift,
            needs=("time_s", "run"),
            weight=RARE,
            pauses=BETWEEN_RUNS,
            not_held=OF_GROUPS,
        ),
    )


class RunDrift(Link):
    """`A_axis += rate_run * (time since the run's first position)`, s."""

    place: ClassVar[Place] = Place.READING
    rate: Parameter
    axis: int = eqx.field(static=True)

    def __call__(self, state: State, where: Where) -> State:
        run, time = jnp.asarray(where.index("run")), jnp.asarray(where.time_s)
        drift = sum(
            jnp.where(run == number, rate * (time - jnp.min(jnp.where(run == number, time, jnp.inf))), 0.0)
            for number, rate in enumerate(self.rate.at(where))
        )
        reading = tuple(value + drift if k == self.axis else value for k, value in enumerate(state.reading))
        return eqx.tree_at(lambda s: s.reading, state, reading)


ENTRIES = (
    Effect(
        "bias_repeatability",
        "a different bias in each run after the first, all axes",
        "mg",
        1.0,
        "The bias is not the same from run to run (switching on, temperature, ageing).",
        "Let the bias differ between runs (a rig with bias by run), and calibrate it after every power-on.",
        "IEEE 1293 (bias repeatability)",
        _run_bias,
        needs=("run",),
        not_held=OF_GROUPS,
    ),
    *(entry for number, axis in enumerate(AXES) for entry in _axis_entries(number, axis)),
    Effect(
        "index_zero",
        "alpha + e, one e for each pitch setting after the first",
        "mrad",
        0.1,
        "The index of the spindle does not return to its zero when the pitch setting is changed.",
        "Check the index against a reference face after every change of the pitch setting.",
        "dividing-head geometry; first-order terms as in rotary-table testing (IEEE 836)",
        lambda where: (IndexZero(coefficients("index_zero", _later(where, "pitch"), unit="rad", scale=1e-4)),),
        needs=("pitch",),
        weight=RARE,
        # As for a pitch setting and its vernier. With a vertical spindle, an index error of any size could explain anything.
        largest=math.radians(2.0),
    ),
    Effect(
        "mount_by_pitch",
        "Rx Ry Rz after the mount at one pitch setting (in a rig: the one with the smallest beta)",
        "mrad",
        0.2,
        "The angles of the triad in its fixture differ at one pitch setting (a clamp or cable gives way under its weight).",
        "Clamp the triad again; measure this pitch setting again, and another one near it.",
        "laboratory practice",
        _moved_mounts,
        needs=("pitch",),
        weight=RARE,
        not_held=OF_MOUNT,
        largest=math.radians(2.0),
    ),
)

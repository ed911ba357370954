"""Effects on the alignment: the mount, or a sensitive axis, turns with the time or the temperature."""

from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx

from tumblecal.chain import Link, Parameter, Place, State, Where, coefficients
from tumblecal.chain.link import turned
from tumblecal.effects.added_terms import base_unit, output_effect
from tumblecal.effects.drift import Factor, changed, changes, drift_effect
from tumblecal.effects.effect import OF_MOUNT, OF_RUN, RARE, Effect, elapsed
from tumblecal.effects.environment import REFERENCE_DEGC, warmer
from tumblecal.ground.axes import AXES
from tumblecal.ground.frames import rotate_x, rotate_y, rotate_z


class TurningMount(Link):
    """The mount turned by `rate * follows(where)`, after its fixed angles: `f4 = Rx Ry Rz f4'`.

    `change`: difference of the angles at each later clock, if the pauses have unknown lengths.
    """

    place: ClassVar[Place] = Place.MOUNT
    rate: Parameter
    follows: Callable[[Where], Any] = eqx.field(static=True)
    change: Parameter | None = None

    def __call__(self, state: State, where: Where) -> State:
        along = self.follows(where)
        angles = [rate * along for rate in self.rate.at(where)]
        if self.change is not None:
            since_first = changed(self.change.at(where), len(angles), where)
            angles = [angle + change for angle, change in zip(angles, since_first, strict=True)]
        about_x, about_y, about_z = angles
        return turned(state, rotate_x(about_x, rotate_y(about_y, rotate_z(about_z, state.f))))


def _turning(
    follows: Callable[[Where], Any],
    column: str,
    id: str,
    physics: str,
    unit: str,
    typical: float,
    cause: str,
    advice: str,
) -> Effect:
    """A mount whose angles follow a column of the data."""
    base, scale = base_unit(unit)

    def make(where: Where) -> tuple[Link, ...]:
        rate = coefficients(id, AXES, unit=base, scale=typical * scale)
        if column != "time_s" or where.clocks == 1:
            return (TurningMount(rate, follows),)
        return (TurningMount(rate, follows, changes(id, AXES, unit=base, scale=typical * scale, where=where)),)

    described = id, physics, unit, typical, cause, advice, "laboratory practice"
    return Effect(*described, make, needs=(column,), weight=RARE, pauses="any", not_held=OF_MOUNT)


def _other_inputs(number: int) -> list[Factor]:
    """The factors of an output's misalignment: each other input."""
    return [lambda u, other=other: u[other] for other in range(3) if other != number]


def _axis_entries(number: int, axis: str) -> tuple[Effect, ...]:
    others = [other for other in AXES if other != axis]
    thermal = {"axis": axis, "per_degc": True, "reference_degc": REFERENCE_DEGC}
    return (
        drift_effect(
            f"misalignment_drift.{axis}",
            axis,
            _other_inputs(number),
            unit="mrad/h",
            typical=0.2,
            physics=f"a share of u_{others[0]} and of u_{others[1]}, linear in time_s, on output {axis}",
            components=others,
            cause=f"The sensitive axis of {axis} turns steadily during the measurement.",
            advice="Check the attachment of this sensor (glue, solder); repeat the first positions at the end.",
            source="IEEE 1293 (input axis misalignment, trending)",
            not_held=OF_RUN,
            weight=RARE,
        ),
        output_effect(
            f"misalignment_temperature.{axis}",
            axis,
            [lambda u, where, factor=factor: factor(u) * warmer(where) for factor in _other_inputs(number)],
            unit="mrad/degC",
            typical=0.05,
            physics=f"a share of u_{others[0]} and of u_{others[1]}, linear in temperature_degc - {REFERENCE_DEGC:g}, "
            f"on output {axis}",
            components=others,
            forms=[thermal | {"powers": [int(name == other) for name in AXES]} for other in others],
            needs=("temperature_degc",),
            cause=f"The sensitive axis of {axis} turns with the temperature.",
            advice="Keep the temperature constant, or apply the temperature terms from the extended calibration.",
            source="IEEE 1293 (input axis misalignment, temperature sensitivity)",
            weight=RARE,
        ),
    )


ENTRIES = (
    *(entry for number, axis in enumerate(AXES) for entry in _axis_entries(number, axis)),
    _turning(
        elapsed,
        "time_s",
        "mount_drift",
        "Rx Ry Rz after the mount, angles linear in time_s",
        "mrad/h",
        0.2,
        "The triad turns steadily in its mount during the measurement.",
        "Tighten the mount, or let the glue set; repeat the first positions at the end.",
    ),
    _turning(
        warmer,
        "temperature_degc",
        "mount_temperature",
        f"Rx Ry Rz after the mount, angles linear in temperature_degc - {REFERENCE_DEGC:g}",
        "mrad/degC",
        0.05,
        "The mount turns the triad with the temperature (a bracket of two metals, a screw on one side).",
        "Keep the temperature constant, or mount the triad so that it can expand symmetrically.",
    ),
)

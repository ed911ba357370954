"""Effects of the dividing head: base, pitch axis, index, spindle, fixture, and local gravity."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from tumblecal.chain import Link, Parameter, Place, State, Where, coefficients
from tumblecal.chain.link import turned
from tumblecal.effects.effect import Effect
from tumblecal.ground.frames import rotate_x, rotate_y, rotate_z


class BaseRoll(Link):
    """`f2 = Rx(e) f1`: the head is rolled about the horizontal direction of its spindle."""

    place: ClassVar[Place] = Place.BASE
    roll: Parameter

    def __call__(self, state: State, where: Where) -> State:
        return turned(state, rotate_x(self.roll.at(where)[0], state.f))


class AxisPerpendicularity(Link):
    """`Rz(e)` between the pitch axis and the spindle."""

    place: ClassVar[Place] = Place.HEAD
    error: Parameter

    def __call__(self, state: State, where: Where) -> State:
        return turned(state, rotate_z(self.error.at(where)[0], state.f))


class IndexHarmonic(Link):
    """`alpha + c cos(n alpha) + s sin(n alpha)`: n = 1 eccentricity, n = 2 ellipticity of the index."""

    place: ClassVar[Place] = Place.INDEX
    size: Parameter
    order: int = eqx.field(static=True)

    def __call__(self, state: State, where: Where) -> State:
        cosine, sine = self.size.at(where)
        turn = self.order * jnp.asarray(where.alpha)
        return _indexed(state, cosine * jnp.cos(turn) + sine * jnp.sin(turn))


class IndexGain(Link):
    """`alpha (1 + e)`, with alpha from its zero."""

    place: ClassVar[Place] = Place.INDEX
    gain: Parameter

    def __call__(self, state: State, where: Where) -> State:
        return _indexed(state, self.gain.at(where)[0] * jnp.asarray(where.alpha))


class IndexBacklash(Link):
    """`alpha + e * approach`, approach +1 or -1: the direction of the last turn."""

    place: ClassVar[Place] = Place.INDEX
    play: Parameter

    def __call__(self, state: State, where: Where) -> State:
        return _indexed(state, self.play.at(where)[0] * jnp.asarray(where.approach))


class SpindleWobble(Link):
    """`Rz(c' cos n alpha + s' sin n alpha) Ry(c cos n alpha + s sin n alpha)` before the spindle's rotation."""

    place: ClassVar[Place] = Place.WOBBLE
    size: Parameter
    order: int = eqx.field(static=True)

    def __call__(self, state: State, where: Where) -> State:
        cos_y, sin_y, cos_z, sin_z = self.size.at(where)
        turn = self.order * state.alpha
        about_y = cos_y * jnp.cos(turn) + sin_y * jnp.sin(turn)
        about_z = cos_z * jnp.cos(turn) + sin_z * jnp.sin(turn)
        return turned(state, rotate_z(about_z, rotate_y(about_y, state.f)))


class FixtureFlexure(Link):
    """`Rz(-s_z f_y) Ry(s_y f_z)` after the spindle: the fixture bends under its load, unequally in two planes."""

    place: ClassVar[Place] = Place.FIXTURE
    compliance: Parameter

    def __call__(self, state: State, where: Where) -> State:
        s_y, s_z = self.compliance.at(where)
        _, y, z = state.f
        return turned(state, rotate_z(-s_z * y, rotate_y(s_y * z, state.f)))


class GravityValue(Link):
    """`f1` scaled by 1 + e: local gravity is not the one assumed."""

    place: ClassVar[Place] = Place.GRAVITY
    error: Parameter

    def __call__(self, state: State, where: Where) -> State:
        x, y, z = state.f
        ratio = 1.0 + self.error.at(where)[0]
        return turned(state, (x * ratio, y * ratio, z * ratio))


def _indexed(state: State, error) -> State:
    return State(state.alpha + error, state.beta, state.f, state.reading)


def _leaf(name: str, components: tuple[str, ...] = ("",), *, unit: str = "rad", scale: float = 1e-4) -> Parameter:
    return coefficients(name, components, unit=unit, scale=scale)


_WOBBLE = ("y_cos", "y_sin", "z_cos", "z_sin")
_HEAD = "dividing-head geometry; first-order terms as in rotary-table testing (IEEE 836)"

ENTRIES = (
    Effect(
        "base_levelling",
        "f2 = Rx(e) f1",
        "mrad",
        0.1,
        "The base of the dividing head is not level: it is rolled about the horizontal direction of its spindle.",
        "Level the base across the spindle with a precision level, or read the level and state the roll as known.",
        _HEAD,
        lambda where: (BaseRoll(_leaf("base_levelling")),),
    ),
    Effect(
        "axis_perpendicularity",
        "Rz(e) between pitch axis and spindle",
        "mrad",
        0.1,
        "The spindle is not square to the pitch axis.",
        "Check squareness with an indicator on a test bar; the error is a constant of the head: state it in the rig file.",
        _HEAD,
        lambda where: (AxisPerpendicularity(_leaf("axis_perpendicularity")),),
    ),
    Effect(
        "index_eccentricity",
        "alpha + c cos(alpha) + s sin(alpha)",
        "mrad",
        0.1,
        "The angle scale of the spindle is mounted eccentrically: its error has one period per turn.",
        "Read the scale at two opposite heads, or compare with a polygon and autocollimator; state the error as known.",
        _HEAD,
        lambda where: (IndexHarmonic(_leaf("index_eccentricity", ("cos", "sin")), 1),),
    ),
    Effect(
        "index_ellipticity",
        "alpha + c cos(2 alpha) + s sin(2 alpha)",
        "mrad",
        0.1,
        "The angle error of the spindle has two periods per turn (an oval or bent scale, a coupling).",
        "Compare the index with a polygon and autocollimator at 45 degree steps; look for a strained coupling.",
        _HEAD,
        lambda where: (IndexHarmonic(_leaf("index_ellipticity", ("cos", "sin")), 2),),
    ),
    Effect(
        "index_gain",
        "alpha (1 + e)",
        "mrad/rad",
        0.05,
        "The scale factor of the spindle angle is wrong: the error is proportional to the angle from zero.",
        "Close the circle: 360 degrees must return to 0; check the gear ratio or counts per turn.",
        _HEAD,
        lambda where: (IndexGain(_leaf("index_gain", unit="1")),),
    ),
    Effect(
        "index_backlash",
        "alpha + e * approach",
        "mrad",
        0.05,
        "The spindle stops at a different angle if approached from the other side (backlash, wind-up).",
        "Approach every position from the same side, or preload the drive.",
        _HEAD,
        lambda where: (IndexBacklash(_leaf("index_backlash")),),
        needs=("approach",),
    ),
    *(
        Effect(
            f"spindle_wobble_{order}",
            f"Rz(c' cos {'' if order == 1 else '2 '}alpha + s' sin ..) Ry(c cos {'' if order == 1 else '2 '}alpha + s sin ..) "
            "before the spindle rotation",
            "mrad",
            0.1,
            f"The spindle axis tilts {times} per turn while it rotates (bearing or runout).",
            "Measure the axis tilt with two indicators on a test bar; replace or preload the bearing.",
            "spindle error motion, ISO 230-7",
            lambda where, order=order: (SpindleWobble(_leaf(f"spindle_wobble_{order}", _WOBBLE), order),),
        )
        for order, times in ((1, "once"), (2, "twice"))
    ),
    Effect(
        "fixture_flexure",
        "Rz(-s_z f_y) Ry(s_y f_z) after the spindle",
        "mrad/g",
        0.1,
        "The fixture bends under the weight of its load, by different amounts in its two planes.",
        "Stiffen the fixture or move the load's centre of gravity to the spindle; repeat with half the load.",
        "elastic deflection, IEEE 1293 (fixture effects)",
        lambda where: (FixtureFlexure(_leaf("fixture_flexure", ("y", "z"), unit="rad/g")),),
    ),
    Effect(
        "gravity_value",
        "f1 scaled by 1 + e",
        "1e-3",
        1.0,
        "Local gravity differs from the value that the readings were divided by.",
        "Look up or measure local gravity (it varies by 0.5 percent over the Earth) and state it in the file.",
        "IEEE 1293 (reference acceleration)",
        lambda where: (GravityValue(_leaf("gravity_value", unit="1", scale=1e-3)),),
    ),
)

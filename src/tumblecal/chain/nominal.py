"""The links of the nominal chain (the paper's figure 3)."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from tumblecal.chain.following import Following, following
from tumblecal.chain.frames import Vector
from tumblecal.chain.link import Link, Place, State, turned
from tumblecal.chain.parameter import Parameter, coefficients
from tumblecal.chain.where import Where
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.frames import rotate_x, rotate_y, rotate_z
from tumblecal.ground.numbers_shown import shortened
from tumblecal.ground.temperature_functions import TemperatureFunctions


class Base(Link):
    """Base of the head: `f2 = Rx(levelling) f1`; level (fixed at zero) in the nominal model."""

    place: ClassVar[Place] = Place.BASE
    levelling: Parameter | Following

    def __call__(self, state: State, where: Where) -> State:
        (roll,) = self.levelling.at(where)
        return turned(state, rotate_x(roll, state.f))


class PitchAxis(Link):
    """Pitch axis: `f3 = Ry(beta + dbeta) f2`, one unknown dbeta for each pitch setting."""

    place: ClassVar[Place] = Place.PITCH
    dbeta: Parameter | Following

    def __call__(self, state: State, where: Where) -> State:
        (error,) = self.dbeta.at(where)
        return turned(state, rotate_y(state.beta + error, state.f))


class Spindle(Link):
    """Spindle: `Rx(alpha)`; its index is the reference (0.1 arcsec in the paper)."""

    place: ClassVar[Place] = Place.SPINDLE

    def __call__(self, state: State, where: Where) -> State:
        return turned(state, rotate_x(state.alpha, state.f))


class FreeAttitude(Link):
    """An unknown attitude: f moved by `tilt` (rad) in the two directions perpendicular to it, then scaled to 1 g.

    With one tilt for each position only the size of gravity calibrates the sensor: a hand-held set. Gravity does not determine
    the third angle, the heading. The link comes before the mount, whose angles it makes redundant.
    """

    place: ClassVar[Place] = Place.FIXTURE
    tilt: Parameter | Following

    def __call__(self, state: State, where: Where) -> State:
        f = jnp.stack(state.f, axis=-1)
        first, second = across(f)
        one, two = self.tilt.at(where)
        moved = f + jnp.stack([one] * 3, axis=-1) * first + jnp.stack([two] * 3, axis=-1) * second
        size = jnp.linalg.norm(moved, axis=-1) / jnp.linalg.norm(f, axis=-1)
        x, y, z = (moved[:, axis] / size for axis in range(3))
        return turned(state, (x, y, z))


class Mount(Link):
    """Mount: `f4 = Rx(w_x) Ry(w_y) Rz(w_z) N f3'` with w = dtheta, exact at any angle.

    `nominal` is the intended orientation N of each mounting, or None if all are aligned with the head.
    """

    place: ClassVar[Place] = Place.MOUNT
    dtheta: Parameter | Following
    nominal: Float[Array | np.ndarray, "mounts 3 3"] | None = None

    def __call__(self, state: State, where: Where) -> State:
        about_x, about_y, about_z = self.dtheta.at(where)
        f = remounted(self.nominal, state.f, where)
        return turned(state, rotate_x(about_x, rotate_y(about_y, rotate_z(about_z, f))))


class SmallAngleMount(Link):
    """The paper's first-order mount, equation (1): `f4 = [1 w_z -w_y; -w_z 1 w_x; w_y -w_x 1] N f3'`."""

    place: ClassVar[Place] = Place.MOUNT
    dtheta: Parameter | Following
    nominal: Float[Array | np.ndarray, "mounts 3 3"] | None = None

    def __call__(self, state: State, where: Where) -> State:
        about_x, about_y, about_z = self.dtheta.at(where)
        x, y, z = remounted(self.nominal, state.f, where)
        return turned(
            state,
            (
                x + about_z * y - about_y * z,
                y - about_z * x + about_x * z,
                z + about_y * x - about_x * y,
            ),
        )


class Triad(Link):
    """Non-orthogonality of the sensitive axes: `f5 = T f4`, T = [1 0 0; g21 1 0; g31 g32 1]."""

    place: ClassVar[Place] = Place.TRIAD
    gamma: Parameter | Following

    def __call__(self, state: State, where: Where) -> State:
        g21, g31, g32 = self.gamma.at(where)
        x, y, z = state.f
        return turned(state, (x, y + g21 * x, z + g31 * x + g32 * y))


class Output(Link):
    """Scale factor error and bias: `A = (1 + dK) f5 + bias` per axis."""

    place: ClassVar[Place] = Place.OUTPUT
    dK: Parameter | Following
    bias: Parameter | Following

    def __call__(self, state: State, where: Where) -> State:
        scales, biases = self.dK.at(where), self.bias.at(where)
        x, y, z = (
            earlier + (1.0 + scale) * u + bias
            for earlier, u, scale, bias in zip(state.reading, state.f, scales, biases, strict=True)
        )
        return State(state.alpha, state.beta, state.f, (x, y, z))


def remounted(nominal: Array | np.ndarray | None, f: Vector, where: Where) -> Vector:
    """`N f` with the intended orientation of each position's mounting; `f` itself if there is none."""
    if nominal is None:
        return f
    chosen = jnp.asarray(nominal)[where.index("mount")]
    x, y, z = (chosen[:, row, 0] * f[0] + chosen[:, row, 1] * f[1] + chosen[:, row, 2] * f[2] for row in range(3))
    return x, y, z


def across(f: Float[Array, "positions 3"]) -> tuple[Float[Array, "positions 3"], Float[Array, "positions 3"]]:
    """Two unit vectors perpendicular to each f and to one another."""
    axis = jnp.eye(3)[jnp.argmin(jnp.abs(f), axis=-1)]
    first = jnp.cross(f, axis)
    first = first / jnp.linalg.norm(first, axis=-1)[:, None]
    second = jnp.cross(f, first)
    return first, second / jnp.linalg.norm(second, axis=-1)[:, None]


@dataclass(frozen=True)
class Leaf:
    """How one leaf is indexed (`by`, a column of the data), whether it is estimated, and which functions of temperature it
    follows; its change with them, the same in all groups, is estimated."""

    by: str | None = None
    free: bool = True
    follows: TemperatureFunctions | None = None


class NamedLeaf(NamedTuple):
    """A leaf of a link: its unit, its components, and its defaults."""

    unit: str
    components: tuple[str, ...] = ("",)
    usual: Leaf = Leaf()


class NamedLink(NamedTuple):
    """A link as named in rig files; `turned`: it uses the intended rotations of the mountings."""

    kind: type[Link]
    leaves: Mapping[str, NamedLeaf]
    turned: bool = False


_DTHETA = {"dtheta": NamedLeaf("rad", AXES)}
# All links of which a chain may consist, in the order of the chain. A new one is an entry here and its class above.
LINKS: dict[str, NamedLink] = {
    "base": NamedLink(Base, {"levelling": NamedLeaf("rad", usual=Leaf(free=False))}),
    "pitch_axis": NamedLink(PitchAxis, {"dbeta": NamedLeaf("rad", usual=Leaf("pitch"))}),
    "spindle": NamedLink(Spindle, {}),
    "free_attitude": NamedLink(FreeAttitude, {"tilt": NamedLeaf("rad", ("1", "2"), Leaf("position"))}),
    "mount": NamedLink(Mount, _DTHETA, turned=True),
    "small_angle_mount": NamedLink(SmallAngleMount, _DTHETA, turned=True),
    "triad": NamedLink(Triad, {"gamma": NamedLeaf("rad", ("21", "31", "32"))}),
    "output": NamedLink(Output, {"dK": NamedLeaf("1", AXES), "bias": NamedLeaf("g", AXES)}),
}
# The links of the nominal model, and of a set of unknown attitudes.
NOMINAL = ("base", "pitch_axis", "spindle", "mount", "triad", "output")
HAND_HELD = ("base", "pitch_axis", "spindle", "free_attitude", "mount", "triad", "output")
# Units of the leaves, the sensor's first; a coefficient of an effect is given in the unit of its own parameter.
UNIT_OF_LEAF = {name: leaf.unit for link in reversed(LINKS.values()) for name, leaf in link.leaves.items()}

# Beginning of the names of the errors of single pitch settings.
PITCH_ERROR = "dbeta@"


def unit_of_parameter(name: str, units: Mapping[str, str]) -> str | None:
    """The unit of a leaf (`dbeta`) or of one of its parameters (`dbeta_0`, `dK_x@run=2`)."""
    bare = name.partition("@")[0]
    while bare not in units and "_" in bare:
        bare = bare.rpartition("_")[0]
    return units.get(bare)


def unit_in(units: Mapping[str, str]) -> Callable[[str], str]:
    """The unit of a leaf or parameter by its name; a function that raises an `InputError` for an unknown one."""

    def unit_of(name: str) -> str:
        unit = unit_of_parameter(name, units)
        if unit is None:
            raise InputError(f"no such parameter; parameters: {shortened([*units], 10)}")
        return unit

    return unit_of


def nominal_link(
    name: str,
    where: Where,
    leaves: Mapping[str, Leaf],
    rotations: Callable[[], np.ndarray | None] = lambda: None,
) -> Link:
    """The link of that name in `LINKS`, its coefficients zero.

    **Arguments:**

    - `where`: the positions' settings.
    - `leaves`: how leaves are indexed and whether they are estimated, by name; the defaults if omitted.
    - `rotations`: gives the intended rotation of every mounting of the data, None if none is turned.

    **Raises:** `InputError` for an index column, or temperatures, that the data lack.
    """
    link, made = LINKS[name], {}
    for leaf, (unit, components, usual) in link.leaves.items():
        chosen = leaves.get(leaf, usual)
        values = coefficients(leaf, components, unit=unit, by=chosen.by, where=where, free=chosen.free)
        made[leaf] = values if chosen.follows is None else following(values, chosen.follows, where)
    return link.kind(**made, **({"nominal": rotations()} if link.turned else {}))

"""Effects of the sensor that are one function at 1 g: no measurement on a head separates them, and none needs to.

`u_x^2 + u_y^2 + u_z^2 = 1` in the field of gravity, so `u_z^2` is `-(u_x^2 + u_y^2)` except for a constant, which is a bias: a
calibration with either term corrects all readings at 1 g equally. Such identities are found as a rank of the contributions of
the effects to the outputs, at many independent attitudes, times and temperatures (as in all mountings together). Signals of
bias, scale factors and misalignments of a sensor are projected out.
"""

from collections.abc import Callable, Collection
from functools import cache, lru_cache
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from tumblecal.chain import Chain, Link, Place, State, Where, settings
from tumblecal.full_model.layout import Slot


# Attitudes: several times the columns of any sets that are compared.
_ATTITUDES = 240
# Singular values of unit columns below this are rounding.
_LEAST = 1e-6


# The links of an effect, and the number of a variant.
_Made = tuple[Callable[[Where], tuple[Link, ...]], int]


class _Sphere(NamedTuple):
    """Attitudes all over the sphere at times and temperatures of their own; `nominal`: orthonormal basis of what bias and
    matrix of a sensor make of them, for one output."""

    where: Where
    f: Float[np.ndarray, "attitudes 3"]
    nominal: Float[np.ndarray, "attitudes 4"]


def one_function_at_1_g(first: Collection[Slot], second: Collection[Slot]) -> bool:
    """Whether, at 1 g and in every attitude and mounting, some effects of the sensor can add to the readings all that the
    others can, with free nominal parameters. False where one of them is not an effect on an output."""
    if not (first and second and all(slot.columns for slot in (*first, *second))):
        return False
    if any(slot.of_several_orders for slot in (*first, *second)):
        return False  # an order of a polynomial includes every lower one, but other temperatures separate them
    return _one_function(*(tuple([(slot.make, slot.variant) for slot in own]) for own in (first, second)))


@lru_cache(maxsize=4096)
def _one_function(first: tuple[_Made, ...], second: tuple[_Made, ...]) -> bool:
    signals = [[_signals(*made) for made in own] for own in (first, second)]
    if any(own is None for both in signals for own in both):
        return False
    each = [np.column_stack([own for own in both if own is not None]) for both in signals]
    return bool(_rank(np.column_stack(each)) == max(map(_rank, each)))


def _rank(columns: Float[np.ndarray, "rows columns"]) -> int:
    # Of unit columns the products resolve squares of 1e-12.
    return int(np.sum(np.linalg.eigvalsh(columns.T @ columns) > _LEAST**2))


@lru_cache(maxsize=512)
def _signals(make: Callable[[Where], tuple[Link, ...]], variant: int) -> Float[np.ndarray, "rows coefficients"] | None:
    """What each coefficient of an effect adds to the outputs, less what the nominal parameters can make, of norm 1; None for an
    effect that acts on something else than the outputs at one attitude, or whose coefficients are nothing but nominal."""
    sphere = _sphere()
    links = make(sphere.where)
    if links[0].place != Place.READING or links[0].looks_back:
        return None
    link = links[variant]
    chain = Chain((link,))
    zero, (x, y, z) = np.zeros(len(sphere.f)), jnp.asarray(sphere.f.T)
    alpha, beta, nothing = jnp.asarray(sphere.where.alpha), jnp.asarray(sphere.where.beta), jnp.asarray(zero)
    state = State(alpha, beta, (x, y, z), (nothing, nothing, nothing))
    columns = []
    for number in np.flatnonzero(np.asarray(chain.vector) == 0.0).tolist():
        vector = np.array(chain.vector)
        vector[number] = chain.scales[number]
        reading = chain.at(vector).links[0](state, sphere.where).reading
        added = np.stack([np.broadcast_to(np.asarray(part), zero.shape) for part in reading], axis=-1)
        left = added - sphere.nominal @ (sphere.nominal.T @ added)
        if np.linalg.norm(left) > _LEAST * np.linalg.norm(added):
            columns.append(left.ravel() / np.linalg.norm(left))
    return np.column_stack(columns) if columns else None


@cache
def _sphere() -> _Sphere:
    rng = np.random.default_rng(0)
    f = rng.normal(size=(_ATTITUDES, 3))
    f /= np.linalg.norm(f, axis=1, keepdims=True)
    where = settings(
        rng.uniform(0.0, 2 * np.pi, _ATTITUDES),
        rng.choice(np.radians([-60.0, -20.0, 10.0, 45.0]), _ATTITUDES),
        run=rng.choice(["1", "2"], _ATTITUDES).tolist(),
        time_s=np.sort(rng.uniform(0.0, 7200.0, _ATTITUDES)),
        temperature_degc=rng.uniform(-20.0, 60.0, _ATTITUDES),
        approach=rng.choice([-1.0, 1.0], _ATTITUDES),
    )
    return _Sphere(where, f, np.linalg.qr(np.column_stack([np.ones(_ATTITUDES), f]))[0])

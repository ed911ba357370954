"""Effect of considered inputs on the readings, and through the fit on the parameters."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from tumblecal.chain import Chain, Link, Parameter, Where, with_parameters
from tumblecal.chain.considered import Considered
from tumblecal.effects.added_terms import angle_effect, output_effect
from tumblecal.effects.catalogue import Catalogue, entry, first_link
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.programs import compiler_options
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.toml_faults import located
from tumblecal.ground.units import quantity


def _everywhere(_, where: Where):
    return jnp.ones_like(jnp.asarray(where.alpha))


_ANGLE = {"unit": "mrad", "typical": 0.1, "physics": "a constant", "cause": "the angle is set or read with an error"}
# If contributions of readings cancel to less than this share of their sum of sizes, the result is rounding.
_ROUNDING = 1e-10
# Largest standard uncertainty of an input (g, rad, 1): larger variances exceed the range of calibration files.
_LARGEST = 1e5
# Inputs that are not catalogue effects, because the fit absorbs them if they are equal at all positions.
BUDGET_INPUTS = {
    "spindle_angle": angle_effect("spindle_angle", "alpha", _everywhere, **_ANGLE),
    "pitch_angle": angle_effect("pitch_angle", "beta", _everywhere, **_ANGLE),
    **{
        f"reading.{axis}": output_effect(
            f"reading.{axis}",
            axis,
            _everywhere,
            unit="mg",
            typical=0.1,
            physics="a constant",
            cause="the mean settles no closer than this",
        )
        for axis in AXES
    },
}


@dataclass(frozen=True)
class Input:
    """A considered input, ready for propagation.

    - `names`: the coefficients of its links, or fitted parameters that it is added to (`direct`).
    - `u`: standard uncertainty of each, base units. `stated`: as in the file.
    - `links`: the links of its signal; none for a leaf of the chain, or for an input added directly.
    """

    label: str
    stated: Considered
    names: tuple[str, ...]
    u: float
    links: tuple[Link, ...] = ()
    direct: bool = False


def inputs_of(considered: Mapping[str, Considered], fit: Fit, entries: Catalogue, file: str) -> list[Input]:
    """The considered inputs of a fit.

    **Raises:** `InputError`, one line a fault, for an input that is unknown, already fitted, or has the wrong unit.
    """
    inputs, faults = [], []
    for label, stated in considered.items():
        try:
            inputs.append(_input(label, stated, fit, entries))
        except InputError as error:
            faults += [f"{file}: considered.{label}: {fault}" for fault in error.faults]
    used = [(name, given.stated.per) for given in inputs if not given.direct for name in given.names]
    if twice := sorted({name for name, per in used if used.count((name, per)) > 1}):
        faults.append(f"{file}: considered: {', '.join(twice)} stated twice; combine them in one input")
    if faults:
        raise InputError(located(Path(file), faults))
    return inputs


def _input(label: str, stated: Considered, fit: Fit, entries: Catalogue) -> Input:
    if stated.adds_to:
        return _added(label, stated, fit)
    chain, where = fit.problem.chain, fit.problem.where
    leaves_of_chain = [leaf for leaf in chain.parameters if leaf.name == stated.what]
    if any(leaf.free for leaf in leaves_of_chain):
        raise InputError(f"{stated.what} is fitted; its uncertainty is of type A, so leave it out or fix it (--fix)")
    if leaves_of_chain:
        return _sized(label, stated, leaves_of_chain, ())
    ids = [
        id for id in (stated.what, *(f"{stated.what}.{axis}" for axis in AXES)) if id in BUDGET_INPUTS or id in entries
    ]
    if not ids:
        entry(entries, stated.what)  # its error lists similar ids
    links = tuple(first_link(BUDGET_INPUTS[id] if id in BUDGET_INPUTS else entries[id], where) for id in ids)
    leaves = [leaf for leaf in Chain(links).parameters if leaf.free]
    if common := {leaf.name for leaf in leaves} & {leaf.name for leaf in chain.parameters if leaf.free}:
        raise InputError(f"{', '.join(sorted(common))} is fitted; its uncertainty is of type A, so leave it out")
    return _sized(label, stated, leaves, links)


def _sized(label: str, stated: Considered, leaves: Sequence[Parameter], links: tuple[Link, ...]) -> Input:
    names = tuple(name for leaf in leaves for name in leaf.names)
    return Input(label, stated, names, _standard(stated, leaves[0].unit), links)


def _standard(stated: Considered, unit: str) -> float:
    """The standard uncertainty that is stated, in base units.

    **Raises:** `InputError` for a size without its unit, not above 0, or beyond any sensor.
    """
    size = quantity(stated.size, unit, bare=False)
    if not size > 0:
        raise InputError(f"size {stated.size!r} must be above 0")
    u = size * stated.standard
    if not u <= _LARGEST:
        raise InputError(
            f"size {stated.size!r} makes a standard uncertainty of {u:.3g} (unit {unit}), implausible for a calibration; check "
            "its unit and its coverage"
        )
    return u


def _added(label: str, stated: Considered, fit: Fit) -> Input:
    leaves = {leaf.name: (leaf.names, leaf.unit) for leaf in fit.problem.chain.free}
    single = {name: ((name,), unit) for name, unit in zip(fit.names, fit.units, strict=True)}
    if stated.adds_to not in leaves | single:
        raise InputError(
            f"adds_to: no fitted parameter {stated.adds_to!r}; the parameters are {', '.join([*leaves, *single])}"
        )
    names, unit = (leaves | single)[stated.adds_to]
    return Input(label, stated, names, _standard(stated, unit), direct=True)


def signals(fit: Fit, inputs: Sequence[Input]) -> tuple[Chain, dict[str, Float[np.ndarray, "positions 3"]]]:
    """The chain with all inputs as free parameters, and the derivative of the readings (positions, 3) by each, at the fit."""
    chain = with_inputs(fit, inputs)
    names = list(dict.fromkeys(name for given in inputs if not given.direct for name in given.names))
    tangents = np.eye(len(chain.names))[[chain.names.index(name) for name in names]]

    def pushed(vector, directions):
        _, push = jax.linearize(lambda v: chain.at(v)(fit.problem.where), vector)
        return jax.vmap(push)(directions)

    if not names:
        return chain, {}
    derivatives = jax.jit(pushed, compiler_options=compiler_options())(jnp.asarray(chain.vector), jnp.asarray(tangents))
    return chain, dict(zip(names, np.asarray(derivatives), strict=True))


def with_inputs(fit: Fit, inputs: Sequence[Input]) -> Chain:
    """The fitted chain with the links of all inputs, zero, their leaves free."""
    chain = fit.chain
    for given in inputs:
        if given.links and given.names[0] not in {name for leaf in chain.parameters for name in leaf.names}:
            chain = reduce(Chain.__add__, given.links, chain)
    wanted = {name for given in inputs if not given.direct for name in given.names}

    return with_parameters(chain, lambda leaf: replace(leaf, free=True) if wanted & {*leaf.names} else leaf)


def sensitivity_to_readings(fit: Fit) -> Float[np.ndarray, "free positions 3"]:
    """Change of each fitted parameter with each reading: `(J'J)^-1 J' W`, in base units."""
    count, whitening = fit.problem.readings.size, np.asarray(fit.problem.whitening)
    white = np.linalg.pinv(fit.jacobian)[:, :count] * fit.problem.scales[:, None]
    white = np.where(np.repeat(fit.retained, 3), white, 0.0)
    by_reading = (len(fit.names), *fit.problem.readings.shape)
    if whitening.ndim == 1:
        return (white * whitening).reshape(by_reading)
    if whitening.ndim == 3:
        return np.einsum("fpa,apq->fqa", white.reshape(by_reading), whitening, optimize=True)
    return (white @ whitening).reshape(by_reading)


def shifts(
    fit: Fit, given: Input, derivatives: Mapping[str, np.ndarray], by_reading: Float[np.ndarray, "free positions 3"]
) -> Float[np.ndarray, "free components"]:
    """Change of the fitted parameters by one standard uncertainty of each independent component of an input; exactly zero if
    that is rounding."""
    if given.direct:
        return given.u * np.eye(len(fit.names))[:, [fit.names.index(name) for name in given.names]]
    groups, columns = groups_of(fit, given), []
    for name in given.names:
        moved, sizes = np.zeros((2, groups.max() + 1, len(fit.names)))
        np.add.at(moved, groups, np.einsum("fpa,pa->pf", by_reading, derivatives[name]))
        np.add.at(sizes, groups, np.einsum("fpa,pa->pf", np.abs(by_reading), np.abs(derivatives[name])))
        columns.append(np.where(np.abs(moved) > _ROUNDING * sizes, moved, 0.0).T)
    return given.u * np.concatenate(columns, axis=1)


def groups_of(fit: Fit, given: Input) -> Int[np.ndarray, " positions"]:
    """Number of the independent component of an input at each position."""
    if given.stated.per is None:
        return np.zeros(fit.problem.readings.shape[0], int)
    return np.asarray(fit.problem.where.index(given.stated.per))

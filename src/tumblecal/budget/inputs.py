"""Considered inputs: the file that states them, their effect on the readings, and through the fit on the parameters."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path
from typing import Annotated, Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int
from pydantic import Field

from tumblecal.chain import Chain, Link, Where, with_parameters
from tumblecal.chain.considered import Considered
from tumblecal.chain.rig import Rig
from tumblecal.effects.added_terms import angle_effect, output_effect
from tumblecal.effects.catalogue import Catalogue, entry, first_link
from tumblecal.estimation import exact
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.programs import compiler_options
from tumblecal.estimation.stated_model import StatedModel
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.strict_toml import Strict, checked, read_toml
from tumblecal.ground.toml_faults import located
from tumblecal.ground.units import quantity
from tumblecal.simulation.position_means import simulated


def _everywhere(_, where: Where):
    return jnp.ones_like(jnp.asarray(where.alpha))


_ANGLE = {"unit": "mrad", "typical": 0.1, "physics": "a constant", "cause": "the angle is set or read with an error"}
_READING = {"unit": "mg", "typical": 0.1, "physics": "a constant", "cause": "the mean settles no closer than this"}
# If contributions of readings cancel to less than this share of their sum of sizes, the result is rounding.
_ROUNDING = 1e-10
# Largest standard uncertainty of an input (g, rad, 1): larger variances exceed the range of calibration files.
_LARGEST = 1e5
# Inputs that are not catalogue effects, because the fit absorbs them if they are equal at all positions.
BUDGET_INPUTS = {
    "spindle_angle": angle_effect("spindle_angle", "alpha", _everywhere, **_ANGLE),
    "pitch_angle": angle_effect("pitch_angle", "beta", _everywhere, **_ANGLE),
    **{id: output_effect(id, id[-1], _everywhere, **_READING) for id in (f"reading.{axis}" for axis in AXES)},
}


class BudgetTable(Strict):
    """A whole file of considered inputs, by label."""

    schema_: Annotated[Literal["tumblecal.budget/1"], Field(alias="schema")]
    considered: Annotated[dict[str, Considered], Field(min_length=1)]


def considered_inputs(path: Path | None, rig: Rig | None) -> tuple[Mapping[str, Considered], str]:
    """The inputs of a file, otherwise those of a rig, and the file that has them.

    **Raises:** `InputError` with every fault and its dotted path, and if neither has inputs.
    """
    if path is not None:
        return checked(path, read_toml(path), BudgetTable).considered, str(path)
    if rig is None or not rig.considered:
        raise InputError(
            "no inputs to consider: give a file of inputs after the data, or a rig with [considered.NAME] tables"
        )
    return rig.considered, str(rig.source)


def planned_fit(model: StatedModel) -> Fit:
    """The fit of a plan that is not measured yet, at the true values of its rig, without measurement errors.

    **Raises:** `InputError` if the noise is not stated.
    """
    assert model.rig is not None
    if model.noise_sd is None:
        raise InputError(f'{model.rig.source}: noise.sd is missing; add [noise] sd = "0.1 mg" or give --noise-sd')
    return exact.fit(model.problem(simulated(replace(model.rig, effects=()), 0, noise_sd=1e-12)))


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

    @property
    def direct(self) -> bool:
        """Whether it is added to fitted parameters."""
        return bool(self.stated.adds_to)

    def groups(self, where: Where) -> Int[np.ndarray, " positions"]:
        """Number of the independent component at each position."""
        return np.asarray(where.index(self.stated.per)) if self.stated.per else np.zeros(len(where.alpha), int)


def inputs_of(considered: Mapping[str, Considered], fit: Fit, entries: Catalogue, file: str) -> list[Input]:
    """The considered inputs of a fit.

    **Raises:** `InputError`, one line a fault, for an input that is unknown, already fitted, or has the wrong unit.
    """
    inputs, faults = list[Input](), list[str]()
    for label, stated in considered.items():
        try:
            names, unit, links = _found(stated, fit, entries)
            inputs.append(Input(label, stated, names, _standard(stated, unit), links))
        except InputError as error:
            faults += [f"{file}: considered.{label}: {fault}" for fault in error.faults]
    used = [(name, given.stated.per) for given in inputs if not given.direct for name in given.names]
    if twice := sorted({name for name, per in used if used.count((name, per)) > 1}):
        faults.append(f"{file}: considered: {', '.join(twice)} stated twice; combine them in one input")
    if faults:
        raise InputError(located(Path(file), faults))
    return inputs


def _found(stated: Considered, fit: Fit, entries: Catalogue) -> tuple[tuple[str, ...], str, tuple[Link, ...]]:
    """Names and unit of the parameters of an input, and the links of its signal."""
    chain, where = fit.problem.chain, fit.problem.where
    if stated.adds_to:
        fitted = {leaf.name: (leaf.names, leaf.unit) for leaf in chain.free}
        fitted |= {name: ((name,), unit) for name, unit in zip(fit.names, fit.units, strict=True)}
        if stated.adds_to not in fitted:
            raise InputError(f"adds_to: no fitted parameter {stated.adds_to!r}; the parameters are {', '.join(fitted)}")
        return *fitted[stated.adds_to], ()
    links, leaves = (), [leaf for leaf in chain.parameters if leaf.name == stated.what]
    if any(leaf.free for leaf in leaves):
        raise InputError(f"{stated.what} is fitted; its uncertainty is of type A, so leave it out or fix it (--fix)")
    if not leaves:
        known = entries | BUDGET_INPUTS
        ids = [id for id in (stated.what, *(f"{stated.what}.{axis}" for axis in AXES)) if id in known]
        if not ids:
            entry(entries, stated.what)  # its error lists similar ids
        links = tuple(first_link(known[id], where) for id in ids)
        leaves = [leaf for leaf in Chain(links).parameters if leaf.free]
        if common := {leaf.name for leaf in leaves} & {leaf.name for leaf in chain.free}:
            raise InputError(f"{', '.join(sorted(common))} is fitted; its uncertainty is of type A, so leave it out")
    return tuple(name for leaf in leaves for name in leaf.names), leaves[0].unit, links


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


def signals(fit: Fit, inputs: Sequence[Input]) -> tuple[Chain, dict[str, Float[np.ndarray, "positions 3"]]]:
    """The fitted chain with the links of all inputs, zero, their leaves free, and the derivative of the readings (positions, 3)
    by each, at the fit."""
    chain, wanted = fit.chain, dict.fromkeys(name for given in inputs if not given.direct for name in given.names)
    for given in inputs:
        if given.links and given.names[0] not in {name for leaf in chain.parameters for name in leaf.names}:
            chain = reduce(Chain.__add__, given.links, chain)
    chain = with_parameters(chain, lambda leaf: replace(leaf, free=True) if wanted.keys() & {*leaf.names} else leaf)
    tangents = np.eye(len(chain.names))[[chain.names.index(name) for name in wanted]]

    def pushed(vector, directions):
        _, push = jax.linearize(lambda v: chain.at(v)(fit.problem.where), vector)
        return jax.vmap(push)(directions)

    if not wanted:
        return chain, {}
    derivatives = jax.jit(pushed, compiler_options=compiler_options())(jnp.asarray(chain.vector), jnp.asarray(tangents))
    return chain, dict(zip(wanted, np.asarray(derivatives), strict=True))


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
    groups, columns = given.groups(fit.problem.where), []
    member = (groups == np.arange(groups.max() + 1)[:, None]).astype(float)
    for name in given.names:
        parts = by_reading * derivatives[name]
        moved, sizes = (np.sum(each, axis=2) @ member.T for each in (parts, np.abs(parts)))
        columns.append(np.where(np.abs(moved) > _ROUNDING * sizes, moved, 0.0))
    return given.u * np.concatenate(columns, axis=1)

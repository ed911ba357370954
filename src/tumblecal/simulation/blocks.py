"""Blocks of fits to given readings: their programs, and the devices that run them in turn."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from tumblecal.chain import Chain
from tumblecal.estimation.array_checks import require_g
from tumblecal.estimation.programs import cached_program
from tumblecal.ground.errors import InputError
from tumblecal.simulation.chain_fit import fit_chain
from tumblecal.simulation.experiment import BLOCK, Experiment
from tumblecal.simulation.uniform import UniformPlan, fits_by_harmonics


# From so many blocks on, a program that runs three times as fast repays the seconds that its compilation takes longer.
MANY_BLOCKS = 128


def fits_of_block(one: Experiment, readings: Array, *, optimised: bool) -> tuple[Array, Array, Array]:
    """Values (lanes, free), sums of squares and convergence from the readings (lanes, positions, 3) of one block."""
    if one.plan is None:
        assert one.shared is not None
        return _CHAIN_BLOCK[optimised](one.problem, one.shared, readings)
    return _harmonic_block(one.plan, optimised)(one.sd, readings)


_CHAIN_BLOCK = {optimised: cached_program(fit_chain, optimised=optimised) for optimised in (False, True)}


def _harmonic_block(plan: UniformPlan, optimised: bool) -> Callable[[float, Array], tuple[Array, Array, Array]]:
    def program(sd, readings):
        values, chi2, converged = fits_by_harmonics(plan, sd, jnp.moveaxis(readings, 0, 2))
        return values.T, chi2, converged

    return cached_program(program, plan.rows, plan.analysis, plan.pitch, optimised=optimised)


def blocks_of(readings: Any, chain: Chain, count: int) -> Iterator[np.ndarray]:
    """Readings in blocks of at most `BLOCK`.

    **Raises:** `InputError` for a wrong shape, or readings that are not in g.
    """
    parts = [readings] if hasattr(readings, "ndim") or isinstance(readings, list | tuple) else readings
    for part in parts:
        values = np.asarray(part, float)
        if values.ndim != 3 or values.shape[1:] != (count, 3):
            raise InputError(f"readings have the shape {values.shape}; {count} positions need (fits, {count}, 3)")
        require_g(chain, values[:BLOCK])
        yield from (values[begin : begin + BLOCK] for begin in range(0, len(values), BLOCK))


def in_turn(
    program: Callable[[Any], Any], blocks: Iterable[Any], devices: Sequence[Any] | None
) -> Iterator[list[np.ndarray]]:
    """The results of the blocks in order; each device has one block waiting while it computes another."""
    devices, waiting = list(jax.devices() if devices is None else devices), deque[Any]()
    for number, block in enumerate(blocks):
        waiting.append(program(jax.device_put(block, devices[number % len(devices)])))
        if len(waiting) > 2 * len(devices):
            yield [np.asarray(part) for part in waiting.popleft()]
    while waiting:
        yield [np.asarray(part) for part in waiting.popleft()]

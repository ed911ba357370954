"""Speed of many fits and of simulated trials, next to the methods that a user would write; one run, in turns.

    taskset -c 0 python benchmarks/fit_speed.py fits      time per fit of `fit_many`, of optimistix and of scipy
    python benchmarks/fit_speed.py trials                 trials per second of the device that JAX finds

The plan of the paper: 24 positions, 15 parameters of 1e-3, stated noise, float64. `fits`: least and median processor time
per fit, ratio to the general path, and largest difference of the estimates. The alternatives fit a part of the readings.
From 131,072 fits on, `fit_many` uses optimised programs.
"""

import os
import time
from dataclasses import replace


os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import least_squares

import tumblecal
from command_line import asked, print_head, print_row
from scipy_fit import predict
from tumblecal import Problem
from tumblecal.chain import nominal_chain, settings
from tumblecal.estimation import exact
from tumblecal.simulation.experiment import BLOCK, experiment
from tumblecal.simulation.sums import added, sums_of


SD, SIZE, ROUNDS = 1.5e-4, 1e-3, 5
ALPHA, BETA = np.tile(np.arange(8) * np.pi / 4, 3), np.repeat(np.radians([0.0, 45.0, 90.0]), 8)
SETTING = np.repeat([0, 1, 2], 8)


def by_scipy(readings: np.ndarray) -> np.ndarray:
    """One fit after the other, with the derivatives of scipy and the chain as a user of scipy writes it."""

    def residuals(p: np.ndarray, measured: np.ndarray) -> np.ndarray:
        return (predict(p, ALPHA, BETA, SETTING) - measured).ravel() / SD

    return np.stack([least_squares(residuals, np.zeros(15), args=(measured,)).x for measured in readings])


def paper():
    """The nominal chain and the settings of the paper's plan."""
    where = settings(ALPHA, BETA)
    return nominal_chain(where), where


def fits(count: int) -> None:
    """A row for each method."""
    (chain, where), rng = paper(), np.random.default_rng(1)
    truth = SIZE * rng.normal(size=(count, 15))
    readings, model = SD * rng.normal(size=(count, 24, 3)), jax.jit(jax.vmap(lambda v: chain.at(v)(where)))
    for begin in range(0, count, 4096):
        readings[begin : begin + 4096] += model(truth[begin : begin + 4096])
    problem = Problem.from_arrays(chain, where, readings[0], noise_sd=SD)
    methods = {
        "`fit_many`, general path": (lambda r: tumblecal.fit_many(problem, r, path="chain").values, count),
        "`fit_many`, harmonic path": (lambda r: tumblecal.fit_many(problem, r, path="harmonic").values, count),
        "`jax.vmap` of optimistix": (
            jax.jit(jax.vmap(lambda r: exact.solve(replace(problem, readings=r), chain.vector)[0])),
            4096,
        ),
        "`scipy.optimize.least_squares` in a loop": (by_scipy, 20),
    }
    spent, found = {name: [] for name in methods}, {}
    for turn in range(ROUNDS + 1):
        for name, (fit, some) in methods.items():
            begin = time.process_time()
            found[name] = np.asarray(fit(readings[:some]))
            # The first turn compiles.
            spent[name] += [1e6 * (time.process_time() - begin) / some] if turn else []
    general = next(iter(methods))
    print_head("method", "least / µs", "median / µs", "ratio", "largest difference")
    for name, times in spent.items():
        difference = np.max(np.abs(found[name] - found[general][: len(found[name])]))
        ratio = np.median(np.array(times) / spent[general])
        print_row(name, f"{min(times):.2f}", f"{np.median(times):.2f}", f"{ratio:.2f}", f"{difference:.1e}")


def trials() -> None:
    """Trials per second, each of a new instrument, drawn, fitted and summarised; wide batches if the device is not a CPU."""
    spread = dict.fromkeys(("dK", "bias", "dtheta", "gamma", "dbeta"), SIZE)
    here = jax.devices()[0]
    print(f"{here.device_kind} ({here.platform}), jax {jax.__version__}\n")
    print_head("path", "million trials / s", "failed", "mean chi2 (57)", "mean NEES (15)")
    wide = 1 if here.platform == "cpu" else 256
    for title, options in (("harmonic", {}), ("general", {"path": "chain"})):
        setup = experiment(*paper(), sd=SD, spread=spread, **options)
        width = wide if title == "harmonic" else max(1, wide // 8)
        rounds = 16 if wide > 1 else 64 if title == "harmonic" else 8

        @jax.jit
        def run(first, setup=setup, width=width, rounds=rounds):
            def of(block):
                return sums_of(setup.trials(0, block), setup)

            def step(total, start):
                part = jax.tree.map(lambda p: jnp.sum(p, axis=0), jax.vmap(of)(start + jnp.arange(width)))
                return added(total, part), None

            nothing = jax.tree.map(lambda p: jnp.zeros(p.shape, p.dtype), jax.eval_shape(of, first))
            return jax.lax.scan(step, nothing, first + width * jnp.arange(rounds))[0]

        found, times = jax.block_until_ready(run(0)), []
        for _ in range(3):
            begin = time.perf_counter()
            jax.block_until_ready(run(0))
            times.append(time.perf_counter() - begin)
        rate, good = rounds * width * BLOCK / min(times) / 1e6, float(found.trials - found.failed)
        means = (f"{float(whole) / good:.2f}" for whole in (found.chi2, found.nees))
        print_row(title, f"{rate:.3g}", int(found.failed), *means)


def main() -> None:
    """One of the parts."""
    given = asked(__doc__, part=("fits", "trials"), fits=131_072)
    tumblecal.enable_float64()
    fits(given.fits) if given.part == "fits" else trials()


if __name__ == "__main__":
    main()

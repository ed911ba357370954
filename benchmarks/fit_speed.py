"""Speed of many fits and of simulated trials, next to the methods that a user would write; one run, in turns.

    taskset -c 0 python benchmarks/fit_speed.py fits      time per fit of `fit_many` and of five alternatives
    python benchmarks/fit_speed.py trials                 trials per second of the device that JAX finds
    python benchmarks/fit_speed.py processes              two processes on two cores against one

The plan of the paper: 24 positions, 15 parameters of 1e-3, stated noise, float64. `fits`: least and median processor time
per fit, ratio to the general path, and largest difference of the estimates. The alternatives fit a part of the readings.
From 131,072 fits on, `fit_many` uses optimised programs. pyceres is used if it is installed.
"""

import argparse
import os
import subprocess
import sys
import time
from dataclasses import replace


os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import least_squares

import tumblecal
from tumblecal import Problem
from tumblecal.chain import nominal_chain, settings
from tumblecal.estimation import exact
from tumblecal.simulation.experiment import BLOCK, experiment
from tumblecal.simulation.sums import added, chunk_sums, sums_of


SD, SIZE, STEPS = 1.5e-4, 1e-3, 4
ALPHA, BETA = np.tile(np.arange(8) * np.pi / 4, 3), np.repeat(np.radians([0.0, 45.0, 90.0]), 8)
SETTING = np.repeat([0, 1, 2], 8)


def predicted(v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Readings (fits, 24, 3) and Jacobian (fits, 72, 15) of the nominal chain, written by hand."""
    fits = len(v)
    scale, bias, (tx, ty, tz), (g21, g31, g32) = v[:, 0:3], v[:, 3:6], v[:, 6:9].T, v[:, 9:12].T
    angle = BETA + v[:, 12 + SETTING]
    f = np.stack([-np.sin(angle), np.cos(angle) * np.sin(ALPHA), np.cos(angle) * np.cos(ALPHA)], axis=2)
    slope = np.stack([-np.cos(angle), -np.sin(angle) * np.sin(ALPHA), -np.sin(angle) * np.cos(ALPHA)], axis=2)
    (sx, cx), (sy, cy), (sz, cz) = ((np.sin(a), np.cos(a)) for a in (tx, ty, tz))
    one, nothing = np.ones(fits), np.zeros(fits)

    def matrix(*rows):
        return np.stack([np.stack(row, axis=1) for row in rows], axis=1)

    rx = matrix((one, nothing, nothing), (nothing, cx, sx), (nothing, -sx, cx))
    ry = matrix((cy, nothing, -sy), (nothing, one, nothing), (sy, nothing, cy))
    rz = matrix((cz, sz, nothing), (-sz, cz, nothing), (nothing, nothing, one))
    drx = matrix((nothing, nothing, nothing), (nothing, -sx, cx), (nothing, -cx, -sx))
    dry = matrix((-sy, nothing, -cy), (nothing, nothing, nothing), (cy, nothing, -sy))
    drz = matrix((-sz, cz, nothing), (-cz, -sz, nothing), (nothing, nothing, nothing))
    triad = matrix((one, nothing, nothing), (g21, one, nothing), (g31, g32, one))
    turn, *turns = [rx @ ry @ rz, drx @ ry @ rz, rx @ dry @ rz, rx @ ry @ drz]
    seen = f @ turn.mT
    u = seen @ triad.mT
    jacobian, gain = np.zeros((fits, 24, 3, 15)), (1 + scale)[:, None]
    for axis in range(3):
        jacobian[:, :, axis, axis], jacobian[:, :, axis, 3 + axis] = u[:, :, axis], 1.0
        jacobian[:, :, :, 6 + axis] = f @ (triad @ turns[axis]).mT * gain
    for k, (row, column) in enumerate(((1, 0), (2, 0), (2, 1))):
        jacobian[:, :, row, 9 + k] = seen[:, :, column] * gain[:, :, row]
    moved = slope @ (triad @ turn).mT * gain
    jacobian[..., 12:] = moved[..., None] * (SETTING[:, None] == np.arange(3))[:, None]
    return u * gain + bias[:, None], jacobian.reshape(fits, 72, 15)


def by_numpy(readings: np.ndarray) -> np.ndarray:
    """Gauss-Newton, all fits at once."""
    v = np.zeros((len(readings), 15))
    for _ in range(STEPS):
        model, jacobian = predicted(v)
        residual = (readings - model).reshape(len(v), 72, 1)
        v = v + np.linalg.solve(jacobian.mT @ jacobian * SIZE**2, jacobian.mT @ residual * SIZE**2)[:, :, 0]
    return v


def by_scipy(readings: np.ndarray) -> np.ndarray:
    """One fit after the other, with the derivatives of scipy and the chain as a user of scipy writes it."""
    sa, ca = np.sin(ALPHA), np.cos(ALPHA)

    def residuals(p: np.ndarray, measured: np.ndarray) -> np.ndarray:
        scale, bias, tilts, (g21, g31, g32), pitch = p[:3], p[3:6], p[6:9], p[9:12], p[12:]
        b = BETA + pitch[SETTING]
        f = np.stack([-np.sin(b), np.cos(b) * sa, np.cos(b) * ca])
        (cx, sx), (cy, sy), (cz, sz) = ((np.cos(tilt), np.sin(tilt)) for tilt in tilts)
        rx = np.array([[1, 0, 0], [0, cx, sx], [0, -sx, cx]])
        ry = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]])
        rz = np.array([[cz, sz, 0], [-sz, cz, 0], [0, 0, 1]])
        triad = np.array([[1, 0, 0], [g21, 1, 0], [g31, g32, 1]])
        model = ((1 + scale)[:, None] * (triad @ (rx @ ry @ rz) @ f) + bias[:, None]).T
        return (model - measured).ravel() / SD

    return np.stack([least_squares(residuals, np.zeros(15), args=(measured,)).x for measured in readings])


def by_pyceres(readings: np.ndarray) -> np.ndarray:
    """One fit after the other, with the Jacobian by hand."""
    import pyceres

    class Cost(pyceres.CostFunction):
        def __init__(self, measured):
            super().__init__()
            self.measured = measured
            self.set_num_residuals(72)
            self.set_parameter_block_sizes([15])

        def Evaluate(self, parameters, residuals, jacobians):
            model, jacobian = predicted(parameters[0][None])
            residuals[:] = (model[0] - self.measured).ravel() / SD
            if jacobians is not None:
                jacobians[0][:] = (jacobian[0] / SD).ravel()
            return True

    found = []
    for measured in readings:
        vector, problem, options = np.zeros(15), pyceres.Problem(), pyceres.SolverOptions()
        problem.add_residual_block(Cost(measured), None, [vector])
        options.function_tolerance = options.parameter_tolerance = options.gradient_tolerance = 1e-14
        pyceres.solve(options, problem, pyceres.SolverSummary())
        found.append(vector)
    return np.stack(found)


def paper():
    """The nominal chain and the settings of the paper's plan."""
    where = settings(ALPHA, BETA)
    return nominal_chain(where), where


def fits(asked: argparse.Namespace) -> None:
    """A row for each method."""
    (chain, where), rng = paper(), np.random.default_rng(1)
    truth = SIZE * rng.normal(size=(asked.fits, 15))
    readings = SD * rng.normal(size=(asked.fits, 24, 3))
    for begin in range(0, asked.fits, 4096):
        readings[begin : begin + 4096] += predicted(truth[begin : begin + 4096])[0]
    assert np.allclose(chain.at(truth[0])(where), predicted(truth[:1])[0][0], atol=1e-14)
    problem = Problem.from_arrays(chain, where, readings[0], noise_sd=SD)
    methods = {
        "`fit_many`, general path": (lambda r: tumblecal.fit_many(problem, r, path="chain").values, asked.fits),
        "`fit_many`, harmonic path": (lambda r: tumblecal.fit_many(problem, r, path="harmonic").values, asked.fits),
        "`jax.vmap` of optimistix": (
            jax.jit(jax.vmap(lambda r: exact.solve(replace(problem, readings=r), chain.vector)[0])),
            asked.part_fits,
        ),
        "numpy and LAPACK, Jacobian by hand": (by_numpy, asked.part_fits),
        "`scipy.optimize.least_squares` in a loop": (by_scipy, 20),
        "pyceres": (by_pyceres, 200),
    }
    try:
        import pyceres  # noqa: F401
    except ImportError:
        del methods["pyceres"]
    spent, found = {name: [] for name in methods}, {}
    for turn in range(asked.rounds + 1):
        for name, (fit, count) in methods.items():
            begin = time.process_time()
            found[name] = np.asarray(fit(readings[:count]))
            # The first turn compiles.
            spent[name] += [1e6 * (time.process_time() - begin) / count] if turn else []
    general = next(iter(methods))
    print("| method | least / µs | median / µs | ratio | largest difference |\n|---|---|---|---|---|")
    for name, times in spent.items():
        difference = np.max(np.abs(found[name] - found[general][: len(found[name])]))
        ratio = np.median(np.array(times) / spent[general])
        print(f"| {name} | {min(times):.2f} | {np.median(times):.2f} | {ratio:.2f} | {difference:.1e} |")


def paper_experiment(**options):
    """Trials with a new instrument each."""
    spread = dict.fromkeys(("dK", "bias", "dtheta", "gamma", "dbeta"), SIZE)
    return experiment(*paper(), sd=SD, spread=spread, **options)


def trials(asked: argparse.Namespace) -> None:
    """Trials per second, drawn, fitted and summarised; wide batches if the device is not a CPU."""
    here = jax.devices()[0]
    print(f"{here.device_kind} ({here.platform}), jax {jax.__version__}\n")
    print("| path | million trials / s | failed | mean chi2 (57) | mean NEES (15) |\n|---|---|---|---|---|")
    wide = 1 if here.platform == "cpu" else 256
    for title, options in (("harmonic", {}), ("general", {"path": "chain"})):
        setup = paper_experiment(**options)
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
        print(f"| {title} | {rate:.3g} | {int(found.failed)} | {float(found.chi2) / good:.2f} "
              f"| {float(found.nees) / good:.2f} |", flush=True)  # fmt: skip


def child(core: int, blocks: int) -> None:
    """Trials on one core, from a line of stdin on; wall and processor time on stdout."""
    os.sched_setaffinity(0, {core})
    sums = chunk_sums(paper_experiment(), 0)
    jax.block_until_ready(sums(0, BLOCK))
    print("ready", flush=True)
    sys.stdin.readline()
    wall, busy = time.perf_counter(), time.process_time()
    jax.block_until_ready(sums(0, blocks * BLOCK))
    print(time.perf_counter() - wall, time.process_time() - busy, flush=True)


def processes(asked: argparse.Namespace) -> None:
    """The ratio by the clock is correct on an idle machine only; that by processor time is what they cost each other."""
    blocks, cores = 256, sorted(os.sched_getaffinity(0))[:2]

    def timed(count: int) -> np.ndarray:
        commands = ([sys.executable, __file__, "child", "--core", str(core), "--blocks", str(blocks)] for core in cores)
        pipe = subprocess.PIPE
        children = [subprocess.Popen(own, stdin=pipe, stdout=pipe, text=True) for own in [*commands][:count]]
        assert all(own.stdout.readline().strip() == "ready" for own in children if own.stdout)
        return np.max([[float(word) for word in own.communicate("go\n")[0].split()] for own in children], axis=0)

    alone, both = (np.min([timed(count) for _ in range(4)], axis=0) for count in (1, len(cores)))
    print(f"one process {blocks * BLOCK / alone[0]:.3g} trials/s, {len(cores)} processes by the clock "
          f"{len(cores) * alone[0] / both[0]:.2f} times, by processor time {len(cores) * alone[1] / both[1]:.2f}")  # fmt: skip


def main() -> None:
    """One of the parts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", choices=("fits", "trials", "processes", "child"))
    parser.add_argument("--fits", type=int, default=131_072)
    parser.add_argument("--part-fits", dest="part_fits", type=int, default=4096, help="fits of the alternatives")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--core", type=int, default=0, help=argparse.SUPPRESS)
    parser.add_argument("--blocks", type=int, default=256, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    tumblecal.enable_float64()
    if asked.part == "child":
        child(asked.core, asked.blocks)
    else:
        {"fits": fits, "trials": trials, "processes": processes}[asked.part](asked)


if __name__ == "__main__":
    main()

"""Time per fit of `fit_many` and of the alternatives that a user would write, in one run on one core.

    taskset -c 0 python benchmarks/many_fits.py

24 positions, 15 parameters, stated noise, parameters of 1e-3. The methods take turns; printed are the least and the median
processor time per fit, its ratio to the general path's, and the largest difference between the estimates. The alternatives fit
a part of the readings. From 131,072 fits on, `fit_many` uses optimised programs.

- `harmonic`, `chain`: the two paths of `tumblecal.fit_many`.
- `vmap`: `jax.vmap` of `exact.solve` (optimistix).
- `numpy`: Gauss-Newton by hand for all fits at once, with an analytic Jacobian and LAPACK's batched solver.
- `pyceres`: one problem after the other with the same Jacobian, if it is installed.
"""

import argparse
import os
import time
from dataclasses import replace


os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax
import numpy as np

import tumblecal
from tumblecal import Problem
from tumblecal.chain import nominal_chain, settings
from tumblecal.estimation import exact


SD = 1e-4  # g
STEPS = 4
ALPHA, BETA = np.tile(np.arange(8) * np.pi / 4, 3), np.repeat([0.0, 0.5, 1.0], 8)
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
    turns = [rx @ ry @ rz, drx @ ry @ rz, rx @ dry @ rz, rx @ ry @ drz]
    seen = f @ turns[0].mT
    u = seen @ triad.mT
    jacobian, gain = np.zeros((fits, 24, 3, 15)), (1 + scale)[:, None]
    for axis in range(3):
        jacobian[:, :, axis, axis], jacobian[:, :, axis, 3 + axis] = u[:, :, axis], 1.0
    for k, turn in enumerate(turns[1:]):
        jacobian[:, :, :, 6 + k] = f @ (triad @ turn).mT * gain
    for k, (row, column) in enumerate(((1, 0), (2, 0), (2, 1))):
        jacobian[:, :, row, 9 + k] = seen[:, :, column] * gain[:, :, row]
    moved = slope @ (triad @ turns[0]).mT * gain
    jacobian[..., 12:] = moved[..., None] * (SETTING[:, None] == np.arange(3))[:, None]
    return u * gain + bias[:, None], jacobian.reshape(fits, 72, 15)


def by_numpy(readings: np.ndarray) -> np.ndarray:
    """Gauss-Newton, all fits at once."""
    v, scales = np.zeros((len(readings), 15)), 1e-3
    for _ in range(STEPS):
        model, jacobian = predicted(v)
        residual = (readings - model).reshape(len(v), 72, 1)
        v = v + np.linalg.solve(jacobian.mT @ jacobian * scales**2, jacobian.mT @ residual * scales**2)[:, :, 0]
    return v


def by_pyceres(readings: np.ndarray) -> np.ndarray:
    """One fit after the other."""
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


def timed(fit, readings: np.ndarray) -> tuple[float, np.ndarray]:
    """Microseconds a fit, and the estimates."""
    started = time.process_time()
    values = np.asarray(fit(readings))
    return 1e6 * (time.process_time() - started) / len(readings), values


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fits", type=int, default=131_072)
    parser.add_argument("--part", type=int, default=4096, help="fits of the alternatives")
    parser.add_argument("--rounds", type=int, default=5)
    asked = parser.parse_args()
    tumblecal.enable_float64()
    where = settings(ALPHA, BETA)
    chain = nominal_chain(where)
    rng = np.random.default_rng(1)
    truth = 1e-3 * rng.normal(size=(asked.fits, 15))
    readings = SD * rng.normal(size=(asked.fits, 24, 3))
    for begin in range(0, asked.fits, 4096):
        readings[begin : begin + 4096] += predicted(truth[begin : begin + 4096])[0]
    assert np.allclose(chain.at(truth[0])(where), predicted(truth[:1])[0][0], atol=1e-14)
    problem = Problem.from_arrays(chain, where, readings[0], noise_sd=SD)
    each = jax.jit(jax.vmap(lambda r: exact.solve(replace(problem, readings=r), chain.vector)[0]))
    methods = {
        "fit_many, general path": (lambda r: tumblecal.fit_many(problem, r, path="chain").values, asked.fits),
        "fit_many, harmonic path": (lambda r: tumblecal.fit_many(problem, r, path="harmonic").values, asked.fits),
        "jax.vmap of optimistix": (each, asked.part),
        f"numpy and LAPACK, {STEPS} steps": (by_numpy, asked.part),
        "pyceres": (by_pyceres, 200),
    }
    try:
        import pyceres  # noqa: F401
    except ImportError:
        print("pyceres is not installed: skipped")
        del methods["pyceres"]
    times: dict[str, list[float]] = {name: [] for name in methods}
    found: dict[str, np.ndarray] = {}
    for turn in range(asked.rounds + 1):
        for name, (fit, count) in methods.items():
            spent, found[name] = timed(fit, readings[:count])
            # The first turn compiles.
            times[name] += [spent] if turn else []
    reference, values = times["fit_many, general path"], found["fit_many, general path"]
    for name, spent in times.items():
        apart = np.max(np.abs(found[name] - values[: len(found[name])]))
        ratio = np.median(np.array(spent) / reference)
        print(f"{name:26s} {min(spent):8.2f} {np.median(spent):8.2f} us {ratio:7.2f}   difference {apart:.1e}")


if __name__ == "__main__":
    main()

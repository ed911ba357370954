"""Fits per second of `fit_many` next to what a user would write instead, in one run on one core.

    python benchmarks/many_fits.py --fits 8192

24 positions, 15 parameters, stated noise. Each method fits the same readings; the estimates must agree.

- `harmonic`, `chain`: the two paths of `tumblecal.fit_many`.
- `vmap`: `jax.vmap` of `exact.solve` (optimistix).
- `numpy`: Gauss-Newton by hand for all fits at once, with an analytic Jacobian and LAPACK's batched solver.
- `pyceres`: one problem after the other with numeric derivatives of its residuals, if it is installed; a part of the fits.
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


def timed(name: str, fit, readings: np.ndarray) -> tuple[str, float, np.ndarray]:
    """Microseconds a fit, the first call (compilation) not counted."""
    fit(readings)
    started = time.process_time()
    values = np.asarray(fit(readings))
    return name, 1e6 * (time.process_time() - started) / len(readings), values


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fits", type=int, default=8192)
    asked = parser.parse_args()
    tumblecal.enable_float64()
    where = settings(ALPHA, BETA)
    chain = nominal_chain(where)
    rng = np.random.default_rng(1)
    truth = 1e-3 * rng.normal(size=(asked.fits, 15))
    readings = predicted(truth)[0] + SD * rng.normal(size=(asked.fits, 24, 3))
    assert np.allclose(chain.at(truth[0])(where), predicted(truth[:1])[0][0], atol=1e-14)
    problem = Problem.from_arrays(chain, where, readings[0], noise_sd=SD)
    each = jax.jit(jax.vmap(lambda r: exact.solve(replace(problem, readings=r), chain.vector)[0]))
    rows = [
        timed("fit_many, harmonic", lambda r: tumblecal.fit_many(problem, r, path="harmonic").values, readings),
        timed("fit_many, chain", lambda r: tumblecal.fit_many(problem, r, path="chain").values, readings),
        timed("jax.vmap of optimistix", each, readings),
        timed(f"numpy and LAPACK, {STEPS} steps", by_numpy, readings),
    ]
    try:
        rows.append(timed("pyceres, analytic Jacobian", by_pyceres, readings[:200]))
    except ImportError:
        print("pyceres is not installed")
    for name, microseconds, values in rows:
        apart = np.max(np.abs(values - rows[0][2][: len(values)]))
        print(f"{name:30s} {microseconds:9.2f} us a fit   largest difference {apart:.1e}")


if __name__ == "__main__":
    main()

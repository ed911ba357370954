"""Harmonic analysis and the paper's linear equations `Z = H X + V` (its section 2). Plain numpy."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from tumblecal.estimation.fit import Code, Fit, History
from tumblecal.estimation.identifiability import Identifiability, identifiability
from tumblecal.estimation.position_problem import default_chain, where_of
from tumblecal.estimation.problem import Problem
from tumblecal.ground.errors import InputError
from tumblecal.ground.frames import gravity_in_head


@dataclass(frozen=True)
class Harmonics:
    """Harmonics of the readings, in the order setting, axis, (mean, sine, cosine), and the linear equations for them.

    `z`: harmonics less those of an ideal instrument, g. `design`: H. `covariance`: of z for the stated noise, or noise of 1 g,
    from the regression. `analysis`: readings to harmonics; `synthesis`: harmonics to readings. `run`: the run of each row of z.
    """

    z: Float[np.ndarray, " harmonics"]
    design: Float[np.ndarray, "harmonics free"]
    covariance: Float[np.ndarray, "harmonics harmonics"]
    analysis: Float[np.ndarray, "harmonics readings"]
    synthesis: Float[np.ndarray, "readings harmonics"]
    ideal: Float[np.ndarray, " harmonics"]
    names: tuple[str, ...]
    units: tuple[str, ...]
    run: tuple[str, ...]


def analyse(problem: Problem) -> Harmonics:
    """Harmonics of a position set by least squares over each pitch setting.

    Equally spaced spindle angles give the classical sums `mean(A)`, `(2/n) sum A sin(alpha)`, `(2/n) sum A cos(alpha)`;
    other angles, repeats and sd columns give the general regression. Readings at a recorded pitch angle are first
    corrected to the nominal angle of the pitch setting, as for an ideal instrument.

    **Arguments:**

    - `problem`: positions of one mounting; parameters that its chain lacks are zero in the equations.

    **Raises:** `InputError` when a pitch setting has fewer than three spindle angles, or there are several mounts.
    """
    data = problem.measured_data
    if len(set(data.mount or ("1",))) > 1:
        raise InputError(f"{data.source}: the linear equations apply to one mounting; these data have several")
    if problem.chain.of_positions:
        raise InputError(
            f"{data.source}: harmonic analysis needs known angles; here each position has an unknown attitude"
        )
    chain, where = default_chain(data), where_of(data)
    by = next((leaf.by for leaf in chain.free if leaf.name == "dbeta"), None) or "pitch"
    group = np.asarray(where.index(by))
    settings = np.arange(int(group.max()) + 1)
    betas = np.array([where.pitch_angle[group == k][0] for k in settings])
    regressors = np.stack([np.ones_like(data.alpha), np.sin(data.alpha), np.cos(data.alpha)], axis=1)
    for k in settings:
        if np.linalg.matrix_rank(regressors[group == k], tol=1e-6) < 3:
            raise InputError(
                f"{data.source}: harmonic analysis needs three spindle angles at each pitch setting; "
                f"{np.degrees(betas[k]):g} deg has {len(set(np.round(np.degrees(data.alpha[group == k]) % 360, 6)))}"
            )
    members = (group[:, None] == settings).astype(float)
    synthesis = np.einsum("pk,ab,ph->pakbh", members, np.eye(3), regressors).reshape(data.readings.size, -1)
    weighted = synthesis.T * (1.0 / problem.sd.ravel() ** 2 if problem.known else 1.0)
    covariance = np.linalg.inv(weighted @ synthesis)
    analysis = covariance @ weighted
    design, ideal = equations(betas)
    estimated = set(problem.chain.names)
    columns = [column for column, name in enumerate(chain.names) if name in estimated]
    run_of = data.labels("run")
    return Harmonics(
        z=analysis @ _at_settings(problem).ravel() - ideal,
        design=design[:, columns],
        covariance=covariance,
        analysis=analysis,
        synthesis=synthesis,
        ideal=ideal,
        names=tuple(chain.names[column] for column in columns),
        units=tuple(chain.units[column] for column in columns),
        run=tuple(run_of[int(np.argmax(group == k))] for k in settings for _ in range(9)),
    )


def _at_settings(problem: Problem) -> Float[np.ndarray, "positions 3"]:
    """The readings corrected to the nominal angles of the pitch settings, as for an ideal instrument, g."""
    data, nominal_pitch = problem.measured_data, where_of(problem.measured_data).pitch_angle
    readings = np.asarray(problem.readings)
    if np.array_equal(nominal_pitch, data.beta):
        return readings
    return readings + gravity_in_head(data.alpha, nominal_pitch) - gravity_in_head(data.alpha, data.beta)


def equations(
    betas: Float[np.ndarray, " settings"],
) -> tuple[Float[np.ndarray, "harmonics free"], Float[np.ndarray, " harmonics"]]:
    """The first-order equations for pitch settings `betas` (rad).

    Unknowns: dK x y z, bias x y z, dtheta x y z, gamma 21 31 32, dbeta of every setting (paper, equations 2, 3 and the z row).

    **Returns:** H, and the harmonics of an ideal instrument.
    """
    sine, cosine = np.sin(betas), np.cos(betas)
    count = len(betas)
    design = np.zeros((count, 3, 3, 12 + count))
    dK, bias, theta, gamma = (np.arange(3) + 3 * block for block in range(4))
    g21, g31, g32 = gamma
    dbeta = 12 + np.arange(count), np.arange(count)
    mean, sin, cos = range(3)
    design[:, range(3), mean, bias] = 1.0
    design[:, 0, mean, dK[0]] = -sine
    design[dbeta[1], 0, mean, dbeta[0]] = -cosine
    design[:, 0, sin, theta[2]] = cosine
    design[:, 0, cos, theta[1]] = -cosine
    design[:, 1, mean, theta[2]] = sine
    design[:, 1, mean, g21] = -sine
    design[:, 1, sin, dK[1]] = cosine
    design[dbeta[1], 1, sin, dbeta[0]] = -sine
    design[:, 1, cos, theta[0]] = cosine
    design[:, 2, mean, theta[1]] = -sine
    design[:, 2, mean, g31] = -sine
    design[:, 2, sin, g32] = cosine
    design[:, 2, sin, theta[0]] = -cosine
    design[:, 2, cos, dK[2]] = cosine
    design[dbeta[1], 2, cos, dbeta[0]] = -sine
    ideal = np.zeros((count, 3, 3))
    ideal[:, 0, mean], ideal[:, 1, sin], ideal[:, 2, cos] = -sine, cosine, cosine
    return design.reshape(9 * count, -1), ideal.ravel()


def fit(problem: Problem, *, weighted: bool = True) -> Fit:
    """Harmonic least squares of one data set.

    **Arguments:**

    - `problem`: positions of one mounting.
    - `weighted`: weight the harmonics by their variances (means sigma^2/n, others 2 sigma^2/n); otherwise equally.

    **Raises:** `InputError` for data to which the equations do not apply, or with undetermined unknowns.
    """
    harmonics = analyse(problem)
    inverse_root = np.linalg.inv(np.linalg.cholesky(harmonics.covariance))
    scales = np.full(len(harmonics.names), 1e-3)
    determined = identifiability(inverse_root @ harmonics.design * scales, harmonics.names, scales)
    determined.require_full_rank(problem.measured_data.source)
    estimator = least_squares_estimator(harmonics, weighted=weighted)
    covariance = estimator @ harmonics.covariance @ estimator.T
    return fit_of("harmonic", problem, harmonics, estimator @ harmonics.z, covariance, identifiability=determined)


def least_squares_estimator(harmonics: Harmonics, *, weighted: bool = True) -> Float[np.ndarray, "free harmonics"]:
    """The least-squares estimator: parameters from harmonics z."""
    whitening = np.eye(len(harmonics.z))
    if weighted:
        whitening = np.linalg.inv(np.linalg.cholesky(harmonics.covariance))
    return np.linalg.pinv(whitening @ harmonics.design) @ whitening


def fit_of(
    method: str,
    problem: Problem,
    harmonics: Harmonics,
    values: np.ndarray,
    covariance: np.ndarray,
    *,
    identifiability: Identifiability | None = None,
    history: History | None = None,
) -> Fit:
    """A fit of the linear model; `covariance` is for the stated noise, or noise of 1 g."""
    predicted = harmonics.synthesis @ (harmonics.ideal + harmonics.design @ values)
    residuals = _at_settings(problem) - predicted.reshape(problem.readings.shape)
    dof = residuals.size - len(values)
    rows = problem.rows(residuals)
    if not problem.known:
        covariance = covariance * (np.sum(residuals**2) / dof if dof > 0 else np.nan)
    return Fit(
        method=method,
        problem=problem,
        names=harmonics.names,
        units=harmonics.units,
        values=values,
        covariance=covariance,
        residuals=residuals,
        chi2=float(rows @ rows),
        dof=dof,
        code=Code.LINEAR,
        identifiability=identifiability,
        history=history,
    )

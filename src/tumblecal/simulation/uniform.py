"""Plans whose harmonics are sufficient: the same number of equally spaced spindle angles at every pitch setting."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from tumblecal.estimation import closed_form
from tumblecal.estimation.problem import Problem
from tumblecal.ground.errors import InputError
from tumblecal.simulation.harmonic_fit import fit_harmonics


@dataclass(frozen=True)
class UniformPlan:
    """Harmonic analysis of a uniform plan.

    `rows`: the positions of each pitch setting; `analysis`: readings at a setting to (mean, sine, cosine);
    `pitch`: commanded pitch of each setting, rad.
    """

    rows: Int[np.ndarray, "settings angles"]
    analysis: Float[np.ndarray, "settings 3 angles"]
    pitch: Float[np.ndarray, " settings"]

    @property
    def angles(self) -> int:
        """Spindle angles at each setting."""
        return self.rows.shape[1]

    @property
    def weights(self) -> Float[np.ndarray, "3"]:
        """Weights of the squares of mean, sine and cosine in a sum of squares over the positions."""
        return self.angles * np.array([1.0, 0.5, 0.5])

    def harmonics(self, readings: Float[Array, "positions axes lanes"]) -> Float[Array, "settings 3 axes lanes"]:
        """Mean, sine and cosine of every setting and axis."""
        _, axes, lanes = readings.shape
        settings = self.rows.shape[0]
        # Plans are mostly listed setting by setting: then no rows need to be moved.
        in_order = np.array_equal(self.rows.ravel(), np.arange(self.rows.size))
        ordered = readings if in_order else readings[self.rows.ravel()]
        flat = ordered.reshape(settings, self.angles, axes * lanes)
        return jnp.einsum("khn,knl->khl", self.analysis, flat).reshape(settings, 3, axes, lanes)

    def synthesis(self, harmonics: Float[Array, "settings 3 axes lanes"]) -> Float[Array, "positions axes lanes"]:
        """Readings that have these harmonics and no others."""
        _, _, axes, lanes = harmonics.shape
        basis = self.analysis.transpose(0, 2, 1) * self.weights
        flat = jnp.einsum("knh,khal->knal", basis, harmonics).reshape(self.rows.size, axes, lanes)
        return flat[np.argsort(self.rows.ravel())]


def fits_by_harmonics(
    plan: UniformPlan, sd: float | Array, readings: Float[Array, "positions 3 lanes"]
) -> tuple[Array, Array, Array]:
    """Values (free, lanes), sums of squares and convergence of the nominal chain, from readings of this sd, g; what the
    harmonics do not describe completes the sums of squares."""
    harmonics = plan.harmonics(readings)
    fits = fit_harmonics(harmonics, plan.pitch, plan.angles)
    rest = jnp.sum((readings - plan.synthesis(harmonics)) ** 2, axis=(0, 1))
    return fits.values, (fits.sum_of_squares + rest) / sd**2, fits.converged


def uniform_plan(
    alpha: Float[np.ndarray, " positions"], beta: Float[np.ndarray, " positions"], group: Int[np.ndarray, " positions"]
) -> UniformPlan | str:
    """The harmonic analysis of a plan (angles in rad, `group` the pitch setting), or why it has none."""
    settings = int(group.max()) + 1
    counts = np.bincount(group)
    if len(set(counts)) > 1:
        return "pitch settings with different numbers of spindle angles"
    if settings < 3:
        return "fewer than three pitch settings"
    angles = int(counts[0])
    rows = np.stack([np.nonzero(group == k)[0] for k in range(settings)])
    if any(len(set(beta[members])) > 1 for members in rows):
        return "different pitch angles in one setting"
    turned = alpha[rows]
    basis = np.stack([np.ones_like(turned), np.sin(turned), np.cos(turned)], axis=1)
    weights = angles * np.array([1.0, 0.5, 0.5])
    normal = basis @ basis.transpose(0, 2, 1)
    if angles < 3 or np.max(np.abs(normal - np.diag(weights))) > 1e-12 * angles:
        return "spindle angles that are not equally spaced"
    return UniformPlan(rows, basis / weights[:, None], beta[rows[:, 0]])


def required_path(problem: Problem, needed: str) -> UniformPlan:
    """`harmonic_path` for a study that has no other.

    **Raises:** `InputError` with the reason, beginning with `needed`.
    """
    plan = harmonic_path(problem)
    if isinstance(plan, str):
        raise InputError(f"{needed} study needs the paper's linear equations; here: {plan}")
    return plan


def harmonic_path(problem: Problem) -> UniformPlan | str:
    """The harmonic analysis if the fast path is exact for `problem`, otherwise the reason why it does not apply."""
    if not closed_form.applies(problem.chain):
        return "the chain has more than the nominal links and leaves"
    if not np.all(problem.takes_part):
        return "positions excluded from the fit"
    if np.ptp(np.asarray(problem.whitening)) > 0.0:
        return "readings of unequal weight"
    if problem.with_prior:
        return "a prior on parameters"
    where = problem.where
    return uniform_plan(np.asarray(where.alpha), np.asarray(where.beta), np.asarray(where.index("pitch")))

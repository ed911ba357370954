"""A problem: the chain, the settings, the readings with their noise, and the priors."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float
from numpy.typing import ArrayLike

from tumblecal.chain import Chain, Link, Where
from tumblecal.chain.where import register_unchecked
from tumblecal.data import PositionSet
from tumblecal.estimation.array_checks import numbers_in_g, require_g, stated_sd
from tumblecal.estimation.priors import Priors, prior_of
from tumblecal.estimation.white_rows import log_determinant, unwhitened, white, whitening_matrix
from tumblecal.ground.errors import InputError
from tumblecal.noise.covariance import Covariance


# Unknown noise: residuals are in mg, so that the solver's tolerances have the same meaning as with stated noise.
UNIT_SD = 1e-3
UNIT = Covariance(np.ones(0), "rows")
_NO_SD = np.ones((0, 3))
_HALF_LOG_2_PI = 0.5 * np.log(2 * np.pi)


@dataclass(frozen=True)
class Problem:
    """Least squares over the free leaves of a chain.

    - `chain`, `where`, `readings` (g): the model, the settings, and the readings.
    - `whitening`: converts errors of the readings to white rows: 1/sd of each (rows,), a matrix for each axis (3, positions,
      positions), or one for all (rows, rows).
    - `prior_weights`: 1/sd of a Gaussian prior on each parameter around `prior_mean`, 0 for none; for correlated priors the
      matrix (stated, free) that makes them white.
    - `known`: whether the noise is stated; otherwise white rows have one common, unknown variance (in mg).
    - `noise`: covariance of the readings, g^2. `sd`: of every reading relative to its neighbours in time, g (a common unit
      if the noise is unknown). `data`: the position set as measured, for names and labels. They belong to the measurement, not
      to the computation: `bare` is the problem without them.
    - `retained`: mask of the positions in the fit; None: all.

    Examples:
        >>> import jax.numpy as jnp
        >>> import tumblecal
        >>> from tumblecal.estimation import problem_of
        >>> data = tumblecal.simulate(tumblecal.read_rig("paper24"), seed=1)
        >>> problem = problem_of(data, noise_sd=0.15e-3)
        >>> problem.residual(jnp.zeros(15)).shape  # white rows: 24 positions, 3 axes
        (72,)
        >>> problem.without((0, 5)).takes_part.sum().item()
        22
    """

    chain: Chain
    where: Where
    readings: Float[Array | np.ndarray, "positions 3"]
    whitening: Float[Array | np.ndarray, " *shape"]
    prior_mean: Float[Array | np.ndarray, " free"]
    prior_weights: Float[Array | np.ndarray, " *weights"]
    known: bool
    with_prior: bool
    noise: Covariance = UNIT
    sd: Float[np.ndarray, "_ 3"] = field(default_factory=lambda: _NO_SD)
    data: PositionSet | None = None
    retained: Bool[Array | np.ndarray, " positions"] | None = None

    @classmethod
    def from_arrays(
        cls,
        chain: Chain,
        where: Where,
        readings: ArrayLike,
        *,
        noise_sd: ArrayLike | None = None,
        noise: Covariance | None = None,
        priors: Priors | None = None,
        names: Sequence[str] | None = None,
    ) -> "Problem":
        """The fit of a chain to arrays.

        **Arguments:**

        - `chain`: the model, such as `nominal_chain(where)`. `where`: the settings of the positions, from `settings`.
        - `readings`: (positions, 3), g; a list, a numpy or a JAX array, also one that is traced.
        - `noise_sd`: standard deviation of the readings, g: one number, or an array that extends to (positions, 3). `noise`:
          their covariance (g^2) instead. Without both the noise is estimated from the residuals.
        - `priors`: as of `problem_of`. `names`: of the positions; numbers from 1 if omitted.

        **Raises:** `InputError` for arrays of a wrong shape, noise that is not above 0, or a prior on a parameter that the
        chain lacks.

        Examples:
            >>> import jax.numpy as jnp
            >>> import numpy as np
            >>> from tumblecal import Problem, fit
            >>> from tumblecal.chain import nominal_chain, settings
            >>> where = settings(np.tile(np.arange(8) * np.pi / 4, 3), np.repeat([0.0, 0.5, 1.0], 8))  # rad
            >>> chain = nominal_chain(where)
            >>> readings = chain.named({"bias_z": 1e-3})(where)  # a JAX array, g
            >>> problem = Problem.from_arrays(chain, where, readings, noise_sd=1e-4)
            >>> problem
            Problem of 24 positions, 15 parameters; noise stated: 0.1 mg
            >>> round(fit(problem).value("bias_z"), 9)
            0.001
        """
        count, traced = len(where.alpha), isinstance(readings, Tracer)
        numbers = np.zeros((0, 3)) if traced else numbers_in_g("readings", readings)
        if np.shape(readings if traced else numbers) != (count, 3):
            raise InputError(f"readings have the shape {np.shape(readings)}; {count} positions need ({count}, 3)")
        if noise is not None and noise_sd is not None:
            raise InputError("noise_sd and noise both state the noise; give only one of them")
        stated = stated_sd(UNIT_SD if noise_sd is None else noise_sd, count)
        known = noise is not None or noise_sd is not None
        mean, weights = prior_of(chain, priors or {})
        if not known and np.any(weights != 0):
            raise InputError("a prior needs a stated noise: give noise_sd or noise")
        sd = np.broadcast_to(stated, (count, 3))
        noise = Covariance.of_sd(sd) if noise is None else noise
        labels = tuple(names) if names is not None else tuple(str(number) for number in range(1, count + 1))
        data = None
        if not traced:
            data = PositionSet(labels, np.degrees(where.alpha), np.degrees(where.beta), numbers, source="arrays")
            require_g(chain, numbers)
            readings = numbers
        with_prior = bool(np.any(weights != 0))
        sd = sd if noise.form == "rows" and noise_sd is not None else noise.sd.reshape(-1, 3)
        return cls(chain, where, readings, noise.inverse_root, mean, weights, known, with_prior, noise, sd, data)  # type: ignore[arg-type]

    def __repr__(self) -> str:
        size = f"{1e3 * float(np.median(self.sd)):.3g} mg" if self.known and self.sd.size else "estimated"
        counts = f"{len(self.readings)} positions, {len(self.chain.names)} parameters"
        priors = f", {self.priors} priors" if self.with_prior else ""
        return f"Problem of {counts}{priors}; noise {f'stated: {size}' if self.known else 'estimated'}"

    @property
    def bare(self) -> "Problem":
        """The problem without what no computation needs: one compiled program serves all bare problems of a kind."""
        return replace(self, noise=UNIT, sd=_NO_SD, data=None)

    @property
    def source(self) -> str:
        """Name of the data."""
        return "arrays" if self.data is None else self.data.source

    def log_density(
        self, vector: Float[Array | np.ndarray, " free"], log_noise: Float[Array, ""] | float | None = None
    ) -> Float[Array, ""]:
        """Logarithm of the density of the readings and the parameters: likelihood times priors, both normalised; pure.

        **Arguments:**

        - `vector`: parameters, base units (rad, g, 1), in the order of `chain.names`.
        - `log_noise`: natural logarithm of the factor of all standard deviations: relative to the stated noise, or to 1 mg if
          the noise is unknown. If omitted, 0. A sampler of it adds its prior (flat in `log_noise` is the usual one).

        **Returns:** the logarithm; the density of the readings is per g.

        Examples:
            >>> import tumblecal
            >>> from tumblecal.estimation import problem_of
            >>> problem = problem_of(tumblecal.simulate(tumblecal.read_rig("paper24"), seed=1), noise_sd=0.15e-3)
            >>> best = tumblecal.fit(problem).values
            >>> bool(problem.log_density(best) > problem.log_density(best + 1e-5))
            True
        """
        log_factor = jnp.asarray(0.0 if log_noise is None else log_noise, float)
        rows = self._of_readings(vector) * jnp.exp(-log_factor)
        count, log_det = log_determinant(jnp.asarray(self.whitening), self.takes_part)
        likelihood = -0.5 * jnp.sum(rows**2) + log_det - count * (log_factor + _HALF_LOG_2_PI)
        if not self.with_prior:
            return jnp.asarray(likelihood)
        root = self.prior_root
        prior_rows = jnp.asarray(root) @ (vector - self.prior_mean)
        log_root = 0.5 * np.linalg.slogdet(root @ root.T)[1]
        return jnp.asarray(likelihood - 0.5 * jnp.sum(prior_rows**2) + log_root - len(root) * _HALF_LOG_2_PI)

    def predicted(self, vector: Float[Array | np.ndarray, " free"]) -> Float[Array, "positions 3"]:
        """Readings predicted at a parameter vector, g."""
        return self.chain.at(vector)(self.where)

    def residual(self, vector: Float[Array | np.ndarray, " free"]) -> Float[Array, " rows"]:
        """White rows of predicted minus measured, zero for excluded positions, followed by the rows of the priors."""
        rows = self._of_readings(vector)
        return jnp.concatenate([rows, self.prior_rows(vector)]) if self.with_prior else rows

    def _of_readings(self, vector: Float[Array | np.ndarray, " free"]) -> Float[Array, " rows"]:
        rows = self.rows(self.predicted(vector) - self.readings)
        return rows if self.retained is None else jnp.where(jnp.repeat(jnp.asarray(self.retained), 3), rows, 0.0)

    def prior_rows(self, vector: Float[Array | np.ndarray, " free"]) -> Float[Array, " stated"]:
        """White rows of the priors: estimate minus mean."""
        deviation, weights = vector - self.prior_mean, jnp.asarray(self.prior_weights)
        return jnp.asarray(weights @ deviation if weights.ndim == 2 else deviation * weights)

    def rows(self, values: Any) -> Any:
        """White rows (rows, ...) of values given for every reading (positions, 3, ...), numpy or JAX."""
        return white(self.whitening, values)

    def unwhitened(self, rows: Float[np.ndarray, " rows"]) -> Float[np.ndarray, "positions 3"]:
        """The values of white rows, in g; the inverse of `rows`."""
        return unwhitened(np.asarray(self.whitening), rows)

    @cached_property
    def whitening_matrix(self) -> Float[np.ndarray, "rows rows"]:
        """The matrix that makes rows white by multiplication from the left."""
        return whitening_matrix(np.asarray(self.whitening))

    @property
    def scales(self) -> Float[np.ndarray, " free"]:
        """Typical sizes of the parameters; the solver works in these units."""
        return self.chain.scales

    @property
    def priors(self) -> int:
        """Number of parameters with a prior."""
        return len(self.prior_root)

    @cached_property
    def prior_root(self) -> Float[np.ndarray, "stated free"]:
        """The matrix that makes the priors white by multiplication from the left: one row for each parameter with a prior."""
        weights = np.asarray(self.prior_weights)
        return weights if weights.ndim == 2 else np.diag(weights)[weights != 0]

    @property
    def correlated(self) -> bool:
        """Whether the noise of different readings is correlated."""
        return self.whitening.ndim > 1

    @property
    def noise_of_recording(self) -> bool:
        """Whether the noise is that of the recording of the means; a stated one is the same for all readings."""
        recorded = self.data is not None and self.data.recorded_noise is not None
        return recorded and self.known and bool(np.ptp(self.sd) > 0)

    @property
    def names(self) -> tuple[str, ...]:
        """The positions' names."""
        numbers = range(1, len(self.readings) + 1)
        return tuple(map(str, numbers)) if self.data is None else self.data.names

    @property
    def measured_data(self) -> PositionSet:
        """The position set.

        **Raises:** `ValueError` for a problem without a position set.
        """
        if self.data is None:
            raise ValueError("this problem was made from arrays, without a position set")
        return self.data

    @property
    def takes_part(self) -> Bool[np.ndarray, " positions"]:
        """Mask of the positions in the fit."""
        return np.ones(len(self.readings), bool) if self.retained is None else np.asarray(self.retained)

    def with_noise(
        self, noise: Covariance, *, known: bool, sd: Float[np.ndarray, "positions 3"] | None = None
    ) -> "Problem":
        """The problem under another noise (covariance in g^2); `sd` (g) if it differs from that of each reading alone."""
        sd = noise.sd.reshape(-1, 3) if sd is None else sd
        return replace(self, noise=noise, whitening=noise.inverse_root, sd=sd, known=known)

    @property
    def independent(self) -> "Problem":
        """The same problem with independent positions, from the sd of each."""
        return self.with_noise(Covariance.of_sd(self.sd), known=self.known) if self.correlated else self

    def with_links(self, *links: Link) -> "Problem":
        """The problem with more links in its chain; their parameters have no prior."""
        chain = self.chain
        for link in links:
            chain = chain + link
        place = {name: number for number, name in enumerate(chain.names)}
        before = [place[name] for name in self.chain.names]
        mean, weights = np.zeros(len(place)), np.zeros((*self.prior_weights.shape[:-1], len(place)))
        mean[before], weights[..., before] = self.prior_mean, self.prior_weights
        return replace(self, chain=chain, prior_mean=mean, prior_weights=weights)

    def with_prior_sd(self, leaf: str, sd: float) -> "Problem":
        """The problem with a prior of mean 0 and this sd on every entry of a leaf that has none."""
        names = {name for free in self.chain.free if free.name == leaf for name in free.names}
        added = np.array([name in names for name in self.chain.names]) / sd
        weights = np.asarray(self.prior_weights)
        weights = weights + added if weights.ndim == 1 else np.vstack([weights, np.diag(added)[added > 0]])
        return replace(self, prior_weights=weights, with_prior=True)

    def without_priors(self, names: Collection[str]) -> "Problem":
        """The problem without priors on these parameters; the priors on the others are marginalised over them."""
        root, names_of = self.prior_root, self.chain.names
        stated = np.flatnonzero(np.any(root != 0, axis=0))
        remaining = [number for number, k in enumerate(stated) if names_of[k] not in names]
        if not remaining:
            return replace(self, prior_weights=np.zeros(len(names_of)), with_prior=False)
        covariance = np.linalg.inv(root[:, stated].T @ root[:, stated])[np.ix_(remaining, remaining)]
        weights = np.zeros((len(remaining), len(names_of)))
        weights[:, stated[remaining]] = np.linalg.inv(np.linalg.cholesky(covariance))
        return replace(self, prior_weights=weights)

    def without(self, positions: tuple[int, ...]) -> "Problem":
        """The problem with these positions excluded from the fit."""
        retained = self.takes_part.copy()
        retained[list(positions)] = False
        return replace(self, retained=retained)


def require_problem(problem: object, function: str) -> None:
    """Reject a position set or an array in place of a problem.

    **Raises:** `TypeError` with the function that makes one.
    """
    if not isinstance(problem, Problem):
        kind = type(problem).__name__
        raise TypeError(
            f"{function} takes a Problem, not {kind}: make one by problem_of(data) or Problem.from_arrays(chain, where, ...)"
        )


register_unchecked(
    Problem,
    ("chain", "where", "readings", "whitening", "prior_mean", "prior_weights", "retained"),
    ("known", "with_prior"),
    carried=("noise", "sd", "data"),
)

"""Many fits of one problem, to readings that are given or drawn: any batch size, constant memory.

Fits are made in blocks of `experiment.BLOCK` by one compiled program: from the harmonics of a uniform plan where these are
sufficient, otherwise by the exact gradient of each fit with one expansion of the normal matrix, and by plain Gauss-Newton where
that does not converge. The blocks go to all devices in turn. A trial depends on the seed and its number alone.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import jax
import numpy as np
from jaxtyping import Array, Bool, Float
from numpy.typing import ArrayLike
from scipy.special import stdtrit

from tumblecal.chain import Chain
from tumblecal.estimation.fit import Code
from tumblecal.estimation.problem import Problem
from tumblecal.estimation.programs import compiler_options
from tumblecal.ground.errors import InputError
from tumblecal.ground.showing import brief
from tumblecal.simulation.blocks import MANY_BLOCKS, blocks_of, fits_of_block, in_turn
from tumblecal.simulation.experiment import BLOCK, Experiment, experiment_of
from tumblecal.simulation.samplers import Sampler


if TYPE_CHECKING:
    import polars as pl


@dataclass(frozen=True)
class ManyFits:
    """Estimates of many fits, as numpy arrays.

    - `values` (fits, free): base units, in the order of `names`. `chi2` (fits): sum of squares of the white rows, `dof` its
      degrees of freedom. `converged` (fits).
    - `covariance` (free, free): of the estimates under the problem's noise, at the parameters of the problem's chain.
    - `known`: whether the noise is stated. `truth` (fits, free): of drawn trials.

    Examples:
        >>> import tumblecal
        >>> from tumblecal.estimation import problem_of
        >>> from tumblecal.simulation import ManyFits
        >>> data = tumblecal.simulate(tumblecal.read_rig("paper24"), seed=1)
        >>> many = tumblecal.fit_many(problem_of(data), [data.readings, data.readings])
        >>> isinstance(many, ManyFits), len(many), many.sd.shape, many.codes[0].value
        (True, 2, (2, 15), 'converged')
    """

    __repr__ = brief

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Float[np.ndarray, "fits free"]
    chi2: Float[np.ndarray, " fits"]
    converged: Bool[np.ndarray, " fits"]
    covariance: Float[np.ndarray, "free free"]
    dof: int
    known: bool
    truth: Float[np.ndarray, "fits free"] | None = None

    def __len__(self) -> int:
        return len(self.values)

    @property
    def codes(self) -> np.ndarray:
        """The `Code` of each fit."""
        return np.where(self.converged, np.array(Code.CONVERGED, object), np.array(Code.NOT_CONVERGED, object))

    @property
    def level(self) -> Float[np.ndarray, " fits"]:
        """Standard deviation of the white rows of each fit; 1 for stated noise."""
        return (
            np.ones(len(self.chi2))
            if self.known
            else np.sqrt(self.chi2 / self.dof if self.dof > 0 else np.nan * self.chi2)
        )

    @property
    def sd(self) -> Float[np.ndarray, "fits free"]:
        """Standard deviations of the values of each fit."""
        return self.level[:, None] * np.sqrt(np.diag(self.covariance))

    @property
    def covariances(self) -> Float[np.ndarray, "fits free free"]:
        """The covariance of each fit, without the change of the Jacobian between fits (a share of the parameters' size)."""
        return self.level[:, None, None] ** 2 * self.covariance

    def coverage(self, level: float = 0.95) -> Float[np.ndarray, " free"]:
        """Share of the trials whose interval contains the truth.

        **Raises:** `ValueError` for fits of given readings, whose truth is unknown.
        """
        if self.truth is None:
            raise ValueError("the truth of given readings is unknown; monte_carlo draws it")
        half = stdtrit(1e9 if self.known else self.dof, 0.5 + level / 2) * self.sd
        return np.mean(np.abs(self.values - self.truth)[self.converged] <= half[self.converged], axis=0)

    def table(self) -> "pl.DataFrame":
        """For each parameter the mean and sd of its estimates (of their errors if the truth is known), and the predicted sd."""
        import polars as pl

        estimates = self.values if self.truth is None else self.values - self.truth
        estimates = estimates[self.converged]
        columns = {
            "parameter": self.names,
            "unit": self.units,
            "mean": estimates.mean(axis=0),
            "sd": estimates.std(axis=0),
        }
        return pl.DataFrame(columns | {"predicted_sd": np.sqrt(np.mean(self.sd[self.converged] ** 2, axis=0))})


def fit_many(
    problem: Problem,
    readings: ArrayLike | Iterable[ArrayLike],
    *,
    path: str = "auto",
    devices: Sequence[Any] | None = None,
) -> ManyFits:
    """Fits of a problem's chain to many sets of readings at its positions.

    **Arguments:**

    - `problem`: chain, settings, noise and priors; its own readings are not used.
    - `readings`: (fits, positions, 3), g, a numpy or JAX array; or several such arrays one after the other, from a generator,
      so that not all need to be in memory.
    - `path`: `"auto"`, `"harmonic"` or `"chain"`. `devices`: of JAX; all if omitted.

    **Returns:** estimates, sums of squares and convergence of all fits, in their order.

    **Raises:** `InputError` for readings of a wrong shape, or positions that leave parameters undetermined.

    Examples:
        >>> import numpy as np
        >>> import tumblecal
        >>> from tumblecal.estimation import problem_of
        >>> data = tumblecal.simulate(tumblecal.read_rig("paper24"), seed=1)
        >>> problem = problem_of(data, noise_sd=0.15e-3)
        >>> rng = np.random.default_rng(0)
        >>> many = tumblecal.fit_many(problem, data.readings + rng.normal(scale=0.15e-3, size=(2000, 24, 3)))
        >>> many.values.shape, bool(many.converged.all())
        ((2000, 15), True)
    """
    one = experiment_of(problem, path=path)
    count, sizes = len(problem.readings), list[int]()
    many = sum(getattr(readings, "shape", ())[:1]) // BLOCK > MANY_BLOCKS

    def blocks() -> Iterator[np.ndarray]:
        for block in blocks_of(readings, problem.chain, count):
            sizes.append(len(block))
            # A copy: JAX may use an array's memory as it is, and a generator may write its next part into it.
            yield np.concatenate([block, np.repeat(block[-1:], BLOCK - len(block), axis=0)])

    def program(block: Array) -> tuple[Array, Array, Array]:
        return fits_of_block(one, block, optimised=many or len(sizes) > MANY_BLOCKS)

    results = list(in_turn(program, blocks(), devices))
    parts = [[part[:size] for part in result] for result, size in zip(results, sizes, strict=True)]
    parts = parts or [[np.zeros((0, len(problem.chain.names))), np.zeros(0), np.zeros(0, bool)]]
    values, chi2, converged = map(np.concatenate, zip(*parts, strict=True))
    return _many(problem, one, values, chi2, converged)


def monte_carlo(
    problem: Problem,
    trials: int,
    *,
    seed: int = 0,
    truth: Sampler | None = None,
    noise: Sampler | None = None,
    simulated: Chain | None = None,
    first: int = 0,
    path: str = "auto",
    devices: Sequence[Any] | None = None,
) -> ManyFits:
    """Simulated calibrations: an instrument and its noise are drawn, its readings are fitted.

    **Arguments:**

    - `problem`: chain, settings, noise and priors of the fit; the values of its chain are the default truth.
    - `trials`: number of calibrations. `seed`: of all of them.
    - `truth`: from a JAX key to the true parameters (free,) of one trial, base units. `noise`: from a key to the noise of one
      set of readings (positions, 3), g; if omitted, normal with the covariance of the problem.
    - `simulated`: the chain that makes the readings, with the free vector of the fitted chain: further effects have fixed
      coefficients. If omitted, the fitted chain.
    - `first`: number of the first trial, a multiple of 1024, so that parts of a long run can be made by several processes.
    - `path`, `devices`: as of `fit_many`.

    **Raises:** `InputError` for unknown noise without `noise`, a sampler's array of a wrong shape, or positions that leave
    parameters undetermined.

    Examples:
        >>> import jax
        >>> import tumblecal
        >>> from tumblecal.estimation import problem_of
        >>> from tumblecal.simulation import monte_carlo
        >>> data = tumblecal.simulate(tumblecal.read_rig("paper24"), seed=1)
        >>> problem = problem_of(data, noise_sd=0.15e-3)
        >>> heavy = lambda key: 1e-3 * jax.random.t(key, 4.0, (15,))
        >>> runs = monte_carlo(problem, 4096, seed=7, truth=heavy)
        >>> bool(abs(runs.coverage().mean() - 0.95) < 0.01)
        True
    """
    if trials < 1:
        raise InputError(f"trials {trials}: must be at least 1")
    if first % BLOCK:
        raise InputError(f"first {first}: must be a multiple of {BLOCK}")
    one = experiment_of(problem, simulated=simulated, draw_truth=truth, draw_noise=noise, path=path)

    def trial_block(number: Array) -> tuple[Array, Array, Array, Array]:
        made = one.trials(seed, number)
        return made.truth.T, made.values.T, made.chi2, made.converged

    program = jax.jit(trial_block, compiler_options=compiler_options())
    numbers = range(first // BLOCK, first // BLOCK + -(-trials // BLOCK))
    parts = list(in_turn(program, (np.asarray(number) for number in numbers), devices))
    drawn, values, chi2, converged = (np.concatenate(blocks)[:trials] for blocks in zip(*parts, strict=True))
    return _many(problem, one, values, chi2, converged, drawn)


def sweep(problems: Mapping[str, Problem], trials: int, **options: Any) -> "pl.DataFrame":
    """`monte_carlo` of several problems (plans, noises, priors): one row for each problem and parameter.

    **Arguments:**

    - `problems`: by name. `options`: of `monte_carlo`, the same for all.

    **Returns:** `problem`, and the columns of `ManyFits.table`.

    Examples:
        >>> import tumblecal
        >>> from tumblecal.estimation import problem_of
        >>> from tumblecal.simulation import sweep
        >>> data = tumblecal.simulate(tumblecal.read_rig("paper24"), seed=1)
        >>> table = sweep({f"{sd} g": problem_of(data, noise_sd=sd) for sd in (1e-4, 2e-4)}, 1024)
        >>> table.columns, len(table)
        (['problem', 'parameter', 'unit', 'mean', 'sd', 'predicted_sd'], 30)
    """
    import polars as pl

    rows = [
        monte_carlo(problem, trials, **options).table().insert_column(0, pl.lit(name).alias("problem"))
        for name, problem in problems.items()
    ]
    return pl.concat(rows)


def _many(problem: Problem, one: Experiment, values, chi2, converged, truth=None) -> ManyFits:
    return ManyFits(
        one.names, one.units, values, chi2, converged, np.asarray(one.covariance), one.dof, problem.known, truth
    )

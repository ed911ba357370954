"""A fit as a residual function: chain, settings, readings, weights, priors."""

from collections.abc import Mapping
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from tumblecal.chain import Chain, Where, hand_held_chain, nominal_chain, settings
from tumblecal.data import PositionSet
from tumblecal.errors import InputError
from tumblecal.estimation.mountings import mount_labels, nominal_rotations, turned_mountings
from tumblecal.noise.recorded import NOISE_MODEL, recorded_covariance


# Unknown noise: residuals are counted in mg so that the solver's tolerances mean the same as with stated noise.
UNIT_WEIGHT = 1e3


class Problem(eqx.Module):
    """Least squares over the free leaves of a chain.

    `weights` are 1/sd of each reading (1/mg where the noise is not known); `prior_weights` are 1/sd of a Gaussian
    prior on each parameter around `prior_mean`, 0 for none. `whiten`, where the means' covariance is known, is the inverse of
    its lower triangle for each axis and takes the place of the weights.
    """

    chain: Chain
    where: Where
    measured: Float[Array | np.ndarray, "positions 3"]
    weights: Float[Array | np.ndarray, "positions 3"]
    prior_mean: Float[Array | np.ndarray, " free"]
    prior_weights: Float[Array | np.ndarray, " free"]
    noise: str = eqx.field(static=True)
    with_prior: bool = eqx.field(static=True)
    whiten: Float[Array | np.ndarray, "3 positions positions"] | None = None

    def predicted(self, vector: Float[Array, " free"]) -> Float[Array, "positions 3"]:
        """Readings predicted at a parameter vector, g."""
        return self.chain.at(vector)(self.where)

    def residual(self, vector: Float[Array, " free"]) -> Float[Array, " rows"]:
        """Weighted predicted minus measured; the priors' rows follow."""
        off = self.predicted(vector) - self.measured
        rows = (off * self.weights if self.whiten is None else jnp.einsum("apq,qa->pa", self.whiten, off)).ravel()
        if not self.with_prior:
            return rows
        return jnp.concatenate([rows, (vector - self.prior_mean) * self.prior_weights])

    def off(self, residual: Float[np.ndarray, " rows"]) -> Float[np.ndarray, "positions 3"]:
        """Measured minus predicted, g, from the residual."""
        rows = np.asarray(residual)[: self.measured.size].reshape(self.measured.shape)
        if self.whiten is None:
            return -rows / np.asarray(self.weights)
        return -np.linalg.solve(np.asarray(self.whiten), rows.T[:, :, None])[:, :, 0].T

    @property
    def independent(self) -> "Problem":
        """The same with positions counted as independent, by the sd of each."""
        return replace(self, whiten=None)

    @property
    def scales(self) -> Float[np.ndarray, " free"]:
        """Typical sizes of the parameters; the solver works in these units."""
        return self.chain.scales


def where_of(data: PositionSet) -> Where:
    """The settings of a position set."""
    return settings(
        data.alpha,
        data.beta,
        run=data.run,
        mount=data.mount,
        time_s=data.time_s,
        temperature_degc=data.temperature_degc,
        approach=data.approach,
    )


def default_chain(data: PositionSet) -> Chain:
    """The nominal chain for a position set.

    The pitch axis is set anew in every run and mounting, so dbeta has one value for each of them; the mount's angles
    one for each mounting, counted from the quarter turn at which the readings show the triad to stand in it; the
    sensor's parameters are shared by all data. Positions of unknown attitude (hand-held) have two tilts each instead.

    **Raises:** `InputError` where mountings differ by more than a turn of the triad, or the readings do not tell by which.
    """
    if data.hand_held:
        return hand_held_chain(where_of(data))
    many_runs, many_mounts = len(data.runs) > 1, len(set(data.mount or ("1",))) > 1
    by = ".".join([*(["run"] if many_runs else []), *(["mount"] if many_mounts else []), "pitch"])
    where, turns = where_of(data), turned_mountings(data)
    return nominal_chain(
        where,
        dbeta_by=by,
        dtheta_by="mount" if many_mounts else None,
        mount_nominal=nominal_rotations(turns, mount_labels(where)),
    )


def problem_of(
    data: PositionSet,
    chain: Chain | None = None,
    *,
    noise_sd: float | None = None,
    priors: Mapping[str, tuple[float, float]] | None = None,
) -> Problem:
    """The fit of a chain to a position set.

    **Arguments:**

    - `data`: positions; the noise model of their recording weighs the readings, else their sd columns, if any.
    - `chain`: the model; the nominal one for these data where left out.
    - `noise_sd`: stated sd of every reading, g; goes before the noise model and the sd columns of the data.
    - `priors`: (mean, sd) by parameter or leaf name (`dbeta` stands for all dbeta), base units.

    **Raises:** `InputError` for a prior on a parameter that the chain lacks, or an sd that is not positive.
    """
    chain = default_chain(data) if chain is None else chain
    whiten = None
    if noise_sd is not None:
        if not noise_sd > 0:
            raise InputError(f"the noise sd must be above 0, not {noise_sd:g} g")
        weights, noise = np.full(data.readings.shape, 1.0 / noise_sd), "stated"
    elif data.sd is not None:
        weights, noise = 1.0 / data.sd, "stated"
        whiten = _whitening(data)
    else:
        weights, noise = np.full(data.readings.shape, UNIT_WEIGHT), "estimated"
    mean, prior_weights = _priors(chain, priors or {})
    if noise == "estimated" and np.any(prior_weights > 0):
        # A prior weighs against the data only when the data's noise is known: estimate it without the prior first.
        raise InputError("a prior needs the noise: give sd columns or --noise-sd (e.g. --noise-sd 0.1mg)")
    return Problem(
        chain=chain,
        where=where_of(data),
        measured=data.readings,
        weights=weights,
        prior_mean=mean,
        prior_weights=prior_weights,
        noise=noise,
        with_prior=bool(np.any(prior_weights > 0)),
        whiten=whiten,
    )


def _whitening(data: PositionSet) -> Float[np.ndarray, "3 positions positions"] | None:
    """The inverse of the lower triangle of the means' covariance; None where positions are independent.

    **Raises:** `InputError` when the noise model and the times of the positions contradict each other.
    """
    covariance = recorded_covariance(data)
    if covariance is None:
        return None
    try:
        return np.linalg.inv(np.linalg.cholesky(covariance))
    except np.linalg.LinAlgError:
        raise InputError(
            f"{data.source}: the noise model (comment {NOISE_MODEL}) and the columns time_s and n give no covariance; run "
            "tumblecal reduce again, or delete the line to have the sd columns count alone"
        ) from None


def _priors(chain: Chain, priors: Mapping[str, tuple[float, float]]) -> tuple[np.ndarray, np.ndarray]:
    names = chain.names
    mean, weights = np.zeros(len(names)), np.zeros(len(names))
    members = {leaf.name: leaf.names for leaf in chain.free} | {name: (name,) for name in names}
    for key, (centre, sd) in priors.items():
        if key not in members:
            raise InputError(f"prior on {key!r}: the model has no such parameter; it has {', '.join(names)}")
        if not sd > 0:
            raise InputError(f"prior on {key!r}: the standard deviation must be above 0")
        places = [names.index(name) for name in members[key]]
        mean[places], weights[places] = centre, 1.0 / sd
    return mean, weights

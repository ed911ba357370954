"""The problem of a position set: its settings, its default chain, its noise."""

from dataclasses import replace

import numpy as np

from tumblecal.chain import Chain, Where, hand_held_chain, nominal_chain, settings
from tumblecal.chain.where import register_unchecked, with_visits
from tumblecal.data import PositionSet
from tumblecal.data.position_comments import BY_HAND, NOISE_MODEL
from tumblecal.estimation.mountings import mount_labels, nominal_rotations, turned_mountings
from tumblecal.estimation.priors import Priors
from tumblecal.estimation.problem import UNIT_SD, Problem
from tumblecal.ground.angle_settings import distinct
from tumblecal.ground.errors import InputError
from tumblecal.ground.units import LARGEST_SD_G, SD_RANGE, SMALLEST_SD_G
from tumblecal.noise.covariance import Covariance


# The class itself knows no JAX: capture and its readers need none.
register_unchecked(
    PositionSet,
    ("alpha_deg", "beta_deg", "readings", "sd", "time_s", "temperature_degc", "approach", "n"),
    (),
    carried=(
        "names", "run", "mount", "clock", "recorded_noise", "comments", "source", "in_ms2", "files", "ignored",
    ),
)  # fmt: skip


def where_of(data: PositionSet, chain: Chain | None = None) -> Where:
    """The settings of a position set, with the visits of settings if leaves of the chain are indexed by them.

    For unknown attitudes the names do not contain the pitch settings, so that all such sets of one size have the same model.

    Examples:
        >>> import tumblecal
        >>> from tumblecal.estimation import where_of
        >>> data = tumblecal.simulate(tumblecal.read_rig("paper24"), seed=1)
        >>> where_of(data).names("pitch")
        ('_0', '_1', '_2')
    """
    where = settings(
        data.alpha,
        data.beta,
        pitch=distinct(data.beta) if data.hand_held else None,
        run=data.run,
        mount=data.mount,
        time_s=data.time_s,
        temperature_degc=data.temperature_degc,
        approach=data.approach,
        clock=data.clock,
    )
    if not data.hand_held:
        return where if chain is None else with_visits(where, {leaf.by for leaf in chain.parameters})
    numbered = (
        (name, tuple(f"_{k}" for k in range(len(labels))) if "pitch" in name else labels)
        for name, labels in where.labels
    )
    return replace(where, labels=tuple(numbered))


def default_chain(data: PositionSet) -> Chain:
    """The nominal chain for a position set.

    The pitch axis is set again in every run and mounting, so dbeta has one value for each of them. The mount angles
    have one value for each mounting, relative to the quarter turn found from the readings. The sensor's parameters
    are shared by all data. Positions of unknown attitude (hand-held) have two tilts each instead; for positions set by hand
    (`attitudes: hand`), dbeta is fixed.

    **Raises:** `InputError` if mountings differ by more than a turn of the triad, or if the turn is not clear from
    the readings.

    Examples:
        >>> import tumblecal
        >>> from tumblecal.estimation import default_chain
        >>> data = tumblecal.simulate(tumblecal.read_rig("paper24"), seed=1)
        >>> len(default_chain(data).names)
        15
    """
    if data.hand_held:
        return hand_held_chain(where_of(data))
    many_runs, many_mounts = len(data.runs) > 1, len(set(data.mount or ("1",))) > 1
    by = ".".join([*(["run"] if many_runs else []), *(["mount"] if many_mounts else []), "pitch"])
    where, turns = where_of(data), turned_mountings(data)
    chain = nominal_chain(
        where,
        dbeta_by=by,
        dtheta_by="mount" if many_mounts else None,
        mount_nominal=nominal_rotations(turns, mount_labels(where)),
    )
    # No pitch axis is common to positions set by hand.
    return chain.fixed({"dbeta"}) if data.attitudes == BY_HAND else chain


def problem_of(
    data: PositionSet,
    chain: Chain | None = None,
    *,
    noise_sd: float | None = None,
    priors: Priors | None = None,
) -> Problem:
    """The fit of a chain to a position set.

    **Arguments:**

    - `data`: positions; their readings are weighted by the noise model of the recording, otherwise by the sd columns, if any.
    - `chain`: the model; the nominal one for these data if omitted.
    - `noise_sd`: stated sd of every reading, g; takes precedence over the noise model and the sd columns of the data.
    - `priors`: (mean, sd) by parameter or leaf name (`dbeta` means all dbeta), base units; (means, covariance) by the names of
      several correlated parameters.

    **Raises:** `InputError` for a prior on a parameter that the chain lacks, or an sd that is not positive.

    Examples:
        >>> import tumblecal
        >>> from tumblecal.estimation import problem_of
        >>> data = tumblecal.simulate(tumblecal.read_rig("paper24"), seed=1)
        >>> problem = problem_of(data, noise_sd=0.15e-3, priors={"dbeta": (0.0, 1e-3)})  # rad
        >>> problem.known, problem.priors
        (True, 3)
        >>> problem_of(data, priors={"dbeta": (0.0, 1e-3)})  # doctest: +ELLIPSIS
        Traceback (most recent call last):
        tumblecal.ground.errors.InputError: a prior needs a stated noise: give sd columns or --noise-sd (...)
    """
    chain = default_chain(data) if chain is None else chain
    if noise_sd is not None and not SMALLEST_SD_G <= noise_sd <= LARGEST_SD_G:
        raise InputError(f"noise_sd {noise_sd:g} g: {SD_RANGE}")
    known = noise_sd is not None or data.sd is not None
    column_sd = None if noise_sd else data.weighing_sd
    sd = np.full(data.readings.shape, noise_sd or UNIT_SD) if column_sd is None else column_sd
    noise = Covariance.of_sd(sd) if noise_sd is not None else _recorded(data) or Covariance.of_sd(sd)
    return Problem.of_noise(
        chain, where_of(data, chain), data.readings, noise, sd, known=known, priors=priors, data=data
    )


def _recorded(data: PositionSet) -> Covariance | None:
    """The covariance of the means by the noise model of their recording; None if they are independent.

    **Raises:** `InputError` if the noise model and the times of the positions contradict each other.
    """
    if data.sd is None or not data.recorded_noise:
        return None
    from tumblecal.noise.recorded import recorded_covariance

    covariance = recorded_covariance(data)
    if covariance is None:
        return None
    noise = Covariance.by_axis(covariance)
    try:
        _ = noise.root
    except np.linalg.LinAlgError:
        raise InputError(
            f"{data.source}: the noise model (comment {NOISE_MODEL}) and the columns time_s and n give no valid covariance; "
            "run tumblecal reduce again, or delete the line to use the sd columns alone"
        ) from None
    return noise

"""Positions set by hand: a tilt of each, if tilts explain the readings better than causes and noise do."""

from collections.abc import Mapping

from tumblecal.data.position_comments import BY_HAND
from tumblecal.diagnosis.priors import LEAST_NOISE_ODDS, SURE_SCATTER
from tumblecal.diagnosis.refine.insert import fit_with
from tumblecal.diagnosis.screening.noise_change import NoiseFault
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.estimation.attitude_scatter import LEAST_ODDS, AttitudeScatter, fit_with_scatter
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.problem import Problem
from tumblecal.full_model.full_model import FullModel
from tumblecal.full_model.tangent import robust_start, tangent


# Faults of the noise that tilts of the positions look like.
_OF_TILTS = {"noise_level", "noise_attitude"}


def fit_with_tilts(
    model: FullModel, problem: Problem, screened: Screened, noise_wrong: Mapping[str, NoiseFault], extended: Fit
) -> tuple[Fit, AttitudeScatter] | None:
    """The exact fit with a tilt of each position (`estimation.attitude_scatter`), if it is stated that they were set by hand,
    or if tilts explain the readings better than a fault of the noise, and surely better than causes; otherwise None.

    **Arguments:**

    - `screened`, `noise_wrong`, `extended`: the screen of `problem` without tilts, and its fit.
    """
    stated = problem.measured_data.attitudes
    if model.hand_held or stated not in (None, BY_HAND) or not (stated or {*noise_wrong} <= _OF_TILTS):
        return None
    nominal = extended
    if noise_wrong or screened.members:
        nominal = fit_with(tangent(model, problem, robust_start(model, problem)), ())
    of_noise_alone = bool(noise_wrong) and not screened.members
    return fit_with_scatter(nominal, LEAST_ODDS if of_noise_alone else SURE_SCATTER - screened.log_odds_of_noise)


def tilt_faults(scatter: AttitudeScatter) -> dict[str, NoiseFault]:
    """The scatter of the attitudes as a fault of the noise; none if it is stated."""
    alternative = "" if scatter.log_odds > LEAST_NOISE_ODDS else "noise_level"
    return {} if scatter.stated else {"noise_attitude": NoiseFault(scatter.size_words, alternative)}

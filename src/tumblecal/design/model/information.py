"""The covariance of the parameters that a schedule determines, settings that are set again and slow noise included.

The model is linear with random effects (split plot: Jones and Goos 2007, Applied Statistics 56, 347): the errors of a setting
are common to all positions of one visit. They are parameters with a prior here, which gives the same information.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag, cho_factor, cho_solve, solve_triangular

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.design.model.responses import Responses
from tumblecal.design.model.schedule import Schedule
from tumblecal.estimation.visits import visit_precision
from tumblecal.noise.of_head import slow_covariance


def noise_covariance(
    responses: Responses, schedule: Schedule, ability: HeadAbility
) -> Float[np.ndarray, "3 positions positions"]:
    """Covariance of the means of a schedule on each axis, g^2: white noise and the slow parts."""
    slow = slow_covariance(ability.slow_noise, ability.times, schedule.start_s)
    return slow + responses.sd**2 * np.eye(len(schedule))


@dataclass(frozen=True)
class Design:
    """The linear model of a schedule: `columns` (positions, 3, all), g, each in its scale: the shared parameters, then the
    errors of each visit of a pitch setting and of each mounting; `information` (all, all): of their priors; `shared`: number of
    the shared parameters."""

    columns: Float[np.ndarray, "positions 3 all"]
    information: Float[np.ndarray, "all all"]
    shared: int


def design_of(responses: Responses, schedule: Schedule) -> Design:
    """The linear model of a schedule."""
    cells, taken = responses.cells, schedule.cells
    columns, information = [responses.columns[taken]], [responses.information]
    for setting, visit, labels in (
        (responses.pitch, schedule.pitch_visit, cells.pitch[taken]),
        (responses.mount, schedule.mount_visit, cells.mounting[taken]),
    ):
        if setting.exact:
            continue
        first = np.unique(visit, return_index=True)[1]
        precision = visit_precision(setting.common, setting.again, labels[first])
        here = visit[:, None] == np.arange(len(first))
        for component in range(setting.columns.shape[2]):
            columns.append(setting.columns[taken][:, :, component, None] * here[:, None, :])
            information.append(precision)
    return Design(np.concatenate(columns, axis=2), np.asarray(block_diag(*information)), len(responses.names))


def information_of(design: Design, noise: Float[np.ndarray, "3 positions positions"]) -> Float[np.ndarray, "all all"]:
    """Information on all parameters of a design: its priors, and the positions under a covariance on each axis, g^2."""
    total = design.information.copy()
    for axis in range(3):
        columns = design.columns[:, axis]
        total += columns.T @ cho_solve(cho_factor(noise[axis]), columns)
    return total


def white_rows(design: Design, noise: Float[np.ndarray, "3 positions positions"]) -> Float[np.ndarray, "rows all"]:
    """White responses of the readings of all axes, and rows of the priors: the square root of `information_of`."""
    rows = [solve_triangular(np.linalg.cholesky(noise[axis]), design.columns[:, axis], lower=True) for axis in range(3)]
    values, vectors = np.linalg.eigh(design.information)
    return np.concatenate([*rows, np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T])

"""Consistency of the paper's published numbers."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import chdtr, fdtrc

from tumblecal.data import paper
from tumblecal.estimation import Fit
from tumblecal.estimation.linearised import linearised
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2


@dataclass(frozen=True)
class PublishedSet:
    """How well a published parameter set explains Table 1.

    `f`: mean square that the set adds to the best fit's residuals, over theirs, with `dof` degrees of freedom;
    `p_value`: probability of a larger F if the set were the truth. Residuals in g, measured minus predicted.
    """

    name: str
    f: float
    dof: tuple[int, int]
    p_value: float
    largest_residual_g: float
    smallest_residual_g: float
    residuals: Float[np.ndarray, "positions 3"]


@dataclass(frozen=True)
class NoiseAudit:
    """The residual noise of Table 1 against what the stated noise implies for the mean of a 20-minute dwell.

    `implied_white_beyond_100s_g`: if the noise averaged down as white noise from 100 s on, the most that the stated figures
    allow; `implied_floor_g`: if the 100 s figure includes a floor. `p_value`: probability of residuals this small if the noise
    is white.
    """

    observed_g: float
    dof: int
    implied_white_beyond_100s_g: float
    implied_floor_g: float
    p_value: float


@dataclass(frozen=True)
class Audit:
    """The audit of the paper's measured part."""

    explanations: tuple[PublishedSet, ...]
    noise: NoiseAudit
    mean_norm: float
    mean_norm_if_ms2_g: float
    published_extremes_g: tuple[float, float]


def audit(fit: Fit) -> Audit:
    """Audit Table 1 by its exact fit: against the simulation's truth, Table 2, Table 3 and the stated noise."""
    sets = {"input of the paper's simulation (section 3)": np.array(list(paper.SIMULATION_TRUTH.values()))}
    published = paper.table2()
    for run in range(3):
        sets[f"Table 2, run {run + 1}"] = np.array([published[name][run] for name in fit.names])
    norms = np.linalg.norm(fit.problem.measured_data.readings, axis=1)
    third = paper.table3()
    return Audit(
        explanations=tuple(_explanation(name, values, fit) for name, values in sets.items()),
        noise=_noise(fit),
        mean_norm=float(np.mean(norms)),
        mean_norm_if_ms2_g=float(np.mean(norms) / STANDARD_GRAVITY_MS2),
        published_extremes_g=(float(third["largest"][0]), float(third["smallest"][0])),
    )


def _explanation(name: str, values: np.ndarray, fit: Fit) -> PublishedSet:
    residuals = -fit.problem.unwhitened(np.asarray(linearised(fit.problem, values)[0]))
    free, dof = len(values), fit.dof
    least = np.sum(fit.residuals**2)
    f = float((np.sum(residuals**2) - least) / free / (least / dof))
    return PublishedSet(
        name=name,
        f=f,
        dof=(free, dof),
        p_value=float(fdtrc(free, dof, f)),
        largest_residual_g=float(residuals.max()),
        smallest_residual_g=float(residuals.min()),
        residuals=residuals,
    )


def _noise(fit: Fit) -> NoiseAudit:
    """Two figures fix white noise plus a floor: `s^2(t) = N^2 / t + B^2` (IEEE 528, Allan variance of both)."""
    (short, s_short), (long, s_long) = paper.STATED_SD_G.items()
    white = (s_short**2 - s_long**2) / (1 / short - 1 / long)
    floor = s_long**2 - white / long
    most = s_long / np.sqrt(paper.DWELL_S / long)
    return NoiseAudit(
        observed_g=fit.sigma,
        dof=fit.dof,
        implied_white_beyond_100s_g=float(most),
        implied_floor_g=float(np.sqrt(white / paper.DWELL_S + floor)),
        p_value=float(chdtr(fit.dof, fit.dof * (fit.sigma / most) ** 2)),
    )

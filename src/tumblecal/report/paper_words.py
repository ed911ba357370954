"""Findings of the study of the paper, in words generated from its numbers."""

import numpy as np

from tumblecal.estimation import Fit
from tumblecal.ground.numbers_shown import p_words
from tumblecal.show.verdict import Finding, Verdict
from tumblecal.studies.paper_audit import Audit
from tumblecal.studies.paper_study import PaperStudy


_UNLIKELY = 0.01


def findings(study: PaperStudy, audit: Audit, table1: Fit) -> list[str]:
    """The findings, a paragraph each."""
    return [
        _methods(study),
        _filter(study),
        _table1(table1),
        _explained(audit),
        _published(audit, table1),
        _noise(audit),
        _units(audit),
    ]


def paper_verdict(study: PaperStudy, audit: Audit, table1: Fit, verdict: str) -> Verdict:
    """The first screen: findings, evidence, and how to calibrate another unit; `verdict`: of the diagnosis of Table 1, in a
    line."""
    weak = table1.identifiability.weak if table1.identifiability else ()
    (error_u, _), difference = _largest_error_u(study), _difference(study)
    explained = []
    for e in audit.explanations[:2]:
        name = e.name if e.name.startswith("Table") else f"the {e.name}"
        explained.append(f"{'' if e.p_value > _UNLIKELY else 'not '}by {name} ({p_words(e.p_value)})")
    found = [
        f"Noise: Table 1 shows {1e3 * audit.noise.observed_g:.3f} mg, the stated instrument would show "
        f"{1e3 * audit.noise.white_g:.2f} mg or more.",
        f"Small-angle equations are adequate here: they differ from the exact fit by {difference:.3f} standard deviations of "
        "one set.",
        "With a diffuse prior the Kalman filter is the running mean of least squares; faster convergence is due to the prior.",
    ]
    return Verdict(
        "",
        f"Table 1, which the paper calls measured, is explained {', '.join(explained)}.",
        found=tuple(map(Finding, found)),
        evidence=(
            f"Simulated with known true values: the exact fit of {len(study.single)} data sets differs by at most "
            f"{error_u:.1f} u.",
            f"Table 1: {verdict}",
            *(f"Poorly determined: {direction.words}; a second mounting determines it." for direction in weak[:1]),
        ),
        next=(
            "To calibrate a unit, put angles and mean readings of each position into a CSV file (tumblecal calibrate --help). "
            "calibration/calibration.html states whether the result may be used.",
            "tumblecal calibrate data.csv",
            "tumblecal diagnose data.csv",
        ),
    )


def _largest_error_u(study: PaperStudy) -> tuple[float, str]:
    """The largest error of the exact fit of all data sets, in its standard uncertainty, and its parameter."""
    errors = np.abs(study.exact_mean[-1] - study.truth) / (study.single_sd / np.sqrt(len(study.single)))
    return float(np.max(errors)), study.names[int(np.argmax(errors))]


def _difference(study: PaperStudy) -> float:
    """Largest difference of the running mean of least squares from the exact fit, in standard deviations of one set."""
    return float(np.max(np.abs(study.exact_mean[-1] - study.mean[-1]) / study.single_sd))


def _methods(study: PaperStudy) -> str:
    error_u, name = _largest_error_u(study)
    return (
        f"Simulation: {len(study.single)} data sets with the paper's parameters and 0.15 mg noise: after all of them the exact "
        f"fit and the running mean of linear least squares differ by at most {_difference(study):.3f} standard deviations of "
        "one set, so the small-angle equations are adequate at these magnitudes. The largest error of the exact fit is "
        f"{error_u:.1f} u ({name})."
    )


def _filter(study: PaperStudy) -> str:
    mean, informed, tight = (
        study.early_error[name] for name in ("running mean", "Kalman, prior sd 0.001", "Kalman, prior sd 0.0003")
    )
    return (
        f"Kalman filter: with a diffuse prior and constant R it is the running mean of least squares: the two "
        f"differ by at most {study.kalman_is_running_mean:.0e} standard deviations at every data set. Any faster initial "
        f"convergence is due to the prior. With a prior standard deviation of 1e-3 the rms error after one set is "
        f"{informed[0]:.2f} standard deviations of a set ({mean[0]:.2f} for least squares), "
        f"after {len(mean)} sets {informed[-1]:.2f} ({mean[-1]:.2f}); with 0.3e-3, less than the true errors, "
        f"{tight[0]:.2f} and {tight[-1]:.2f}. The paper's claim that the filter converges faster is a statement about its "
        f"prior, which it does not state."
    )


def _table1(fit: Fit) -> str:
    rms = np.sqrt(np.mean(fit.residuals**2)) * 1e3
    weakest = fit.identifiability.weak[0].words if fit.identifiability and fit.identifiability.weak else "none"
    return (
        f"Table 1, exact fit: residual rms {rms:.4f} mg, noise sd {fit.sigma * 1e3:.4f} mg with {fit.dof} degrees of "
        f"freedom. The most poorly determined combination is {weakest}: the x axis lies along the spindle, so its input is "
        f"only 0 to -1 g. A second mounting, rotated by 90 degrees, determines it (configs/remount.toml)."
    )


def _explained(audit: Audit) -> str:
    truth = audit.explanations[0]
    return (
        f'Origin of Table 1: the {truth.name} fits the "measured" table: F = {truth.f:.2f} with {truth.dof[0]} and '
        f"{truth.dof[1]} degrees of freedom, {p_words(truth.p_value)}."
        + (
            " This test cannot distinguish Table 1 from data simulated with those parameters."
            if truth.p_value > 0.05
            else ""
        )
    )


def _published(audit: Audit, table1: Fit) -> str:
    run = audit.explanations[1]
    largest, smallest = audit.published_extremes_g
    return (
        f"Published result: the {run.name} does not fit the same table: F = {run.f:.0f}, {p_words(run.p_value)}. Its "
        f"residuals on Table 1 reach {run.largest_g * 1e3:+.1f} and {run.smallest_g * 1e3:+.1f} mg; the paper's Table 3 "
        f"states {largest * 1e3:+.2f} and {smallest * 1e3:+.2f} mg for the run, the best fit reaches "
        f"{table1.residuals.max() * 1e3:+.2f} and {table1.residuals.min() * 1e3:+.2f} mg."
    )


def _noise(audit: Audit) -> str:
    noise = audit.noise
    verdict = (
        "The noise of Table 1 is less than that of the stated instrument." if noise.p_value < 0.01 else "The two agree."
    )
    return (
        f"Noise: the paper states an sd of 1.2 mg over 1 s and 0.7 mg over 100 s. Over a dwell of 20 minutes this corresponds "
        f"to {noise.white_g * 1e3:.2f} mg if the noise is white beyond 100 s, {noise.flicker_g * 1e3:.2f} mg if the 100 s "
        f"figure is a floor. The residuals of Table 1 show {noise.observed_g * 1e3:.3f} mg ({p_words(noise.p_value)} "
        f"against the smaller of the two). {verdict}"
    )


def _units(audit: Audit) -> str:
    return (
        f"Units: the header of Table 1 states m/s^2; the mean norm of its rows is {audit.norm_g:.4f}. At rest it must be "
        f"1 g: the numbers are g (as m/s^2 they would be {audit.norm_if_ms2_g:.4f} g)."
    )

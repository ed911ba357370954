"""What the paper's study found, in words made from its numbers."""

import numpy as np

from tumblecal.estimation import Fit
from tumblecal.ground.numbers_shown import p_words
from tumblecal.report.verdict import Finding, Verdict
from tumblecal.studies.paper_audit import Audit
from tumblecal.studies.paper_study import PaperStudy


_UNLIKELY = 0.01
_OWN = ("tumblecal calibrate data.csv", "tumblecal diagnose data.csv")


def findings(study: PaperStudy, audit: Audit, table1: Fit) -> list[str]:
    """The page of plain words: one paragraph a finding."""
    return [
        _methods(study),
        _filter(study),
        _table1(table1),
        _explained(audit),
        _published(audit, table1),
        _noise(audit),
        _units(audit),
    ]


def headline(audit: Audit) -> str:
    """What Table 1 turned out to be, in a line."""
    truth, run = audit.explanations[:2]
    explained = (
        f"{'' if e.p_value > _UNLIKELY else 'not '}by {_named(e.name)} ({p_words(e.p_value)})" for e in (truth, run)
    )
    return f"Table 1, which the paper calls measured, is explained {', '.join(explained)}."


def _named(parameters: str) -> str:
    return parameters if parameters.startswith("Table") else f"the {parameters}"


def paper_verdict(study: PaperStudy, audit: Audit, table1: Fit, verdict: str) -> Verdict:
    """The first screen: what was found, how far it can be trusted, and how to calibrate another unit.

    **Arguments:**

    - `verdict`: of the diagnosis of Table 1, in a line.
    """
    sd = study.single_sd / np.sqrt(len(study.single))
    off = np.max(np.abs(study.exact_mean[-1] - study.truth) / sd)
    apart = np.max(np.abs(study.exact_mean[-1] - study.mean[-1]) / study.single_sd)
    weak = table1.identifiability.weak if table1.identifiability else ()
    found = [
        f"Noise: Table 1 shows {1e3 * audit.noise.observed_g:.3f} mg, the stated instrument would show "
        f"{1e3 * audit.noise.white_g:.2f} mg or more.",
        f"Small-angle equations are adequate here: they differ by {apart:.3f} sd of one set from the exact fit.",
        "With a diffuse prior the Kalman filter is the running mean of least squares; faster convergence is due to the prior.",
    ]
    trusted = [
        f"Simulated with known truth: the exact fit of {len(study.single)} data sets differs from it by at most {off:.1f} u.",
        f"Table 1: {verdict}",
        *(f"Poorly determined: {direction.words}; a second mounting determines it." for direction in weak[:1]),
    ]
    return Verdict(
        "",
        headline(audit),
        "Table 1",
        "",
        found=tuple(map(Finding, found)),
        evidence=tuple(trusted),
        next=(
            "To calibrate a unit, put angles and mean readings of each position into a CSV file (tumblecal calibrate --help). "
            "calibration/calibration.html states whether the result may be used.",
            *_OWN,
        ),
    )


def _methods(study: PaperStudy) -> str:
    last = np.max(np.abs(study.exact_mean[-1] - study.mean[-1]) / study.single_sd)
    sets = len(study.single)
    sd = study.single_sd / np.sqrt(sets)
    worst = int(np.argmax(np.abs(study.exact_mean[-1] - study.truth) / sd))
    return (
        f"Simulation: {sets} data sets with the paper's parameters and 0.15 mg noise: after all of them the exact fit and "
        f"the running mean of linear least squares differ by at most {last:.3f} sd of one set, so the small-angle "
        f"equations are good enough at these magnitudes. The exact fit's largest error is "
        f"{abs(study.exact_mean[-1] - study.truth)[worst] / sd[worst]:.1f} of its sd ({study.names[worst]})."
    )


def _filter(study: PaperStudy) -> str:
    mean, informed, tight = (
        study.early_error[name] for name in ("running mean", "Kalman, prior sd 0.001", "Kalman, prior sd 0.0003")
    )
    return (
        f"Kalman filter: with a diffuse prior and constant R it is the running mean of least squares: at no data set do "
        f"the two differ by more than {study.kalman_is_running_mean:.1e} sd. Any faster start is the prior's doing: with a "
        f"prior sd of 1e-3 the rms error after one set is {informed[0]:.2f} sd of a set ({mean[0]:.2f} for least squares), "
        f"after {len(mean)} sets {informed[-1]:.2f} ({mean[-1]:.2f}); with 0.3e-3, tighter than the errors really are, "
        f"{tight[0]:.2f} and {tight[-1]:.2f}. The paper's claim that the filter converges faster is a statement about its "
        f"prior, which it does not give."
    )


def _table1(fit: Fit) -> str:
    rms = np.sqrt(np.mean(fit.residuals**2)) * 1e3
    weakest = fit.identifiability.weak[0].words if fit.identifiability and fit.identifiability.weak else "none"
    return (
        f"Table 1, exact fit: residual rms {rms:.4f} mg, noise sd {fit.sigma * 1e3:.4f} mg on {fit.dof} degrees of freedom. "
        f"The weakest direction of the plan is {weakest}: the x axis lies along the spindle and only ever sees 0 to -1 g. "
        f"A second mounting, turned by 90 degrees, cures that (configs/remount.toml)."
    )


def _explained(audit: Audit) -> str:
    truth = audit.explanations[0]
    return (
        f'Which parameters made Table 1: the {truth.name} explains the "measured" table: F = {truth.f:.2f} on '
        f"{truth.dof[0]} and {truth.dof[1]} degrees of freedom, p = {truth.p_value:.2f}."
        + (
            " By this test Table 1 cannot be told from data simulated with those parameters."
            if truth.p_value > 0.05
            else ""
        )
    )


def _published(audit: Audit, table1: Fit) -> str:
    run = audit.explanations[1]
    largest, smallest = audit.published_extremes_g
    return (
        f"Published result: that of the run ({run.name}) does not explain it: F = {run.f:.0f}, p = {run.p_value:.1e}. Its "
        f"residuals on Table 1 reach {run.largest_g * 1e3:+.1f} and {run.smallest_g * 1e3:+.1f} mg; the paper's Table 3 "
        f"states {largest * 1e3:+.2f} and {smallest * 1e3:+.2f} mg for the run, the best fit reaches "
        f"{table1.residuals.max() * 1e3:+.2f} and {table1.residuals.min() * 1e3:+.2f} mg."
    )


def _noise(audit: Audit) -> str:
    noise = audit.noise
    verdict = "Table 1 is quieter than the stated instrument." if noise.p_value < 0.01 else "The two agree."
    return (
        f"Noise: the paper states an sd of 1.2 mg over 1 s and 0.7 mg over 100 s. Over a dwell of 20 minutes that leaves "
        f"{noise.white_g * 1e3:.2f} mg if the noise is white beyond 100 s, {noise.flicker_g * 1e3:.2f} mg if the 100 s "
        f"figure is a floor. The residuals of Table 1 show {noise.observed_g * 1e3:.3f} mg (p = {noise.p_value:.1e} against "
        f"the smaller of the two). {verdict}"
    )


def _units(audit: Audit) -> str:
    return (
        f"Units: the header of Table 1 says m/s^2; the mean norm of its rows is {audit.norm_g:.4f}. At rest it must be "
        f"1 g: the numbers are g (as m/s^2 they would be {audit.norm_if_ms2_g:.4f} g)."
    )

"""A calibration in words: its noise, agreement of the methods, and further measurements that would improve it."""

from collections.abc import Iterator

import numpy as np

from tumblecal.estimation.attitudes import attitude_words
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.methods import Calibrated
from tumblecal.estimation.noise_level import UNLIKELY, ContradictedLevel
from tumblecal.estimation.problem import default_chain
from tumblecal.ground.numbers_shown import p_words
from tumblecal.ground.suggested_command import suggested


TITLES = {"exact": "exact", "harmonic": "harmonic", "kalman": "Kalman", "iterated": "iterated Kalman"}
# Differences of another method from the exact fit, in standard uncertainties: negligible, and wrong for these data.
_AGREES, _WRONG = 0.3, 2.0
_WHY = {
    "harmonic": "the small-angle approximation fails, or the weights differ between positions",
    "kalman": "the small-angle approximation fails, or the filter still depends on its starting values",
    "iterated": "the filter has not converged from its starting values",
}
_INDEPENDENT = "it assumes independent positions, but the noise of the recording is correlated"

# For residuals above the noise, consistent with it, and below it.
_OF_STATED = (
    "the residuals exceed the stated noise, so the model or the stated sd is wrong; run: {diagnose}",
    "the residuals are consistent with the stated noise",
    "the residuals are smaller than the stated noise, so the stated sd is too large",
)
_OF_RECORDING = (
    "the residuals exceed the noise within the dwells: the model is wrong, or positions repeat worse than the recording "
    "shows; run: {diagnose}",
    "the residuals are consistent with the noise of the recording",
    "the residuals are smaller: slow noise that such short dwells cannot exclude is included in full, so all uncertainties are "
    "conservative (to reduce them, use longer dwells, or state white noise by --noise-sd)",
)


def methods_words(calibrated: Calibrated) -> Iterator[str]:
    """Largest difference of each other method from the exact fit, and whether to use its values."""
    for name, farthest, parameter in distances(calibrated):
        title = TITLES[name]
        if farthest <= _AGREES:
            yield f"{title}: agrees with the exact fit within {farthest:.2g} u"
        elif farthest <= _WRONG:
            yield f"{title}: differs by up to {farthest:.2g} u from the exact fit ({parameter}); use the exact fit"
        else:
            why = _why_far(name, calibrated.exact)
            yield f"{title}: differs by {farthest:.3g} u from the exact fit ({parameter}): do not use it for these data; {why}"


def _why_far(method: str, exact: Fit) -> str:
    """Why another method differs from the exact fit: terms that it lacks, otherwise its approximation."""
    problem = exact.problem
    if problem.correlated:
        return _INDEPENDENT
    linear = {leaf.name for leaf in default_chain(exact.data).parameters}
    more = [leaf for leaf in problem.chain.parameters if leaf.name not in linear and (leaf.free or np.any(leaf.value))]
    if more and method in ("harmonic", "kalman"):
        return f"its linear equations do not include {', '.join(leaf.name for leaf in more)}"
    return "only the exact fit uses the stated priors" if problem.with_prior else _WHY[method]


def wrong_methods(calibrated: Calibrated) -> list[str]:
    """Titles of the methods whose values must not be used for these data."""
    return [TITLES[name] for name, farthest, _ in distances(calibrated) if farthest > _WRONG]


def remedy_words(fit: Fit) -> str:
    """An instruction that would determine the weakest direction, without a full stop; "" if none is known."""
    weak = fit.identifiability.weak if fit.identifiability else ()
    if weak and fit.data.hand_held:
        words = attitude_words(fit.data.readings)
        return f"measure further attitudes: {words}" if words else ""
    if not weak or not any("_x" in name for name in weak[0].coefficients):
        return ""
    return "repeat the measurement with the triad rotated by 90 degrees in its fixture, or at negative pitch angles"


def distances(calibrated: Calibrated) -> Iterator[tuple[str, float, str]]:
    """Each other method, its largest difference from the exact fit in standard uncertainties of that, and the parameter."""
    exact = calibrated.exact
    for name, result in calibrated.fits.items():
        if name == "exact":
            continue
        common = [k for k in exact.shared if exact.names[k] in result.names and exact.sd[k] > 0]
        if common:
            differences = [abs(result.value(exact.names[k]) - exact.values[k]) / exact.sd[k] for k in common]
            yield name, float(np.max(differences)), exact.names[common[int(np.argmax(differences))]]


def noise_words(result: Fit, level: ContradictedLevel | None = None) -> str:
    """Size of the noise, and agreement of the residuals with it; `level`: the stated one, if the residuals contradict it."""
    if level is not None:
        where = f"; run: {suggested('diagnose', *result.data.as_arguments)}" if level.too_small else ""
        return f"noise: {level.words}{where}"
    if not result.dof > 0:
        whose = (
            "of the recording"
            if result.problem.correlated
            else "not known"
            if result.noise == "estimated"
            else "stated"
        )
        return f"noise: {whose}; goodness of fit cannot be tested: {result.no_freedom_words}"
    if result.noise == "estimated":
        return f"noise: sd {result.sigma * 1e3:.4f} mg, estimated from the residuals (intervals by Student's t)"
    p_value, ratio = result.chi2_p_value or 0.0, result.chi2 / result.dof
    whose, judged = ("of the recording", _OF_RECORDING) if result.problem.correlated else (_stated(result), _OF_STATED)
    words = judged[0 if p_value <= UNLIKELY else 1 if p_value < 1 - UNLIKELY else 2].format(
        diagnose=suggested("diagnose", *result.data.as_arguments)
    )
    return f"noise: {whose}; chi2/dof {ratio:{'.3f' if ratio < 1e5 else '.3g'}}, {p_words(p_value)}: {words}"


def _stated(result: Fit) -> str:
    """That the noise is stated, and whether sd columns of few samples are pooled."""
    data, counted = result.data, result.data.weighing_sd
    if data.n is None or counted is None or counted is data.sd or not np.array_equal(result.problem.sd, counted):
        return "stated"
    return f"stated, with sd columns of {np.median(data.n):g} samples a position, pooled"

"""A calibration in words: its noise, which of the methods to believe, and what would determine it better."""

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
# Of the other methods: no matter below this many sd, wrong for these data above that many.
_AGREES, _WRONG = 0.3, 2.0
_WHY = {
    "harmonic": "small angles are not small enough here, or the positions are not weighed alike",
    "kalman": "small angles are not small enough here, or it has not forgotten where it started",
    "iterated": "it has not settled from where it started",
}
_INDEPENDENT = "it takes the positions as independent, which by the recording's noise model they are not"

# Of residuals that are larger than the noise allows, as large, and smaller.
_OF_STATED = (
    "the residuals are larger than the stated noise allows: the model or the stated sd is wrong; run: {diagnose}",
    "the residuals are as large as the stated noise allows",
    "the residuals are smaller than the stated noise: the stated sd is too large",
)
_OF_RECORDING = (
    "the residuals are larger than the noise within the dwells: the model is wrong, or positions differ by more than the "
    "recording shows; run: {diagnose}",
    "the residuals are as large as the noise that the recording shows",
    "the residuals are smaller: slow noise that such short dwells cannot rule out is counted in full, so every sd is on the "
    "safe side (longer dwells, or a noise known to be white by --noise-sd, make it smaller)",
)


def methods_words(calibrated: Calibrated) -> Iterator[str]:
    """Of each other method how far it is from the exact fit, and whether to believe it."""
    for name, farthest, parameter in distances(calibrated):
        title = TITLES[name]
        if farthest <= _AGREES:
            yield f"{title}: agrees with the exact fit to {farthest:.2g} sd"
        elif farthest <= _WRONG:
            yield f"{title}: up to {farthest:.2g} sd from the exact fit ({parameter}); take the exact fit"
        else:
            why = _why_far(name, calibrated.exact)
            yield f"{title}: {farthest:.3g} sd from the exact fit ({parameter}): do not take it for these data; {why}"


def _why_far(method: str, exact: Fit) -> str:
    """Why another method is far from the exact fit: what it lacks, else what it takes as small."""
    problem = exact.problem
    if problem.correlated:
        return _INDEPENDENT
    linear = {leaf.name for leaf in default_chain(exact.data).parameters}
    more = [leaf for leaf in problem.chain.parameters if leaf.name not in linear and (leaf.free or np.any(leaf.value))]
    if more and method in ("harmonic", "kalman"):
        return (
            f"the linear equations have no place for {', '.join(leaf.name for leaf in more)}, which the exact fit takes"
        )
    return "the stated priors are in the exact fit alone" if problem.with_prior else _WHY[method]


def wrong_methods(calibrated: Calibrated) -> list[str]:
    """Titles of the methods whose values are not to be taken for these data."""
    return [TITLES[name] for name, farthest, _ in distances(calibrated) if farthest > _WRONG]


def cure_words(fit: Fit) -> str:
    """What would determine the weakest direction, where that is known; else empty."""
    weak = fit.identifiability.weak if fit.identifiability else ()
    if weak and fit.data.hand_held:
        words = attitude_words(fit.data.readings)
        return f"measure also: {words}" if words else ""
    if not weak or not any("_x" in name for name in weak[0].coefficients):
        return ""
    return "measure also with the triad turned 90 degrees in its fixture, or at negative pitch angles"


def distances(calibrated: Calibrated) -> Iterator[tuple[str, float, str]]:
    """Each other method, its farthest parameter from the exact fit in the exact fit's sd, and which that is."""
    exact = calibrated.exact
    for name, result in calibrated.fits.items():
        if name == "exact":
            continue
        common = [k for k in exact.shared if exact.names[k] in result.names and exact.sd[k] > 0]
        if common:
            apart = [abs(result.value(exact.names[k]) - exact.values[k]) / exact.sd[k] for k in common]
            yield name, float(np.max(apart)), exact.names[common[int(np.argmax(apart))]]


def noise_words(result: Fit, level: ContradictedLevel | None = None) -> str:
    """How large the noise is, and what the residuals say of it; `level`: the stated one, if they contradict it."""
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
        return f"noise: {whose}; nothing can be judged: {result.no_freedom_words}"
    if result.noise == "estimated":
        return f"noise: sd {result.sigma * 1e3:.4f} mg, estimated from the residuals (intervals by Student's t)"
    p_value, ratio = result.chi2_p_value or 0.0, result.chi2 / result.dof
    whose, judged = ("of the recording", _OF_RECORDING) if result.problem.correlated else (_stated(result), _OF_STATED)
    said = judged[0 if p_value <= UNLIKELY else 1 if p_value < 1 - UNLIKELY else 2].format(
        diagnose=suggested("diagnose", *result.data.as_arguments)
    )
    return f"noise: {whose}; chi2/dof {ratio:{'.3f' if ratio < 1e5 else '.3g'}}, {p_words(p_value)}: {said}"


def _stated(result: Fit) -> str:
    """That the noise is stated, and that sd columns of few samples count together."""
    data, counted = result.data, result.data.weighing_sd
    if data.n is None or counted is None or counted is data.sd or not np.array_equal(result.problem.sd, counted):
        return "stated"
    return f"stated, by {np.median(data.n):g} samples a position, whose sds count together"

"""A calibration in words: whether to trust it and why, and which of the methods to believe."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tumblecal.estimation.attitudes import attitude_words
from tumblecal.estimation.contradicted import outlying_reading, priors_p_value
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.methods import Calibrated
from tumblecal.estimation.noise_level import UNLIKELY, ContradictedLevel
from tumblecal.estimation.plausibility import implausible_words
from tumblecal.estimation.problem import default_chain
from tumblecal.ground.numbers_shown import p_words
from tumblecal.ground.suggested_command import suggested
from tumblecal.report.gravity_words import gravity_warning
from tumblecal.report.sensor_terms import left_of_fit
from tumblecal.report.setting_words import many_settings_words


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


@dataclass(frozen=True)
class Judgement:
    """`tone` as of a page (good, open, bad), `headline` in a line, and what to do where it is not good; `refused`: whether the
    values are none, so that no certificate is made of them."""

    tone: str
    headline: str
    advice: str = ""
    refused: bool = False


def judgement(calibrated: Calibrated) -> Judgement:
    """Whether the exact fit is to be trusted, by what the data themselves say."""
    exact = calibrated.exact
    diagnose = f"run: {suggested('diagnose', *exact.data.as_arguments)}"
    if not exact.code.good:
        return Judgement(
            "bad", "Do not use it: the exact fit did not converge.", f"{exact.message}; {diagnose}", refused=True
        )
    if exact.identifiability and exact.identifiability.nearly_singular:
        weakest = exact.identifiability.weak[0]
        return Judgement(
            "bad",
            f"Do not use it: these positions hardly determine {weakest.words} (sd {weakest.sd_ratio:.0f} times a typical one).",
            _more_attitudes(exact),
            refused=True,
        )
    if calibrated.implausible:
        headline = "Do not use it: it needs parameters that no instrument has."
        return Judgement("bad", headline, f"look to the set-up; {diagnose}", refused=True)
    if calibrated.floor is not None:
        return Judgement(
            "open",
            "Not yet: the positions scatter by more than their sd columns say.",
            f"{calibrated.floor.words} Run: {suggested('diagnose', *exact.data.as_arguments)}",
        )
    p_value, level = exact.chi2_p_value, calibrated.level
    noise = "the recording's noise" if exact.problem.correlated else "the stated noise"
    ratio = level.ratio if level is not None else exact.chi2 / exact.dof if p_value is not None else 1.0
    if (level is not None and level.too_small) or (p_value is not None and p_value < UNLIKELY):
        size = f"{ratio:.3g} times what {noise} allows"
        return Judgement("bad", f"Not yet: the residuals (chi2/dof) are {size}: model or noise is wrong.", diagnose)
    contradicted = priors_p_value(exact)
    if contradicted is not None and contradicted < UNLIKELY:
        return Judgement(
            "bad",
            f"Not yet: what is stated of parameters and what the data say contradict each other ({p_words(contradicted)}).",
            f"look at --prior, --head and the rig's priors; without them {diagnose}",
        )
    far = outlying_reading(exact)
    if far is not None and far.p_value < UNLIKELY:
        said = "the stated noise" if exact.problem.known else "what the others leave"
        return Judgement(
            "open",
            f"Not yet: position {far.position}, axis {far.axis} is off by {far.sds:.3g} sd of {said}.",
            f"look at that position in the log, measure it again or leave it out; {diagnose}",
        )
    gravity = exact.data.gravity
    if gravity is not None and gravity.assumed:
        return Judgement(
            "open", "Usable but for the scale factors: the gravity of the site is not stated.", "give --gravity"
        )
    if level is not None:
        return Judgement(
            "open",
            "Usable: the residuals are smaller than the stated noise, so the uncertainties use the level that they show.",
            "state the sd of what a row holds (of a mean, not of a sample); a wrong model may hide below a noise too large",
        )
    if p_value is None and exact.dof <= 0:
        return Judgement("open", f"Not tested: {exact.no_freedom_words}.", "measure more positions")
    if p_value is None:
        return Judgement(
            "good",
            "Usable as far as the data tell: no stated noise judges the residuals.",
            f"state the noise (sd columns, --noise-sd), or {diagnose}",
        )
    return Judgement("good", f"Usable: the residuals are what {noise} makes.")


def _more_attitudes(fit: Fit) -> str:
    """What to measure where the positions hardly determine a direction."""
    if fit.data.hand_held:
        return cure_words(fit) or "measure in attitudes that differ in all directions"
    return cure_words(fit) or "measure at more pitch settings or spindle angles"


def warning_words(calibrated: Calibrated) -> Iterator[str]:
    """What a reader of the numbers alone must know: why not to use them, what was put right, a gravity that nobody stated."""
    judged, gravity = judgement(calibrated), gravity_warning(calibrated.exact)
    if judged.tone == "bad" or calibrated.floor is not None:
        yield f"{judged.headline} {judged.advice}"
    yield from (f"IMPLAUSIBLE: {words}" for words in implausible_words(calibrated.implausible))
    yield from (f"put right: {mix_up.told}" for mix_up in calibrated.mix_ups)
    if gravity:
        yield gravity
    yield from left_of_fit(calibrated.exact, calibrated.entries, of_sensor=True)
    if many := many_settings_words(calibrated.exact):
        yield many


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

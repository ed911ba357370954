"""Judgements on a calibration by its data, and the use of it that they allow."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from scipy import special

from tumblecal.data.calibration_use import YES, Use, combined
from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.estimation.contradicted import priors_p_value
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.intrinsic import one_sensor
from tumblecal.estimation.methods import Calibrated
from tumblecal.estimation.plausibility import implausible_words
from tumblecal.ground.counted import shortened
from tumblecal.ground.numbers_shown import p_words
from tumblecal.ground.suggested_command import suggested
from tumblecal.ground.units import in_words
from tumblecal.report.calibration_limits import gravity_use, limits, undetermined_use
from tumblecal.report.calibration_words import UNLIKELY, gravity_warning, many_settings_words, remedy_words
from tumblecal.report.sensor_terms import lacking_of_fit, terms_of_chain
from tumblecal.report.verdict import as_sentence


# A calibration must not be used if the residuals exceed the stated noise by this factor (eight ninths of their mean square are
# then no noise), or if excluding a contradicted position moves a parameter by more than so many standard uncertainties.
MOST_TIMES_NOISE, MOST_MOVED_SD = 3.0, 3.0
_TONES = ("bad", "open", "good")


@dataclass(frozen=True)
class Judgement:
    """One judgement: `tone` (good, open, bad), `headline` in a line, and `advice`: instructions if the tone is not good.

    - `use`: the use that it allows. `refused`: whether no certificate is made of the calibration.
    """

    tone: str
    headline: str
    advice: str = ""
    use: Use = YES
    refused: bool = False

    @property
    def finding(self) -> str:
        """The headline without the use before its colon (`Usable: ...`, `Do not use it: ...`)."""
        return self.headline.partition(": ")[2].removesuffix(".") or self.headline.removesuffix(".")

    @property
    def words(self) -> str:
        """Headline and advice."""
        return f"{self.headline} {self.advice}".rstrip()

    def record(self) -> dict[str, Any]:
        """As `result.json` has it."""
        texts = {"tone": self.tone, "headline": self.headline, "advice": self.advice, "refused": self.refused}
        return texts | {"use": self.use.record()}


def judgements(calibrated: Calibrated) -> list[Judgement]:
    """Judgements on the exact fit, the most serious first; never empty."""
    if not calibrated.exact.code.good:
        return [_not_converged(calibrated)]
    found = [judged for rule in _RULES for judged in rule(calibrated)] or [_good(calibrated)]
    return sorted(found, key=lambda judged: (not judged.use.refused, _TONES.index(judged.tone)))


def use_of(calibrated: Calibrated, judged: list[Judgement] | None = None) -> Use:
    """Whether the calibration may be used: the strictest of all judgements (`judged`, if known already) and limits."""
    judged = judgements(calibrated) if judged is None else judged
    uses, exact = [judgement.use for judgement in judged], calibrated.exact
    if exact.code.good:
        uses += limits(exact, terms_of_chain(exact, exact.problem.chain, calibrated.entries))
    return combined(uses)


def warning_words(calibrated: Calibrated) -> Iterator[str]:
    """Warnings for a reader of the numbers alone: judgements that are not good, implausible values, corrected set-up errors, an
    assumed gravity."""
    gravity = gravity_warning(calibrated.exact)
    yield from (
        judged.words for judged in judgements(calibrated) if judged.tone != "good" and judged.headline != _NO_GRAVITY
    )
    yield from (f"IMPLAUSIBLE: {words}" for words in implausible_words(calibrated.implausible))
    yield from (f"corrected: {setup_error.description}" for setup_error in calibrated.setup_errors)
    if gravity:
        yield gravity
    yield from lacking_of_fit(calibrated.exact, calibrated.entries, of_sensor=True)
    if many := many_settings_words(calibrated.exact):
        yield many


# The gravity itself is stated in full by `gravity_warning`.
_NO_GRAVITY = "Usable except for the scale factors: the gravity of the site is not stated."


def _diagnose(calibrated: Calibrated) -> str:
    return f"Run: {suggested('diagnose', *calibrated.exact.data.as_arguments)}"


def _judged(
    use: Use, finding: str = "", advice: str = "", *, prefix: str = "", tone: str = "", refused: bool = False
) -> Judgement:
    """The judgement with this use; by default its finding is the reason of the use, and prefix and tone follow from the use."""
    headline = f"{prefix or _PREFIXES[use.answer or 'yes']}: {finding or use.reason}."
    return Judgement(tone or ("bad" if use.answer == "no" else "open"), headline, advice, use, refused)


_PREFIXES = {"no": "Do not use it", "only": "Usable only in part", "yes": "Usable"}


def _not_converged(calibrated: Calibrated) -> Judgement:
    advice = f"{calibrated.exact.message}. {_diagnose(calibrated)}"
    return _judged(Use("no", "the exact fit did not converge"), advice=advice, refused=True)


def _positions(calibrated: Calibrated) -> Iterator[Judgement]:
    """Exchanged rows and outlier positions."""
    noise = "of the stated noise" if calibrated.exact.problem.known else "of the other residuals"
    for found in calibrated.contradicted:
        if found.exchanged:
            first, second = found.positions
            fault = (
                f"the readings of positions {first} and {second} appear exchanged (as written they differ by "
                f"{found.sds:.3g} standard deviations from the prediction of all others; exchanged they agree)"
            )
            remedy = "exchange their readings or measure both again"
        else:
            size = in_words(f"{found.difference_g * 1e3:+.3g}", "mg")
            fault = (
                f"position {found.positions[0]}, axis {found.axis} differs by {size} from the prediction of the others "
                f"({found.sds:.3g} standard deviations {noise})"
            )
            remedy = "measure it again or exclude it"
        moved = f"Without the fault a parameter changes by {found.moved:.3g} u"
        use = Use("no" if found.moved > MOST_MOVED_SD else "yes", fault)
        yield _judged(use, advice=f"{moved}. Check the log; {remedy}. {_diagnose(calibrated)}")


def _poorly_determined(calibrated: Calibrated) -> Iterator[Judgement]:
    exact = calibrated.exact
    if exact.identifiability is None or not exact.identifiability.nearly_singular:
        return
    weakest = exact.identifiability.weak[0]
    # The direction may belong to the set-up alone: then every parameter of the sensor may be determined.
    poorly = {name for direction in exact.identifiability.nearly_undetermined for name in direction.coefficients}
    names = tuple(name for name in SENSOR if name not in poorly)
    reason = f"these positions determine {weakest.words} poorly (uncertainty {weakest.sd_ratio:.0f} times the median)"
    partly = one_sensor(exact) and len(names) > 0
    use = Use("only", reason, parameters=names) if partly else Use("no", reason)
    prefix = "Use it only in part" if partly else ""
    yield _judged(use, advice=_more_attitudes(exact), prefix=prefix, tone="bad", refused=True)


def _implausible(calibrated: Calibrated) -> Iterator[Judgement]:
    if calibrated.implausible:
        names = shortened([unusual.parameter for unusual in calibrated.implausible], 3)
        finding = "the fit requires parameter values far outside the usual range"
        use = Use("no", f"implausible values of {names}")
        yield _judged(use, finding, f"Check the set-up. {_diagnose(calibrated)}", refused=True)


def _residuals(calibrated: Calibrated) -> Iterator[Judgement]:
    """Residuals beyond the stated noise, without those of positions that are reported separately."""
    contradicted, level = calibrated.contradicted, calibrated.level
    fit = contradicted[-1].fit if contradicted else calibrated.exact
    if not fit.dof > 0 or not (fit.problem.known or level is not None):
        return
    # If the level is estimated, whitened rows are in units of that level.
    ratio = (
        level.ratio if level is not None and not contradicted else fit.chi2 / fit.dof * (level.ratio if level else 1.0)
    )
    if special.chdtrc(fit.dof, ratio * fit.dof) >= UNLIKELY:
        return
    times = f"chi2/dof of the residuals is {ratio:.3g} for {_noise(fit)}, so the model or the noise is wrong"
    unexplained = fit.sigma * math.sqrt(max(1.0 - 1.0 / ratio, 0.0))
    refused = math.sqrt(ratio) > MOST_TIMES_NOISE
    prefix = "" if refused else f"Usable to about {in_words(f'{unexplained * 1e3:.2g}', 'mg')}"
    use = Use("no" if refused else "yes", times, size_g=unexplained or None)
    yield _judged(use, advice=_diagnose(calibrated), prefix=prefix)


def _noise(fit: Fit) -> str:
    return "the recording's noise" if fit.problem.noise_of_recording else "the stated noise"


def _dispersion(calibrated: Calibrated) -> Iterator[Judgement]:
    # An outlier position increases the residuals of the others.
    if calibrated.floor is not None and not calibrated.contradicted:
        reason = "the dispersion of the positions exceeds their sd columns"
        use, advice = (
            Use("yes", f"{reason} (its uncertainties include this)"),
            f"{calibrated.floor.words} {_diagnose(calibrated)}",
        )
        yield _judged(use, reason, advice, prefix="Usable, with this dispersion in its uncertainties")


def _priors(calibrated: Calibrated) -> Iterator[Judgement]:
    p_value = priors_p_value(calibrated.exact)
    if p_value is not None and p_value < UNLIKELY and not calibrated.implausible:
        use = Use("no", f"stated parameter values and data contradict each other ({p_words(p_value)})")
        yield _judged(use, advice=f"Check --prior, --head and the rig's priors. {_diagnose(calibrated)}")


def _gravity(calibrated: Calibrated) -> Iterator[Judgement]:
    for use in gravity_use(calibrated.exact):
        yield Judgement("open", _NO_GRAVITY, "State it by --gravity.", use)


def _undetermined(calibrated: Calibrated) -> Iterator[Judgement]:
    for use in undetermined_use(calibrated.exact):
        yield _judged(use, advice=_more_attitudes(calibrated.exact), prefix=_PREFIXES["only"], tone="open")


def _too_small(calibrated: Calibrated) -> Iterator[Judgement]:
    level = calibrated.level
    if level is not None and not level.too_small:
        yield _judged(
            Use("yes", "the residuals are smaller than the stated noise"),
            "the residuals are smaller than the stated noise, so the uncertainties use the level that they show",
            "State the sd of the values in a row (of a mean, not of a sample). Too large a noise may hide a wrong model.",
        )


def _good(calibrated: Calibrated) -> Judgement:
    exact = calibrated.exact
    if exact.chi2_p_value is not None:
        return Judgement("good", f"Usable: the residuals are consistent with {_noise(exact)}.")
    if exact.dof <= 0:
        use = Use("yes", f"not tested: {exact.no_freedom_words}")
        return _judged(use, exact.no_freedom_words, "Measure more positions.", prefix="Not tested")
    return _judged(
        Use("yes", "goodness of fit not tested"),
        "no noise level was stated, so goodness of fit could not be tested",
        f"State the noise (sd columns, --noise-sd), or run: {_diagnose(calibrated).partition(': ')[2]}",
        prefix="Usable, with one reservation",
        tone="good",
    )


def _more_attitudes(fit: Fit) -> str:
    """What to measure if the positions determine a direction poorly."""
    further = (
        "attitudes that differ in all directions" if fit.data.hand_held else "more pitch settings or spindle angles"
    )
    return f"{as_sentence(remedy_words(fit) or f'measure at {further}')}."


_RULES: tuple[Callable[[Calibrated], Iterator[Judgement]], ...] = (
    _positions,
    _poorly_determined,
    _implausible,
    _residuals,
    _priors,
    _dispersion,
    _gravity,
    _undetermined,
    _too_small,
)

"""The judgements on a calibration, by its data, and the use that follows from them."""

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
from tumblecal.estimation.leave_out import Contradicted
from tumblecal.estimation.methods import Calibrated
from tumblecal.estimation.plausibility import implausible_words
from tumblecal.ground.numbers_shown import p_words
from tumblecal.ground.suggested_command import suggested
from tumblecal.ground.units import in_words
from tumblecal.report.calibration_limits import gravity_use, limits, undetermined_use
from tumblecal.report.calibration_words import UNLIKELY, cure_words
from tumblecal.report.gravity_words import gravity_warning
from tumblecal.report.sensor_terms import lacking_of_fit, terms_of_chain
from tumblecal.report.setting_words import many_settings_words


# A calibration is not to be used from this ratio of the residuals to the stated noise on: eight ninths of their mean square are
# then something other than noise. And if leaving a contradicted position out moves a parameter by more than so many of its sd.
MOST_TIMES_NOISE, MOST_MOVED_SD = 3.0, 3.0
_TONES = ("bad", "open", "good")


@dataclass(frozen=True)
class Judgement:
    """One judgement: `tone` as of a page (good, open, bad), `headline` in a line, and what to do where it is not good.

    - `use`: what it allows of the calibration. `refused`: whether no certificate is made of it.
    """

    tone: str
    headline: str
    advice: str = ""
    use: Use = YES
    refused: bool = False

    @property
    def finding(self) -> str:
        """The headline without what it means for the use (`Usable: ...`, `Do not use it: ...`)."""
        return self.headline.partition(": ")[2].removesuffix(".") or self.headline.removesuffix(".")

    @property
    def words(self) -> str:
        """Headline and advice."""
        return f"{self.headline} {self.advice}".rstrip()

    def record(self) -> dict[str, Any]:
        """As `result.json` has it."""
        said = {"tone": self.tone, "headline": self.headline, "advice": self.advice, "refused": self.refused}
        return said | {"use": self.use.record()}


def judgements(calibrated: Calibrated) -> list[Judgement]:
    """What the data say of the exact fit, the gravest first; never empty."""
    if not calibrated.exact.code.good:
        return list(_not_converged(calibrated))
    found = [judged for rule in _RULES for judged in rule(calibrated)] or list(_good(calibrated))
    return sorted(found, key=lambda judged: (not judged.use.refused, _TONES.index(judged.tone)))


def use_of(calibrated: Calibrated, judged: list[Judgement] | None = None) -> Use:
    """Whether the calibration may be used: the strictest of all judgements (`judged`, where made already) and limits."""
    judged = judgements(calibrated) if judged is None else judged
    uses, exact = [judgement.use for judgement in judged], calibrated.exact
    if exact.code.good:
        uses += limits(exact, terms_of_chain(exact, exact.problem.chain, calibrated.entries))
    return combined(uses)


def warning_words(calibrated: Calibrated) -> Iterator[str]:
    """What a reader of the numbers alone must know: every judgement that is not good, why values are implausible, what was put
    right, a gravity that nobody stated."""
    gravity = gravity_warning(calibrated.exact)
    yield from (judged.words for judged in judgements(calibrated) if judged.tone != "good" and not _of_gravity(judged))
    yield from (f"IMPLAUSIBLE: {words}" for words in implausible_words(calibrated.implausible))
    yield from (f"put right: {setup_error.description}" for setup_error in calibrated.setup_errors)
    if gravity:
        yield gravity
    yield from lacking_of_fit(calibrated.exact, calibrated.entries, of_sensor=True)
    if many := many_settings_words(calibrated.exact):
        yield many


def _of_gravity(judged: Judgement) -> bool:
    """Whether it is of the gravity, which `gravity_warning` tells at length."""
    return judged.headline == _NO_GRAVITY


_NO_GRAVITY = "Usable but for the scale factors: the gravity of the site is not stated."


def _diagnose(calibrated: Calibrated) -> str:
    return f"run: {suggested('diagnose', *calibrated.exact.data.as_arguments)}"


def _not_converged(calibrated: Calibrated) -> Iterator[Judgement]:
    exact = calibrated.exact
    yield Judgement(
        "bad",
        "Do not use it: the exact fit did not converge.",
        f"{exact.message}; {_diagnose(calibrated)}",
        Use("no", "the exact fit did not converge"),
        refused=True,
    )


def _positions(calibrated: Calibrated) -> Iterator[Judgement]:
    """Exchanged rows and outlier positions."""
    exact = calibrated.exact
    said = "the stated noise" if exact.problem.known else "what the others leave"
    for found in calibrated.contradicted:
        matters = found.moved > MOST_MOVED_SD
        what = _exchanged_words(found) if found.exchanged else _outlier_words(found, said)
        advice = (
            "exchange their readings, or measure both again" if found.exchanged else "measure it again or leave it out"
        )
        moved = f"without the fault a parameter moves by {found.moved:.3g} of its sd"
        yield Judgement(
            "bad" if matters else "open",
            f"{'Do not use it' if matters else 'Usable'}: {what}.",
            f"{moved}; look at the log, {advice}; {_diagnose(calibrated)}",
            Use("no", what) if matters else Use("yes", what),
        )


def _exchanged_words(found: Contradicted) -> str:
    first, second = found.positions
    return (
        f"the readings of positions {first} and {second} appear exchanged (as they are written they differ by "
        f"{found.sds:.3g} sd from what all others predict, exchanged they agree)"
    )


def _outlier_words(found: Contradicted, said: str) -> str:
    (position,) = found.positions
    size = in_words(f"{found.difference_g * 1e3:+.3g}", "mg")
    return (
        f"position {position}, axis {found.axis} differs by {size} from what the others predict ({found.sds:.3g} sd of {said})"
    )  # fmt: skip


def _hardly_determined(calibrated: Calibrated) -> Iterator[Judgement]:
    exact = calibrated.exact
    if exact.identifiability is None or not exact.identifiability.nearly_singular:
        return
    weakest = exact.identifiability.weak[0]
    # Along a direction that is not of the sensor, every parameter of it may be determined.
    poorly = {name for direction in exact.identifiability.nearly_undetermined for name in direction.coefficients}
    names = tuple(name for name in SENSOR if name not in poorly)
    reason = f"these positions hardly determine {weakest.words} (sd {weakest.sd_ratio:.0f} times a typical one)"
    partly = one_sensor(exact) and len(names) > 0
    yield Judgement(
        "bad",
        f"{'Use it only in part' if partly else 'Do not use it'}: {reason}.",
        _more_attitudes(exact),
        Use("only", reason, parameters=names) if partly else Use("no", reason),
        refused=True,
    )


def _implausible(calibrated: Calibrated) -> Iterator[Judgement]:
    if calibrated.implausible:
        names = ", ".join(unusual.parameter for unusual in calibrated.implausible[:3])
        more = f" and {len(calibrated.implausible) - 3} more" if len(calibrated.implausible) > 3 else ""
        yield Judgement(
            "bad",
            "Do not use it: it needs parameters that no instrument has.",
            f"look to the set-up; {_diagnose(calibrated)}",
            Use("no", f"implausible values of {names}{more}"),
            refused=True,
        )


def _residuals(calibrated: Calibrated) -> Iterator[Judgement]:
    """Residuals beyond the stated noise, but for those of positions that are reported by themselves."""
    contradicted, level = calibrated.contradicted, calibrated.level
    fit = contradicted[-1].fit if contradicted else calibrated.exact
    if not fit.dof > 0 or not (fit.problem.known or level is not None):
        return
    noise = "the recording's noise" if fit.problem.correlated else "the stated noise"
    # At an estimated level white rows are in units of that level.
    ratio = (
        level.ratio if level is not None and not contradicted else fit.chi2 / fit.dof * (level.ratio if level else 1.0)
    )
    if special.chdtrc(fit.dof, ratio * fit.dof) >= UNLIKELY:
        return
    times = f"the residuals (chi2/dof) are {ratio:.3g} times what {noise} allows: model or noise is wrong"
    unexplained = fit.sigma * math.sqrt(max(1.0 - 1.0 / ratio, 0.0))
    refused = math.sqrt(ratio) > MOST_TIMES_NOISE
    size = in_words(f"{unexplained * 1e3:.2g}", "mg")
    yield Judgement(
        "bad" if refused else "open",
        f"Not yet: {times}." if refused else f"Usable to about {size}: {times}.",
        _diagnose(calibrated),
        Use("no" if refused else "yes", times, size_g=unexplained or None),
    )


def _scatter(calibrated: Calibrated) -> Iterator[Judgement]:
    # A position in error makes the others' scatter.
    if calibrated.floor is not None and not calibrated.contradicted:
        reason = "the positions scatter by more than their sd columns say"
        yield Judgement(
            "open",
            f"Usable, with the scatter in its uncertainties: {reason}.",
            f"{calibrated.floor.words} R{_diagnose(calibrated)[1:]}",
            Use("yes", f"{reason} (this is included in its uncertainties)"),
        )


def _priors(calibrated: Calibrated) -> Iterator[Judgement]:
    p_value = priors_p_value(calibrated.exact)
    if p_value is not None and p_value < UNLIKELY and not calibrated.implausible:
        reason = f"what is stated of parameters and what the data say contradict each other ({p_words(p_value)})"
        yield Judgement(
            "bad",
            f"Not yet: {reason}.",
            f"look at --prior, --head and the rig's priors; without them {_diagnose(calibrated)}",
            Use("no", reason),
        )


def _gravity(calibrated: Calibrated) -> Iterator[Judgement]:
    for use in gravity_use(calibrated.exact):
        yield Judgement("open", _NO_GRAVITY, "give --gravity", use)


def _undetermined(calibrated: Calibrated) -> Iterator[Judgement]:
    for use in undetermined_use(calibrated.exact):
        yield Judgement("open", f"Usable only in part: {use.reason}.", _more_attitudes(calibrated.exact), use)


def _too_small(calibrated: Calibrated) -> Iterator[Judgement]:
    level = calibrated.level
    if level is not None and not level.too_small:
        yield Judgement(
            "open",
            "Usable: the residuals are smaller than the stated noise, so the uncertainties use the level that they show.",
            "state the sd of what a row holds (of a mean, not of a sample); a wrong model may hide below a noise too large",
            Use("yes", "the residuals are smaller than the stated noise"),
        )


def _good(calibrated: Calibrated) -> Iterator[Judgement]:
    exact = calibrated.exact
    if exact.chi2_p_value is None and exact.dof <= 0:
        yield Judgement(
            "open",
            f"Not tested: {exact.no_freedom_words}.",
            "measure more positions",
            Use("yes", f"not tested: {exact.no_freedom_words}"),
        )
    elif exact.chi2_p_value is None:
        yield Judgement(
            "good",
            "Usable as far as the data tell: no stated noise judges the residuals.",
            f"state the noise (sd columns, --noise-sd), or {_diagnose(calibrated)}",
            Use("yes", "no stated noise judges the residuals"),
        )
    else:
        noise = "the recording's noise" if exact.problem.correlated else "the stated noise"
        yield Judgement("good", f"Usable: the residuals are what {noise} makes.")


def _more_attitudes(fit: Fit) -> str:
    """What to measure where the positions hardly determine a direction."""
    if fit.data.hand_held:
        return cure_words(fit) or "measure in attitudes that differ in all directions"
    return cure_words(fit) or "measure at more pitch settings or spindle angles"


_RULES: tuple[Callable[[Calibrated], Iterator[Judgement]], ...] = (
    _positions,
    _hardly_determined,
    _implausible,
    _residuals,
    _priors,
    _scatter,
    _gravity,
    _undetermined,
    _too_small,
)

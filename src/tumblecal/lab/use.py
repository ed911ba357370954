"""Whether a calibration may be used: findings on its data, their consequence for the use, and advice.

The data contradict the model if the residuals exceed the stated noise, if an effect of the catalogue or a single position
explains them much better, or if stated values disagree with them. The answer is then `no`, until the cause is in the
calibration. Without a contradiction the calibration may be used with the U that includes effects that the data may have
missed (`lab.missed_effects`); if no residual could show any effect, it is `not tested`.

`calibrate` (`judged`) and `diagnose` (`use_of_diagnosis`) share the limits that do not depend on residuals. Each finding is a
`Judgement`; `calibration_use.combined` takes the strictest.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_use import Answer, Judgement, Use, combined
from tumblecal.data.position_comments import identity_words
from tumblecal.data.positions import PositionSet
from tumblecal.data.sensor_parameters import SENSOR, correction_slope, triad_of
from tumblecal.estimation.attitudes import attitude_words
from tumblecal.estimation.contradicted import dof_of_readings, priors_p_value
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.intrinsic import one_sensor, sensor_of
from tumblecal.estimation.methods import Calibrated
from tumblecal.ground.errors import InputError
from tumblecal.ground.soaks import ONE_TEMPERATURE_DEGC
from tumblecal.ground.suggested_command import suggested
from tumblecal.lab.corrected_reading import DIRECTIONS, expanded_uncertainty, with_undetected
from tumblecal.lab.missed_effects import MissedEffects, missed_effects
from tumblecal.lab.terms import NOT_MISSED, SensorTerms, terms_of_chain
from tumblecal.noise.within_dwells import TEMPERATURE, changes_within_dwells
from tumblecal.words import cells, sentence


if TYPE_CHECKING:
    from tumblecal.diagnosis import Diagnosis

# Data of a correct model contradict it with this probability, in each of two tests.
CONTRADICTED = 0.0025
# Held-out predictions are worse if their error increases by more than this many standard errors.
_WORSE_SD = 2.0


def judged(calibrated: Calibrated) -> tuple[tuple[Judgement, ...], Use]:
    """Judgements on the exact fit, the most serious first (never empty), and the use that all of them and the limits allow."""
    exact = calibrated.exact
    if not exact.code.good:
        failed = _finding("no", "not_converged", message=exact.message, run=_diagnose(calibrated))
        return (failed,), failed.use
    missed = missed_effects(exact, calibrated.entries) if one_sensor(exact) and not exact.computed else None
    found = [*_findings(calibrated, missed)]
    if not found:
        unstated = exact.chi2_p_value is None
        found = [Judgement(Use("yes"), finding=sentence("use/consistent", unstated=unstated, noise=_noise(exact)))]
    seriousness = ("bad", "open", "good")
    found.sort(key=lambda judgement: (not judgement.use.refused, seriousness.index(judgement.tone)))
    terms, expanded_g = terms_of_chain(exact, exact.problem.chain, calibrated.entries), None
    if missed is not None:
        # Noise, effects that the data may have missed, and known corrections that the file lacks.
        sensor, degc = sensor_of(exact), exact.data.temperature_degc
        covariance = with_undetected(
            correction_slope(sensor.values),
            sensor.covariance + missed.undetected.covariance,
            missed.undetected,
            missed.model,
            calibrated.entries,
            exact.problem.where,
            None if degc is None else float(np.mean(degc)),
        )
        dof = exact.dof if exact.noise == "estimated" else np.inf
        expanded_g = expanded_uncertainty(np.linalg.inv(triad_of(sensor.values)), covariance, dof=dof)
        expanded_g += systematic_g(exact.data, terms)
    return tuple(found), combined([*(one.use for one in found), *limits(exact.data, terms)], expanded_g)


def _findings(calibrated: Calibrated, missed: MissedEffects | None) -> Iterator[Judgement]:
    exact, scatter, run = calibrated.exact, calibrated.scatter, _diagnose(calibrated)
    for found in calibrated.contradicted:
        kind = "exchanged" if found.exchanged else "outlier"
        yield _finding("no", kind, found=found, known=exact.problem.known, run=run)
    identifiability = exact.identifiability
    if identifiability is not None and identifiability.nearly_singular:
        # The direction may belong to the set-up alone: then every parameter of the sensor may be determined.
        poorly = {name for direction in identifiability.nearly_undetermined for name in direction.coefficients}
        determined = [name for name in SENSOR if name not in poorly and one_sensor(exact)]
        weak = {"weakest": identifiability.weak[0], "remedy": _more_attitudes(exact)}
        yield replace(_finding("only", "poorly_determined", determined, **weak), uncertified=True)
    if calibrated.implausible:
        yield _finding("no", "implausible", names=[one.parameter for one in calibrated.implausible], run=run)
    # Residuals beyond the stated noise, or that an effect explains much better; without those of reported positions.
    kind, p_value, ratio = min(_contradictions(calibrated, missed), key=lambda item: item[1], default=("", 1.0, 0.0))
    if p_value < CONTRADICTED and not calibrated.contradicted:
        noise = sentence("use/noise", recorded=False) if calibrated.level else _noise(exact)
        yield _finding("no", kind, p_value=p_value, ratio=ratio, noise=noise, run=run)
    p_value = priors_p_value(exact)
    if p_value is not None and p_value < CONTRADICTED and not calibrated.implausible:
        yield _finding("no", "priors", p_value=p_value, run=run)
    # An outlier position increases the residuals of the others.
    if calibrated.floor is not None and not calibrated.contradicted:
        yield _finding("yes", "floor", floor=calibrated.floor, run=run)
    yield from gravity_findings(exact)
    yield from undetermined_findings(exact)
    if calibrated.level is not None and not calibrated.level.too_small:
        yield _finding("yes", "small_residuals")
    unstated, assumed = exact.noise == "estimated", scatter is not None and not scatter.noise_determined
    if dof_of_readings(exact) <= 0:
        yield _finding("not tested", "no_freedom", fit=exact)
    elif missed is not None and (assumed or (missed.p_value is None and (unstated or scatter is not None))):
        yield _finding("not tested", "nothing_visible", unstated=unstated)


def _finding(answer: Answer, name: str, parameters: Sequence[str] | None = None, **values: object) -> Judgement:
    """The finding of a block of `words/sentences/use.words`; with parameters, the use of these, or none without any."""
    (entry,) = cells(f"use/{name}", **values)
    reason, advice, finding = [*entry, "", ""][:3]
    answer = "no" if parameters is not None and not parameters else answer
    return Judgement(Use(answer, reason, parameters=tuple(parameters or ())), advice, finding)


def _contradictions(calibrated: Calibrated, missed: MissedEffects | None) -> Iterator[tuple[str, float, float]]:
    """Tests of the model: the block of the finding, the p-value, chi-square over its degrees of freedom."""
    exact, level = calibrated.exact, calibrated.level
    if level is not None and level.too_small:
        yield "residuals", level.p_value, level.ratio
    elif exact.chi2_p_value is not None:
        yield "residuals", exact.chi2_p_value, exact.chi2 / exact.dof
    if missed is not None and missed.p_value is not None:
        yield "missing_effect", missed.p_value, 0.0


def _noise(exact: Fit) -> str:
    return sentence("use/noise", recorded=exact.problem.noise_of_recording)


def _diagnose(calibrated: Calibrated) -> str:
    return f"Run: {suggested('diagnose', *calibrated.exact.data.as_arguments)}"


def _more_attitudes(fit: Fit) -> str:
    """What to measure if the positions determine a direction poorly."""
    words = remedy_words(fit) or sentence("use/further_settings", hand_held=fit.data.hand_held)
    return f"{words[:1].upper()}{words[1:]}."


def remedy_words(fit: Fit) -> str:
    """An instruction that would determine the weakest direction, without a full stop; "" if none is known."""
    weak = fit.identifiability.weak if fit.identifiability else ()
    if weak and fit.chain.of_positions:
        return sentence("use/further_attitudes", attitudes=attitude_words(fit.data.readings))
    return sentence("use/turned_triad") if weak and any("_x" in name for name in weak[0].coefficients) else ""


def use_of_diagnosis(
    diagnosis: "Diagnosis",
    terms: SensorTerms,
    expanded_g: float | None = None,
    explanations: Sequence[Calibration] = (),
) -> Use:
    """Whether the calibration of the extended model may be used.

    `terms`: of the file. `expanded_g`: U of a corrected reading without known systematic errors, g. `explanations`: for an
    average over several, the calibration by each.
    """
    data, difference_g = diagnosis.data, 0.0
    uses = [*_uses_of_diagnosis(diagnosis), *limits(data, terms)]
    means = [None if column is None else float(np.mean(column)) for column in (data.temperature_degc, data.time_s)]
    try:
        # Effects that are the same in a field of 1 g agree.
        forces = [each.corrected(DIRECTIONS, *means) for each in explanations]
        difference_g = max((float(np.max(np.abs(force - forces[0]))) for force in forces), default=0.0)
    except InputError:
        uses.append(Use("no", sentence("use/not_invertible")))
    if difference_g > diagnosis.sigma_g:
        uses.append(Use("yes", sentence("use/explanations_differ")))
    else:
        difference_g = 0.0
    return combined(uses, None if expanded_g is None else expanded_g + systematic_g(data, terms) + difference_g)


def _uses_of_diagnosis(diagnosis: "Diagnosis") -> Iterator[Use]:
    """The uses that the findings allow."""
    from tumblecal.diagnosis.causes.cause import UNEXPLAINED

    best, gain = diagnosis.best, diagnosis.gain if diagnosis.members else None
    if diagnosis.implausible:
        yield _finding("no", "implausible", names=[one.parameter for one in diagnosis.implausible], run="").use
    elif diagnosis.verdict == "unexplained":
        yield Use("no", sentence("use/unexplained", p_value=diagnosis.screened.detection.p_value))
    elif (UNEXPLAINED,) in best.equivalents and 2 * best.own_probability < best.probability:
        yield Use("no", sentence("use/unlisted_more_probable", labels=best.labels))
    if dof_of_readings(diagnosis.extended) <= 0:
        yield Use("not tested", diagnosis.extended.no_freedom_words)
    of_parameters = *gravity_findings(diagnosis.extended), *undetermined_findings(diagnosis.in_use.as_fit)
    yield from (finding.use for finding in of_parameters)
    if gain and gain.cv_rms_after_g - gain.cv_rms_before_g > _WORSE_SD * max(gain.cv_gain_sd_g, 0.0):
        yield Use("no", sentence("use/predicted_worse"))
    if diagnosis.noise_wrong:
        yield Use("yes", sentence("use/corrected_noise", noises=list(diagnosis.noise_wrong)))


def limits(data: PositionSet, terms: SensorTerms) -> Iterator[Use]:
    """All limits of a calibration that do not depend on its residuals; `terms`: of its file."""
    for size_g, reason in _corrections_missing(data, terms):
        # A correction of unknown size is missing in an unknown U.
        yield Use("not tested" if size_g is None else "yes", reason)
    if words := identity_words(data):
        yield Use("yes", f"{words[:1].lower()}{words[1:]}")
    # Valid at the recorded temperatures of the measurement. A single temperature is no range: it is only stated.
    if (degc := data.temperature_degc) is not None:
        span = float(np.min(degc)), float(np.max(degc))
        if span[1] - span[0] > ONE_TEMPERATURE_DEGC:
            yield Use("within", sentence("use/outside_temperatures"), span)
        else:
            yield Use("yes", sentence("use/one_temperature", degc=float(np.mean(degc))))


def systematic_g(data: PositionSet, terms: SensorTerms) -> float:
    """The sum of the systematic errors of known size that the file does not correct, g. U includes it (JCGM 100, F.2.4.5)."""
    return sum(size_g or 0.0 for size_g, _ in _corrections_missing(data, terms))


def _corrections_missing(data: PositionSet, terms: SensorTerms) -> Iterator[tuple[float | None, str]]:
    """Each systematic error that the file does not correct: its largest size in the data (g; None: not known), and words."""
    for loss in terms.losses(data.temperature_degc):
        if loss.reason not in NOT_MISSED:
            size = loss.largest_mg
            yield size and 1e-3 * size, sentence("use/lost", loss=loss, size=size)
    for variable, change_g in changes_within_dwells(data.comments):
        if variable != TEMPERATURE or not terms.thermal:
            size = change_g and 1e3 * change_g
            yield change_g, sentence("use/within_dwells", variable=variable, size=size)


def gravity_findings(fit: Fit) -> Iterator[Judgement]:
    """Without a stated gravity the scale factors of readings in m/s^2 are not determined."""
    if fit.data.gravity is not None and fit.data.gravity.assumed:
        yield _finding("only", "gravity", [name for name in fit.names if name in SENSOR and name[:3] != "dK_"])


def undetermined_findings(fit: Fit) -> Iterator[Judgement]:
    """Parameters that the data cannot separate from an effect are not determined."""
    if missing := [name for name in fit.undetermined if name in SENSOR]:
        others = [name for name in SENSOR if name not in missing]
        yield _finding("only", "undetermined", others, names=missing, remedy=_more_attitudes(fit))

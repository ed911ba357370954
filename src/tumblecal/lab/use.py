"""Whether a calibration may be used: findings on its data, their consequence for the use, and advice.

The data contradict the model if the residuals exceed the stated noise, if an effect of the catalogue or a single position
explains them much better, or if stated values disagree with them. The answer is then `no`, until the cause is in the
calibration. Without a contradiction the calibration may be used with the U that includes effects that the data may have
missed (`lab.missed_effects`); if no residual could show any effect, it is `not tested`.

`calibrate` (`judged`) and `diagnose` (`use_of_diagnosis`) share the limits that do not depend on residuals. Each finding is a
`Judgement`; `calibration_use.combined` takes the strictest.
"""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_use import Judgement, Use, combined
from tumblecal.data.position_comments import identity_words
from tumblecal.data.positions import PositionSet
from tumblecal.data.sensor_parameters import SENSOR, correction_slope, triad_of
from tumblecal.estimation.attitudes import attitude_words
from tumblecal.estimation.contradicted import dof_of_readings, priors_p_value
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.intrinsic import one_sensor, sensor_of
from tumblecal.estimation.methods import Calibrated
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import p_words, shortened
from tumblecal.ground.soaks import ONE_TEMPERATURE_DEGC
from tumblecal.ground.suggested_command import suggested
from tumblecal.ground.units import in_words
from tumblecal.lab.corrected_reading import DIRECTIONS, expanded_uncertainty, with_undetected
from tumblecal.lab.missed_effects import MissedEffects, missed_effects
from tumblecal.lab.terms import NOT_MISSED, SensorTerms, terms_of_chain
from tumblecal.noise.within_dwells import TEMPERATURE, changes_within_dwells


if TYPE_CHECKING:
    from tumblecal.diagnosis import Diagnosis

# Data of a correct model contradict it with this probability, in each of two tests.
CONTRADICTED = 0.0025
# Held-out predictions are worse if their error increases by more than this many standard errors.
_WORSE_SD = 2.0
NO_GRAVITY = "the gravity of the site is not stated, so the scale factors are not determined"


def judged(calibrated: Calibrated) -> tuple[tuple[Judgement, ...], Use]:
    """Judgements on the exact fit, the most serious first (never empty), and the use that all of them and the limits allow."""
    exact = calibrated.exact
    if not exact.code.good:
        use = Use("no", "the exact fit did not converge")
        return (Judgement(use, f"{exact.message}. {_diagnose(calibrated)}"),), use
    missed = missed_effects(exact, calibrated.entries) if one_sensor(exact) and not exact.computed else None
    found = [*_findings(calibrated, missed)]
    if not found:
        noise = _noise(exact)
        finding = f"the residuals are consistent with {noise}"
        unstated = "no effect that is not in the model explains the residuals better (no noise is stated)"
        found = [Judgement(Use("yes"), finding=unstated if exact.chi2_p_value is None else finding)]
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
    exact, scatter, diagnose = calibrated.exact, calibrated.scatter, _diagnose(calibrated)
    yield from _positions(calibrated)
    identifiability = exact.identifiability
    if identifiability is not None and identifiability.nearly_singular:
        weakest = identifiability.weak[0]
        # The direction may belong to the set-up alone: then every parameter of the sensor may be determined.
        poorly = {name for direction in identifiability.nearly_undetermined for name in direction.coefficients}
        reason = (
            f"these positions determine {weakest.words} poorly (uncertainty {weakest.sd_ratio:.0f} times the median)"
        )
        use = _only([name for name in SENSOR if name not in poorly and one_sensor(exact)], reason)
        yield Judgement(use, _more_attitudes(exact), uncertified=True)
    if calibrated.implausible:
        names = shortened([unusual.parameter for unusual in calibrated.implausible], 3)
        finding = "the fit requires parameter values far outside the usual range"
        yield Judgement(Use("no", f"implausible values of {names}"), f"Check the set-up. {diagnose}", finding)
    # Residuals beyond the stated noise, or that an effect explains much better; without those of reported positions.
    words, p_value = min(_contradictions(calibrated, missed), key=lambda item: item[1], default=("", 1.0))
    if p_value < CONTRADICTED and not calibrated.contradicted:
        yield Judgement(Use("no", f"the data contradict the model ({p_words(p_value)}): {words}"), diagnose)
    p_value = priors_p_value(exact)
    if p_value is not None and p_value < CONTRADICTED and not calibrated.implausible:
        use = Use("no", f"stated parameter values and data contradict each other ({p_words(p_value)})")
        yield Judgement(use, f"Check --prior, --head and the rig's priors. {diagnose}")
    # An outlier position increases the residuals of the others.
    if calibrated.floor is not None and not calibrated.contradicted:
        use = Use("yes", "the dispersion of the positions exceeds their sd columns (the uncertainties include this)")
        yield Judgement(use, f"{calibrated.floor.words} {diagnose}")
    for use in gravity_use(exact):
        yield Judgement(use, "State it by --gravity.")
    for use in undetermined_use(exact):
        yield Judgement(use, _more_attitudes(exact))
    if calibrated.level is not None and not calibrated.level.too_small:
        yield Judgement(
            Use("yes", "the residuals are smaller than the stated noise, so the uncertainties use their level"),
            "State the sd of the values in a row (of a mean, not of a sample). Too large a noise may hide a wrong model.",
        )
    unstated, assumed = exact.noise == "estimated", scatter is not None and not scatter.noise_determined
    if dof_of_readings(exact) <= 0:
        yield Judgement(Use("not tested", exact.no_freedom_words), "Measure more positions.")
    elif missed is not None and (assumed or (missed.p_value is None and (unstated or scatter is not None))):
        reason = f"{'no noise is stated, and ' * unstated}the residuals of these positions could show no effect"
        advice = f"{'State the noise (sd columns, --noise-sd), or measure' if unstated else 'Measure'} more positions."
        yield Judgement(Use("not tested", reason), advice)


def _contradictions(calibrated: Calibrated, missed: MissedEffects | None) -> Iterator[tuple[str, float]]:
    """Tests of the model in words, with their p-values."""
    exact, level = calibrated.exact, calibrated.level
    if level is not None and level.too_small:
        yield f"the residuals exceed the stated noise, chi2/dof {level.ratio:.3g}", level.p_value
    elif exact.chi2_p_value is not None:
        yield f"the residuals exceed {_noise(exact)}, chi2/dof {exact.chi2 / exact.dof:.3g}", exact.chi2_p_value
    if missed is not None and missed.p_value is not None:
        yield "an effect that is not in the model explains them better", missed.p_value


def _noise(exact: Fit) -> str:
    return "the recording's noise" if exact.problem.noise_of_recording else "the stated noise"


def _diagnose(calibrated: Calibrated) -> str:
    return f"Run: {suggested('diagnose', *calibrated.exact.data.as_arguments)}"


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
        moved = f"Without this position the largest change of a parameter is {found.moved:.3g} standard uncertainties"
        yield Judgement(Use("no", fault), f"{moved}. Check the log; {remedy}. {_diagnose(calibrated)}")


def _more_attitudes(fit: Fit) -> str:
    """What to measure if the positions determine a direction poorly."""
    further = (
        "attitudes that differ in all directions" if fit.data.hand_held else "more pitch settings or spindle angles"
    )
    words = remedy_words(fit) or f"measure at {further}"
    return f"{words[:1].upper()}{words[1:]}."


def remedy_words(fit: Fit) -> str:
    """An instruction that would determine the weakest direction, without a full stop; "" if none is known."""
    weak = fit.identifiability.weak if fit.identifiability else ()
    if weak and fit.chain.of_positions:
        words = attitude_words(fit.data.readings)
        return f"measure further attitudes: {words}" if words else ""
    if not weak or not any("_x" in name for name in weak[0].coefficients):
        return ""
    return "repeat the measurement with the triad rotated by 90 degrees in its fixture, or at negative pitch angles"


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
        reason = "the terms of one of the indistinguishable explanations cannot be inverted for readings of 1 g"
        uses.append(Use("no", reason))
    if difference_g > diagnosis.sigma_g:
        reason = "the explanations that these data do not separate correct the readings differently (U includes this)"
        uses.append(Use("yes", reason))
    else:
        difference_g = 0.0
    return combined(uses, None if expanded_g is None else expanded_g + systematic_g(data, terms) + difference_g)


def _uses_of_diagnosis(diagnosis: "Diagnosis") -> Iterator[Use]:
    """The uses that the findings allow."""
    from tumblecal.diagnosis.causes.cause import UNEXPLAINED

    best, gain = diagnosis.best, diagnosis.gain if diagnosis.members else None
    if diagnosis.implausible:
        yield Use("no", f"implausible values of {', '.join(one.parameter for one in diagnosis.implausible[:3])}")
    elif diagnosis.verdict == "unexplained":
        p_value = p_words(diagnosis.screened.detection.p_value)
        yield Use("no", f"the data contradict the model ({p_value}), and no catalogued effect explains them")
    elif (UNEXPLAINED,) in best.equivalents and 2 * best.own_probability < best.probability:
        yield Use("no", f"an effect that is not in the catalogue is more probable than {' + '.join(best.labels)}")
    if dof_of_readings(diagnosis.extended) <= 0:
        yield Use("not tested", diagnosis.extended.no_freedom_words)
    yield from gravity_use(diagnosis.extended)
    yield from undetermined_use(diagnosis.in_use.as_fit)
    if gain and gain.cv_rms_after_g - gain.cv_rms_before_g > _WORSE_SD * max(gain.cv_gain_sd_g, 0.0):
        yield Use("no", "with the causes found, held-out positions are predicted worse than without them")
    if diagnosis.noise_wrong:
        yield Use("yes", f"its uncertainties are those of the corrected noise ({', '.join(diagnosis.noise_wrong)})")


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
            yield Use("within", "a dependence on temperature outside this range was not measured", span)
        else:
            at = in_words(f"{np.mean(degc):.4g}", "degC")
            yield Use("yes", f"measured at about {at}; a dependence on temperature was not measured")


def systematic_g(data: PositionSet, terms: SensorTerms) -> float:
    """The sum of the systematic errors of known size that the file does not correct, g. U includes it (JCGM 100, F.2.4.5)."""
    return sum(size_g or 0.0 for size_g, _ in _corrections_missing(data, terms))


def _corrections_missing(data: PositionSet, terms: SensorTerms) -> Iterator[tuple[float | None, str]]:
    """Each systematic error that the file does not correct: its largest size in the data (g; None: not known), and words."""
    missing = [
        (loss.largest_mg, f"{loss.effect} is not in this calibration ({loss.reason})")
        for loss in terms.losses(data.temperature_degc)
        if loss.reason not in NOT_MISSED
    ]
    missing += [
        (change_g and 1e3 * change_g, f"the readings change within dwells with {variable or 'time or temperature'}")
        for variable, change_g in changes_within_dwells(data.comments)
        if variable != TEMPERATURE or not terms.thermal
    ]
    for size_mg, reason in missing:
        if size_mg is None:
            yield None, f"{reason}, and its size is not known"
        else:
            yield 1e-3 * size_mg, f"{reason}; U includes its largest size, {in_words(f'{size_mg:.2g}', 'mg')}"


def gravity_use(fit: Fit) -> Iterator[Use]:
    """Without a stated gravity the scale factors of readings in m/s^2 are not determined."""
    if fit.data.gravity is not None and fit.data.gravity.assumed:
        yield Use("only", NO_GRAVITY, parameters=tuple(n for n in fit.names if n in SENSOR and n[:3] != "dK_"))


def undetermined_use(fit: Fit) -> Iterator[Use]:
    """Parameters that the data cannot separate from an effect are not determined."""
    missing = [name for name in fit.undetermined if name in SENSOR]
    if missing:
        others = [name for name in SENSOR if name not in missing]
        yield _only(others, f"these positions do not determine {', '.join(missing)}")


def _only(names: Sequence[str], reason: str) -> Use:
    """The use of some parameters; of none if there are none."""
    return Use("only", reason, parameters=tuple(names)) if names else Use("no", reason)

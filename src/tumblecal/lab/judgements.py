"""Judgements on a calibration by its data, and the use of it that they allow.

The data contradict the model if the residuals exceed the stated noise, if an effect of the catalogue or a single position
explains them much better, or if stated values disagree with them. The answer is then `no`, until the cause is in the
calibration. Without a contradiction the calibration may be used with the U that includes effects that the data may have
missed (`lab.missed_effects`); if no residual could show any effect, it is `not tested`.
"""

from collections.abc import Iterator

import numpy as np

from tumblecal.data.calibration_use import Judgement, Use, combined
from tumblecal.data.sensor_parameters import SENSOR, correction_slope, triad_of
from tumblecal.estimation.attitudes import attitude_words
from tumblecal.estimation.contradicted import dof_of_readings, priors_p_value
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.intrinsic import one_sensor, sensor_of
from tumblecal.estimation.methods import Calibrated
from tumblecal.ground.numbers_shown import p_words, shortened
from tumblecal.ground.suggested_command import suggested
from tumblecal.ground.units import in_words
from tumblecal.lab.corrected_reading import expanded_uncertainty, responses, with_undetected
from tumblecal.lab.limits import gravity_use, limits, systematic_g, undetermined_use
from tumblecal.lab.missed_effects import MissedEffects, missed_effects
from tumblecal.lab.sensor_terms import SensorTerms, terms_of_chain


# Data of a correct model contradict it with this probability, in each of two tests.
CONTRADICTED = 0.0025


def judged(calibrated: Calibrated) -> tuple[tuple[Judgement, ...], Use]:
    """Judgements on the exact fit, the most serious first (never empty), and the use that all of them and the limits allow."""
    exact = calibrated.exact
    if not exact.code.good:
        use = Use("no", "the exact fit did not converge")
        return (Judgement(use, f"{exact.message}. {_diagnose(calibrated)}"),), use
    missed = missed_effects(exact, calibrated.entries) if one_sensor(exact) and not exact.computed else None
    found = [*_findings(calibrated, missed)] or [_good(exact)]
    found.sort(key=lambda judgement: ("bad", "open", "good").index(judgement.tone))
    found.sort(key=lambda judgement: not judgement.use.refused)
    terms = terms_of_chain(exact, exact.problem.chain, calibrated.entries)
    uses = [*(judgement.use for judgement in found), *limits(exact.data, terms)]
    return tuple(found), combined(uses, None if missed is None else _expanded(calibrated, missed, terms))


def _findings(calibrated: Calibrated, missed: MissedEffects | None) -> Iterator[Judgement]:
    exact, scatter = calibrated.exact, calibrated.scatter
    yield from _positions(calibrated)
    yield from _poorly_determined(exact)
    if calibrated.implausible:
        names = shortened([unusual.parameter for unusual in calibrated.implausible], 3)
        finding = "the fit requires parameter values far outside the usual range"
        advice = f"Check the set-up. {_diagnose(calibrated)}"
        yield Judgement(Use("no", f"implausible values of {names}"), advice, finding)
    yield from _contradiction(calibrated, missed)
    p_value = priors_p_value(exact)
    if p_value is not None and p_value < CONTRADICTED and not calibrated.implausible:
        use = Use("no", f"stated parameter values and data contradict each other ({p_words(p_value)})")
        yield Judgement(use, f"Check --prior, --head and the rig's priors. {_diagnose(calibrated)}")
    # An outlier position increases the residuals of the others.
    if calibrated.floor is not None and not calibrated.contradicted:
        use = Use("yes", "the dispersion of the positions exceeds their sd columns (the uncertainties include this)")
        yield Judgement(use, f"{calibrated.floor.words} {_diagnose(calibrated)}")
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


def _poorly_determined(exact: Fit) -> Iterator[Judgement]:
    if exact.identifiability is None or not exact.identifiability.nearly_singular:
        return
    weakest = exact.identifiability.weak[0]
    # The direction may belong to the set-up alone: then every parameter of the sensor may be determined.
    poorly = {name for direction in exact.identifiability.nearly_undetermined for name in direction.coefficients}
    names = tuple(name for name in SENSOR if name not in poorly)
    reason = f"these positions determine {weakest.words} poorly (uncertainty {weakest.sd_ratio:.0f} times the median)"
    use = Use("only", reason, parameters=names) if one_sensor(exact) and names else Use("no", reason)
    yield Judgement(use, _more_attitudes(exact), uncertified=True)


def _contradiction(calibrated: Calibrated, missed: MissedEffects | None) -> Iterator[Judgement]:
    """Residuals beyond the stated noise, or that an effect explains much better; without those of reported positions."""
    contradicted, level = calibrated.contradicted, calibrated.level
    if contradicted:
        return
    exact, p_values = calibrated.exact, dict[str, float]()
    if level is not None and level.too_small:
        p_values[f"the residuals exceed the stated noise, chi2/dof {level.ratio:.3g}"] = level.p_value
    elif exact.chi2_p_value is not None:
        noise = "the recording's noise" if exact.problem.noise_of_recording else "the stated noise"
        p_values[f"the residuals exceed {noise}, chi2/dof {exact.chi2 / exact.dof:.3g}"] = exact.chi2_p_value
    if missed is not None and missed.p_value is not None:
        p_values["an effect that is not in the model explains them better"] = missed.p_value
    words, p_value = min(p_values.items(), key=lambda item: item[1], default=("", 1.0))
    if p_value < CONTRADICTED:
        yield Judgement(
            Use("no", f"the data contradict the model ({p_words(p_value)}): {words}"), _diagnose(calibrated)
        )


def _good(exact: Fit) -> Judgement:
    if exact.chi2_p_value is not None:
        whose = "the recording's noise" if exact.problem.noise_of_recording else "the stated noise"
        return Judgement(Use("yes"), finding=f"the residuals are consistent with {whose}")
    finding = "no effect that is not in the model explains the residuals better (no noise is stated)"
    return Judgement(Use("yes"), finding=finding)


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


def _expanded(calibrated: Calibrated, missed: MissedEffects, terms: SensorTerms) -> float:
    """U of a corrected reading: noise, effects that the data may have missed, and known corrections that the file lacks."""
    exact, undetected = calibrated.exact, missed.undetected
    sensor, degc = sensor_of(exact), exact.data.temperature_degc
    parameters = sensor.covariance + undetected.covariance
    reference = None if degc is None else float(np.mean(degc))
    missing = responses(undetected, missed.model, calibrated.entries, exact.problem.where, reference)
    covariance = with_undetected(correction_slope(sensor.values), parameters, undetected, missing)
    dof = exact.dof if exact.noise == "estimated" else np.inf
    return expanded_uncertainty(np.linalg.inv(triad_of(sensor.values)), covariance, dof=dof) + systematic_g(
        exact.data, terms
    )

"""A calibration in words: noise, methods, gravity, pitch settings, temperature, and measurements that would improve it."""

from collections.abc import Iterator

import numpy as np

from tumblecal.chain import followings_of
from tumblecal.data.position_comments import WITHIN_DWELLS, identity_words
from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.effects import Catalogue
from tumblecal.estimation.contradicted import dof_of_readings
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.methods import Calibrated
from tumblecal.estimation.mountings import mounting_words, turns_of
from tumblecal.estimation.noise_level import UNLIKELY, ContradictedLevel
from tumblecal.estimation.plausibility import implausible_words
from tumblecal.estimation.position_problem import default_chain
from tumblecal.ground.gravity import normal_gravity
from tumblecal.ground.numbers_shown import p_words, rounded
from tumblecal.ground.suggested_command import suggested
from tumblecal.ground.units import in_words, shown
from tumblecal.lab.limits import NO_GRAVITY
from tumblecal.lab.sensor_terms import effects_in, held_words, lacking_of_fit


TITLES = {"exact": "exact", "harmonic": "harmonic", "kalman": "Kalman"}
# Differences of another method from the exact fit, in standard uncertainties: negligible, and wrong for these data.
_AGREES, _WRONG = 0.3, 2.0
_WHY = {
    "harmonic": "the small-angle approximation fails, or the weights differ between positions",
    "kalman": "the small-angle approximation fails, or the filter still depends on its starting values",
}
_INDEPENDENT = "it assumes independent positions, but the noise is correlated"

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


def warning_words(calibrated: Calibrated) -> Iterator[str]:
    """Warnings for a reader of the numbers alone: judgements that are not good, implausible values, corrected set-up errors, an
    assumed gravity."""
    exact, gravity = calibrated.exact, gravity_warning(calibrated.exact)
    judged = [each for each in calibrated.judgements if each.tone != "good" and each.use.reason != NO_GRAVITY]
    yield from (judgement.words for judgement in judged)
    yield from (f"IMPLAUSIBLE: {words}" for words in implausible_words(calibrated.implausible))
    yield from (f"corrected: {setup_error.description}" for setup_error in calibrated.setup_errors)
    yield from filter(
        None, [gravity, *lacking_of_fit(exact, calibrated.entries, of_sensor=True), many_settings_words(exact)]
    )


def sensor_values(fit: Fit) -> list[str]:
    """The sensor's parameters with their expanded uncertainties (95 %), a line each."""
    lines = []
    for name in (name for name in SENSOR if name in fit.names):
        place = fit.names.index(name)
        unit, factor = shown(fit.units[place])
        value, expanded = rounded(factor * fit.values[place], factor * fit.coverage_factor() * fit.sd[place])
        lines.append(f"{name} = {in_words(value, unit)}, U = {in_words(expanded, unit)}")
    return lines


def notes(calibrated: Calibrated) -> list[str]:
    """Everything to know that asks for no action, a sentence or line each."""
    exact, entries = calibrated.exact, calibrated.entries
    texts = [
        calibrated.scatter.words if calibrated.scatter else "",
        gravity_words(exact),
        identity_words(exact.data),
        mounting_words(turns_of(exact.problem.chain, exact.problem.where)),
        read_settings_words(exact),
        many_settings_words(exact),
        exact.data.comments.get(WITHIN_DWELLS, ""),
        temperature_words(exact, entries),
        *held_words(exact, exact.problem.chain, entries),
        *lacking_of_fit(exact, entries),
    ]
    return list(filter(None, texts))


def methods_words(calibrated: Calibrated) -> Iterator[str]:
    """Largest difference of each other method from the exact fit, and whether to use its values; why others were not run."""
    for name, farthest, parameter in distances(calibrated):
        title = TITLES[name]
        if farthest <= _AGREES:
            yield f"{title}: agrees with the exact fit within {farthest:.2g} u"
        elif farthest <= _WRONG:
            yield f"{title}: differs by up to {farthest:.2g} u from the exact fit ({parameter}); use the exact fit"
        else:
            why = _why_far(name, calibrated.exact)
            yield f"{title}: differs by {farthest:.3g} u from the exact fit ({parameter}): do not use it for these data; {why}"
    yield from (f"{TITLES[name]}: not run: {why}" for name, why in calibrated.skipped.items())


def _why_far(method: str, exact: Fit) -> str:
    """Why another method differs from the exact fit: terms that it lacks, otherwise its approximation."""
    problem = exact.problem
    if problem.correlated:
        return _INDEPENDENT
    linear = {leaf.name for leaf in default_chain(exact.data).parameters}
    more = [leaf for leaf in problem.chain.parameters if leaf.name not in linear and (leaf.free or np.any(leaf.value))]
    if more:
        return f"its linear equations do not include {', '.join(leaf.name for leaf in more)}"
    return "only the exact fit uses the stated priors" if problem.with_prior else _WHY[method]


def wrong_methods(calibrated: Calibrated) -> list[str]:
    """Titles of the methods whose values must not be used for these data."""
    return [TITLES[name] for name, farthest, _ in distances(calibrated) if farthest > _WRONG]


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
    if dof_of_readings(result) <= 0:
        known = "not known" if result.noise == "estimated" else "stated"
        whose = "of the recording" if result.problem.noise_of_recording else known
        return f"noise: {whose}; goodness of fit cannot be tested: {result.no_freedom_words}"
    if result.noise == "estimated":
        return f"noise: sd {result.sigma * 1e3:.4f} mg, estimated from the residuals (intervals by Student's t)"
    p_value, ratio = result.chi2_p_value or 0.0, result.chi2 / result.dof
    of_recording = result.problem.noise_of_recording
    whose, judged = ("of the recording", _OF_RECORDING) if of_recording else (_stated(result), _OF_STATED)
    words = judged[0 if p_value <= UNLIKELY else 1 if p_value < 1 - UNLIKELY else 2].format(
        diagnose=suggested("diagnose", *result.data.as_arguments)
    )
    return f"noise: {whose}; chi2/dof {ratio:{'.3f' if ratio < 1e5 else '.3g'}}, {p_words(p_value)}: {words}"


def _stated(result: Fit) -> str:
    """That the noise is stated, and whether it has a slow part or sd columns of few samples are pooled."""
    if result.problem.correlated:
        return "stated in the rig, with its slow part"
    data, counted = result.data, result.data.weighing_sd
    if data.n is None or counted is None or counted is data.sd or not np.array_equal(result.problem.sd, counted):
        return "stated"
    return f"stated, with sd columns of {np.median(data.n):g} samples a position, pooled"


def gravity_words(fit: Fit) -> str:
    """A line for the reader; "" for readings in g without a stated gravity."""
    warning, gravity = gravity_warning(fit), fit.data.gravity
    return f"WARNING: {warning}" if warning else f"one g is {gravity}" if gravity else ""


def gravity_warning(fit: Fit) -> str:
    """Effect of an assumed gravity on the scale factors; "" if it is stated, or if nothing depends on it."""
    gravity = fit.data.gravity
    if gravity is None or not gravity.assumed:
        return ""
    least, most = normal_gravity(0.0), normal_gravity(90.0)
    shift = max(gravity.value_ms2 / least - 1.0, 1.0 - gravity.value_ms2 / most)
    words = (
        f"the readings are in m/s^2 and no gravity is stated; {gravity.value_ms2:g} m/s^2 is assumed. The "
        f"gravity of your site ({least:.3f} to {most:.3f} at sea level) changes every dK by up to {shift * 1e3:.1f}e-3"
    )
    spread = [float(sd) for name, sd in zip(fit.names, fit.sd, strict=True) if name.startswith("dK") and sd > 0]
    in_u = f", {shift / min(spread):.0f} u" if spread else ""
    return f"{words}{in_u}. State it: --gravity 9.8123, or --gravity lat=48.14,height=520"


# More settings than these with so few rows each are not commanded settings.
_MANY, _ROWS_EACH = 8, 3
_MOST_SHOWN = 8


def read_settings_words(fit: Fit) -> str:
    """The pitch settings that read pitch angles were assigned to; "" if no pitch angle was read."""
    data = fit.data
    called = data.pitch_setting_deg
    read = ~np.isclose(called, data.beta_deg, rtol=0.0, atol=1e-6)
    settings = np.unique(called[np.isin(called, called[read])])
    if not len(settings):
        return ""
    read_rows = np.isin(called, settings)
    angles, spread = (
        len(np.unique(data.beta_deg[read_rows])),
        max(np.ptp(data.beta_deg[called == one]) for one in settings),
    )
    shown = ", ".join(f"{one:g}" for one in settings[:_MOST_SHOWN]) + (", ..." if len(settings) > _MOST_SHOWN else "")
    return (
        f"pitch settings: beta_deg contains read angles, {angles} of them at {len(settings)} "
        f"setting{'s' if len(settings) > 1 else ''} ({shown} deg; range of one setting up to {spread:.2g} deg). Each position "
        "uses the angle that was read; each setting has one error dbeta."
    )


def many_settings_words(fit: Fit) -> str:
    """A warning that nearly every row has a separate pitch setting, with the remedy; "" otherwise."""
    errors = [leaf for leaf in fit.problem.chain.free if leaf.name == "dbeta" and leaf.by and leaf.by.endswith("pitch")]
    count = sum(len(leaf.names) for leaf in errors)
    if count <= _MANY or count * _ROWS_EACH <= len(fit.data):
        return ""
    return (
        f"pitch settings: beta_deg contains {count} in {len(fit.data)} rows. Each has a separate error dbeta, so few degrees "
        "of freedom remain. If an encoder read the angles (more than half a degree from the setting), write the commanded "
        "angle; if its readings are exact, use --fix dbeta."
    )


# With typical coefficients such a change (degC) causes several times the noise of a good measurement.
_MUCH_DEGC = 2.0


def temperature_words(fit: Fit, entries: Catalogue) -> str:
    """The parameters that follow temperature. Without any: that the standard uncertainties do not include the effect of a
    changed temperature; "" if it hardly changed, is unknown, or the chain has effects of temperature."""
    if followings := [leaf for leaf in followings_of(fit.problem.chain) if leaf.change.free]:
        functions = followings[0].functions
        low, high = functions.range_degc
        words = (
            f"All parameters apply at {functions.reference_degc:.4g} degC. From {low:.4g} to {high:.4g} degC they follow "
            f"temperature: {', '.join(f'{leaf.reference.name} by {leaf.functions.words}' for leaf in followings)}."
        )
        mount = any(leaf.reference.name == "dtheta" for leaf in followings)
        return words + " The alignment in calibration.json applies at that temperature alone." * mount
    degc = fit.data.temperature_degc
    if degc is None or np.ptp(degc) < _MUCH_DEGC:
        return ""
    effects = effects_in(fit.problem.chain, fit.problem.where, entries)
    if any("reference_degc" in form for effect in effects for form in effect.forms):
        return ""
    return (
        f"The temperature changed by {np.ptp(degc):.2g} degC: the standard uncertainties do not include the effect of this "
        "change on bias and scale factors. To include it, run: "
        f"{suggested('diagnose', *fit.data.as_arguments)}"
    )

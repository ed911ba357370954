"""What a verdict adds below its rule: model and noise used, changes of the calibration, and what the data cannot show."""

from collections.abc import Iterator
from typing import Any

from tumblecal.data.position_comments import WITHIN_DWELLS
from tumblecal.data.sensor_parameters import SENSOR, leaf_of
from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import id_of
from tumblecal.diagnosis.findings.limits import Invisible
from tumblecal.estimation.mountings import mounting_words
from tumblecal.estimation.plausibility import implausible_words
from tumblecal.ground.counted import counted, shortened
from tumblecal.ground.numbers_shown import capped, changed, rounded_together
from tumblecal.ground.units import in_words, shown
from tumblecal.lab.diagnosed_use import diagnosed_use, lacking_of_diagnosis
from tumblecal.lab.sensor_terms import held_words
from tumblecal.report.calibration_words import (
    gravity_warning,
    gravity_words,
    many_settings_words,
    read_settings_words,
)
from tumblecal.show.verdict import NOT_TESTABLE, UNDETECTABLE, as_sentence


# Headings.
CHANGES, GAIN, CAUSES, UNCERTAINTIES = "Changes of the calibration", "Residuals and gain", "Causes", "Uncertainties"
UNDETERMINED, HELD, LACKING = "Undetermined parameters", "Calibration file", "Not in the calibration file"
# Changes below this share of the standard uncertainty are not listed.
_LEAST_CHANGE_U = 0.5
_SLOW_NOISE = "The rig states slow noise ([head.noise]). All tests and intervals include it."
# Uncertainties are listed from this multiple of the noise's on, for so many parameters and effects.
_OF_SENSOR, _MUCH_WIDER, _MOST_UNDETECTED, _MOST_EFFECTS = {leaf_of(name) for name in SENSOR}, 2.0, 3, 2
_MOST_WORST, _MOST_NOT_TESTABLE = 3, 4


def warning_words(diagnosis: Diagnosis) -> Iterator[str]:
    """Warnings for a reader of the numbers alone: implausible values, corrected set-up errors, an assumed gravity."""
    if (use := diagnosed_use(diagnosis)).refused:
        yield f"use: {use.words}"
    yield from (f"IMPLAUSIBLE: {words}" for words in implausible_words(diagnosis.implausible))
    yield from (f"corrected: {setup_error.label}: {setup_error.description}" for setup_error in diagnosis.setup_errors)
    if gravity := gravity_warning(diagnosis.extended):
        yield gravity
    yield from lacking_of_diagnosis(diagnosis, of_sensor=True)
    if many := many_settings_words(diagnosis.nominal):
        yield many


def details(diagnosis: Diagnosis) -> Iterator[tuple[str, str]]:
    """Heading and text of each entry of a verdict below its rule."""
    if diagnosis.members:
        yield from _changes(diagnosis)
    listed = {
        UNDETERMINED: undetermined_words(diagnosis),
        UNCERTAINTIES: uncertainty_words(diagnosis),
        **_of_model(diagnosis),
        UNDETECTABLE: _undetectable(diagnosis),
    }
    yield from ((name, words) for name, words in listed.items() if words)
    yield from ((NOT_TESTABLE, words) for words in _not_testable(diagnosis))


def _of_model(diagnosis: Diagnosis) -> dict[str, str]:
    """The data, noise and model that were assumed, and the effects that the calibration file contains or lacks."""
    held = held_words(diagnosis.extended, diagnosis.model.nominal_chain, diagnosis.entries)
    ids = [id for id in dict.fromkeys(map(id_of, diagnosis.labels)) if id in diagnosis.entries]
    return {
        CAUSES: " ".join(f"{id}: {diagnosis.entries[id].cause}" for id in ids),
        "Noise": _correlated_noise(diagnosis),
        "Noise correction": "All tests and intervals use the corrected weights." if diagnosis.noise_labels else "",
        "Mountings": mounting_words(diagnosis.mountings),
        "Pitch settings": _text_of(read_settings_words(diagnosis.nominal)),
        HELD: " ".join(f"{as_sentence(words)}." for words in held),
        LACKING: " ".join(f"{_text_of(words)}." for words in lacking_of_diagnosis(diagnosis)),
        "Gravity": "" if gravity_warning(diagnosis.extended) else gravity_words(diagnosis.extended),
        "Changes within dwells": diagnosis.data.comments.get(WITHIN_DWELLS, ""),
    }


def _text_of(words: str) -> str:
    """Words without the heading that they begin with."""
    return words.partition(": ")[2]


def _correlated_noise(diagnosis: Diagnosis) -> str:
    """The noise of the recording, or that of the rig's head; "" for independent positions."""
    samples = diagnosis.samples
    if samples is None:
        return _SLOW_NOISE if diagnosis.problem.correlated and not diagnosis.noise_labels else ""
    if not samples.extrapolated:
        return samples.words()
    return f"{samples.words()} The positions have a dispersion of {diagnosis.extended.level:.2g} times that sd."


def _changes(diagnosis: Diagnosis) -> Iterator[tuple[str, str]]:
    gain = diagnosis.gain
    slow = "" if not diagnosis.problem.correlated else " (with the part that neighbouring positions share)"
    held_out, held_out_u = 1e3 * (gain.cv_rms_before_g - gain.cv_rms_after_g), 1e3 * gain.cv_gain_sd_g
    repeat = 1e3 * gain.fresh_rms_before_g, 1e3 * gain.fresh_rms_after_g
    yield (
        GAIN,
        f"Residuals {changed(1e3 * gain.rms_before_g, 1e3 * gain.rms_after_g, held_out_u)} mg rms{slow}. Improvement of the "
        f"held-out error {rounded_together(held_out, held_out_u)} mg. Expected of a repeat measurement: "
        f"{changed(*repeat, 1e3 * gain.fresh_gain_sd_g)} mg (improvement "
        f"{rounded_together(repeat[0] - repeat[1], 1e3 * gain.fresh_gain_sd_g)} mg). "
        f"Delta BIC {capped(gain.delta_bic, '.1f')}.",
    )
    largest = sorted(shifts(diagnosis).items(), key=lambda item: -abs(item[1]["in_sd"]))
    listed = [
        f"{name} {in_words(format(value['shift'], '+.3g'), value['unit'])} ({capped(value['in_sd'], '+.1f')} u)"
        for name, value in largest[:3]
        if abs(value["in_sd"]) > _LEAST_CHANGE_U
    ]
    much = bool(largest) and abs(largest[0][1]["in_sd"]) > 1.0
    yield CHANGES, f"{', '.join(listed)}." if much else "No sensor parameter changed by more than 1 u."
    outside = [check.name for check in diagnosis.checks_after if check.outside]
    if outside:
        yield "Outside of the prediction", f"Still outside with the causes found: {', '.join(outside)}."


def undetermined_words(diagnosis: Diagnosis) -> str:
    """Nominal parameters that are not determined together with the named effects; "" if there are none."""
    fit, listed = diagnosis.extended, shifts(diagnosis)
    missing = [name for name in fit.undetermined if name in listed]
    if not missing:
        return ""
    return (
        f"Not determined together with the causes found: {', '.join(missing)}. The standard uncertainties assume that "
        "undetermined coefficients are of the same size as the determined ones."
    )


def shifts(diagnosis: Diagnosis) -> dict[str, dict[str, Any]]:
    """Change of each nominal parameter from the nominal fit to the calibration file, in display units and in the standard
    uncertainties of that file (`in_sd`)."""
    used, count = diagnosis.in_use, len(diagnosis.nominal.names)
    u, change = used.sd[:count], used.values[:count] - diagnosis.nominal.values
    listed, single, undetermined = {}, diagnosis.model.layout.of_positions, diagnosis.extended.undetermined
    for k, name in enumerate(diagnosis.nominal.names):
        if single[k]:
            continue
        unit, scale = shown(diagnosis.nominal.units[k])
        listed[name] = {
            "shift": float(change[k] * scale),
            "unit": unit,
            "in_sd": 0.0 if used.idle[k] else float(change[k] / u[k]),
            "determined": name not in undetermined and not used.idle[k],
        }
    return listed


def uncertainty_words(diagnosis: Diagnosis) -> str:
    """Contributions to the stated uncertainties in addition to the noise, for the sensor parameters with the largest ones; ""
    if none is much larger than the noise."""
    used = diagnosis.in_use
    parts, undetected = used.parts, used.undetected
    ratio = {
        name: used.sd[k] / parts["noise"][k]
        for k, name in enumerate(used.names)
        if name in diagnosis.model.names and leaf_of(name) in _OF_SENSOR and parts["noise"][k] > 0
    }
    worst = sorted(ratio, key=lambda name: -ratio[name])[:_MOST_UNDETECTED]
    if not worst or ratio[worst[0]] < _MUCH_WIDER:
        return ""
    listed = []
    for name in worst:
        k = used.names.index(name)
        unit, scale = shown(diagnosis.model.units[diagnosis.model.names.index(name)])
        size, noise = (in_words(f"{sd * scale:.2g}", unit) for sd in (used.sd[k], parts["noise"][k]))
        by = f", mostly by {', '.join(ids)}" if (ids := undetected.strongest(k, _MOST_EFFECTS)) else ""
        why = by if parts["undetected_effects"][k] > parts["explanations"][k] else ", mostly by the other explanations"
        listed.append(f"u({name}) {size} (noise alone {noise}{why})")
    return f"These include the other explanations and undetected effects: {'; '.join(listed)}."


def _undetectable(diagnosis: Diagnosis) -> str:
    if not diagnosis.invisible:
        return ""
    harm = {id: harm_in_u(diagnosis, hidden) for id, hidden in diagnosis.invisible.items() if hidden.harm}
    worst = {id: max(changes, key=lambda name: abs(changes[name])) for id, changes in harm.items()}
    listed = "; ".join(
        f"{id} ({in_words(diagnosis.invisible[id].size, diagnosis.invisible[id].unit)} changes {worst[id]} by "
        f"{capped(abs(harm[id][worst[id]]), '.1f')} u)"
        for id in sorted(worst, key=lambda id: -abs(harm[id][worst[id]]))[:_MOST_WORST]
    )
    count = counted(len(diagnosis.invisible), "effect")
    return f"{count}, wholly or in part{f'; largest harm: {listed}' if listed else ''}."


def harm_in_u(diagnosis: Diagnosis, hidden: Invisible) -> dict[str, float]:
    """Change of each parameter that an undetectable effect of its typical size causes, in standard uncertainties of the
    calibration file."""
    used = diagnosis.in_use
    u = {name: float(used.sd[used.names.index(name)]) for name in hidden.harm}
    return {name: float(harm["shift"]) / u[name] if u[name] > 0 else 0.0 for name, harm in hidden.harm.items()}


def _not_testable(diagnosis: Diagnosis) -> Iterator[str]:
    """Effects that cannot be tested, grouped by remedy."""
    by_reason = dict[str, list[str]]()
    for id, reason in diagnosis.model.not_testable.items():
        if not (id in diagnosis.entries and diagnosis.entries[id].found_as):
            by_reason.setdefault(reason, []).append(id)
    for reason, ids in by_reason.items():
        yield f"{reason}: {shortened(ids, _MOST_NOT_TESTABLE)}."

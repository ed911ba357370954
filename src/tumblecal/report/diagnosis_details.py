"""What a verdict adds below its rule: model and noise used, changes of the calibration, and what the data cannot show."""

from collections.abc import Iterator

from tumblecal.data.sensor_parameters import SENSOR, leaf_of
from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import id_of
from tumblecal.estimation.mountings import mounting_words
from tumblecal.estimation.plausibility import implausible_words
from tumblecal.ground.numbers_shown import rounded_together
from tumblecal.ground.units import in_words, shown
from tumblecal.report.diagnosis_calibration import diagnosed_use, lacking_of_diagnosis
from tumblecal.report.gravity_words import gravity_warning, gravity_words
from tumblecal.report.number_words import bic_words
from tumblecal.report.sensor_terms import held_words
from tumblecal.report.sentences import as_sentence
from tumblecal.report.setting_words import many_settings_words, read_settings_words
from tumblecal.report.temperature_words import within_dwells_words
from tumblecal.report.verdict import NOT_TESTABLE, UNDETECTABLE


# Headings.
CHANGES, GAIN, CAUSES, UNCERTAINTIES = "Changes of the calibration", "Residuals and gain", "Causes", "Uncertainties"
UNDETERMINED, HELD, LACKING = "Undetermined parameters", "Calibration file", "Not in the calibration file"
# A parameter that moved by less than this share of its sd is not listed among those that did.
_MOVED_SD = 0.5
# Uncertainties are listed from this factor over the noise's on, of so many parameters and effects.
_OF_SENSOR, _MUCH_WIDER, _MOST_UNDETECTED, _MOST_EFFECTS = {leaf_of(name) for name in SENSOR}, 2.0, 3, 2
_MOST_WORST, _MOST_NOT_TESTABLE = 3, 4


def warning_words(diagnosis: Diagnosis) -> Iterator[str]:
    """What a reader of the numbers alone must know: values that no instrument has, what was corrected, a gravity that nobody
    stated."""
    if (use := diagnosed_use(diagnosis)).refused:
        yield f"use: {use.words}"
    yield from (f"IMPLAUSIBLE: {words}" for words in implausible_words(diagnosis.implausible))
    yield from (f"put right: {setup_error.label}: {setup_error.description}" for setup_error in diagnosis.setup_errors)
    if gravity := gravity_warning(diagnosis.extended):
        yield gravity
    yield from lacking_of_diagnosis(diagnosis, of_sensor=True)
    if many := many_settings_words(diagnosis.nominal):
        yield many


def details(diagnosis: Diagnosis) -> Iterator[tuple[str, str]]:
    """Heading and text of everything that a verdict says below its rule, but for what there is nothing to say of."""
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
    """What the data, the noise and the model were taken to be, and which effects the calibration file holds or lacks."""
    held = held_words(diagnosis.extended, diagnosis.model.nominal_chain, diagnosis.entries)
    ids = [id for id in dict.fromkeys(map(id_of, diagnosis.labels)) if id in diagnosis.entries]
    return {
        CAUSES: " ".join(f"{id}: {diagnosis.entries[id].cause}" for id in ids),
        "Noise": "" if diagnosis.samples is None else _noise_of_samples(diagnosis),
        "Noise correction": "All tests and intervals use the corrected weights." if diagnosis.noise_labels else "",
        "Mountings": mounting_words(diagnosis.mountings),
        "Pitch settings": _text_of(read_settings_words(diagnosis.nominal)),
        HELD: " ".join(f"{as_sentence(words)}." for words in held),
        LACKING: " ".join(f"{_text_of(words)}." for words in lacking_of_diagnosis(diagnosis)),
        "Gravity": "" if gravity_warning(diagnosis.extended) else gravity_words(diagnosis.extended),
        "Changes within dwells": within_dwells_words(diagnosis.data),
    }


def _text_of(words: str) -> str:
    """Words without the heading that they begin with."""
    return words.partition(": ")[2]


def _noise_of_samples(diagnosis: Diagnosis) -> str:
    samples = diagnosis.samples
    assert samples is not None
    if not samples.extrapolated:
        return samples.words()
    return f"{samples.words()} The positions scatter {diagnosis.extended.level:.2g} times as much as that sd."


def _changes(diagnosis: Diagnosis) -> Iterator[tuple[str, str]]:
    gain = diagnosis.gain
    slow = "" if not diagnosis.problem.correlated else " (with the part that neighbouring positions share)"
    yield (
        GAIN,
        f"Residuals {gain.rms_before_g * 1e3:.3g} -> {gain.rms_after_g * 1e3:.3g} mg rms{slow}. Held-out gain "
        f"{rounded_together((gain.cv_rms_before_g - gain.cv_rms_after_g) * 1e3, gain.cv_gain_sd_g * 1e3)} mg. Expected of a "
        f"new measurement: {gain.fresh_rms_before_g * 1e3:.3g} -> {gain.fresh_rms_after_g * 1e3:.3g} mg (gain "
        f"{rounded_together((gain.fresh_rms_before_g - gain.fresh_rms_after_g) * 1e3, gain.fresh_gain_sd_g * 1e3)} mg). "
        f"Delta BIC {bic_words(gain.delta_bic)}.",
    )
    moved = sorted(shifts(diagnosis).items(), key=lambda item: -abs(item[1]["in_sd"]))
    listed = [
        f"{name} {in_words(format(value['shift'], '+.3g'), value['unit'])} ({value['in_sd']:+.1f} u)"
        for name, value in moved[:3]
        if abs(value["in_sd"]) > _MOVED_SD
    ]
    much = bool(moved) and abs(moved[0][1]["in_sd"]) > 1.0
    yield (
        CHANGES,
        f"{', '.join(listed)}." if much else "No sensor parameter changed by more than 1 u.",
    )
    outside = [check.name for check in diagnosis.checks_after if check.outside]
    if outside:
        yield "Outside of the prediction", f"With the causes found, still outside: {', '.join(outside)}."


def undetermined_words(diagnosis: Diagnosis) -> str:
    """Which nominal parameters an effect that was named leaves open; "" where there are none."""
    fit, listed = diagnosis.extended, shifts(diagnosis)
    left = [name for name in fit.undetermined if name in listed]
    if not left:
        return ""
    return (
        f"Not determined together with the causes found: {', '.join(left)}. Coefficients that these positions do not show are "
        "assumed to be of the size of those that they show; the standard uncertainties include their effect."
    )


def shifts(diagnosis: Diagnosis) -> dict[str, dict]:
    """How far each nominal parameter moved from the nominal to the extended fit, as shown and in its sd."""
    count = len(diagnosis.nominal.names)
    sd = diagnosis.extended.sd[:count]
    moved = diagnosis.extended.values[:count] - diagnosis.nominal.values
    listed, single, left = {}, diagnosis.model.layout.of_positions, diagnosis.extended.undetermined
    for k, name in enumerate(diagnosis.nominal.names):
        if single[k]:
            continue
        unit, scale = shown(diagnosis.nominal.units[k])
        listed[name] = {
            "shift": float(moved[k] * scale),
            "unit": unit,
            "in_sd": float(moved[k] / sd[k]) if sd[k] > 0 else 0.0,
            "determined": name not in left,
        }
    return listed


def uncertainty_words(diagnosis: Diagnosis) -> str:
    """Contributions to the stated uncertainties in addition to the noise, for the sensor parameters with the largest ones; ""
    where none is much larger than the noise."""
    used = diagnosis.in_use
    parts, undetected = used.parts, used.undetected
    assert undetected is not None  # what is written includes it
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
        by = f", mostly by {', '.join(own)}" if (own := undetected.strongest(k, _MOST_EFFECTS)) else ""
        why = by if parts["undetected_effects"][k] > parts["explanations"][k] else ", mostly by the other explanations"
        listed.append(f"u({name}) {size} (noise alone {noise}{why})")
    return f"These include the other explanations and undetected effects: {'; '.join(listed)}."


def _undetectable(diagnosis: Diagnosis) -> str:
    if not diagnosis.invisible:
        return ""
    harm = {
        id: max(abs(h["in_sd"]) for h in hidden.harm.values())
        for id, hidden in diagnosis.invisible.items()
        if hidden.harm
    }
    worst = [(id, diagnosis.invisible[id]) for id in sorted(harm, key=lambda id: -harm[id])[:_MOST_WORST]]
    listed = "; ".join(
        f"{id} ({in_words(hidden.size, hidden.unit)} changes {hidden.absorbed_by[0]} by {harm[id]:.1f} u)"
        for id, hidden in worst
    )
    count = len(diagnosis.invisible)
    return (
        f"{count} effect{'s' if count > 1 else ''}, wholly or in part{f'; largest harm: {listed}' if listed else ''}."
    )


def _not_testable(diagnosis: Diagnosis) -> Iterator[str]:
    """The effects by what the data lack, an entry for each remedy, and those that are found under another name."""
    entries, by_reason, renamed = diagnosis.entries, dict[str, list[str]](), list[str]()
    for id, reason in diagnosis.model.not_testable.items():
        if id in entries and entries[id].found_as:
            renamed.append(id.partition(".")[0])
        else:
            by_reason.setdefault(reason, []).append(id)
    for reason, ids in by_reason.items():
        more = len(ids) - _MOST_NOT_TESTABLE
        yield f"{reason}: {', '.join(ids[:_MOST_NOT_TESTABLE])}{f' and {more} more' if more > 0 else ''}."
    if renamed:
        yield f"reported under another name if present: {', '.join(dict.fromkeys(renamed))}."

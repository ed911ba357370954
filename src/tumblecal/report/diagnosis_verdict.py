"""The verdict record of a diagnosis: errors found, open questions, evidence, and what to do next."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from tumblecal.data.position_comments import identity_words
from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import Cause, id_of
from tumblecal.diagnosis.causes.generic import UNEXPLAINED
from tumblecal.diagnosis.findings.factors import Factor, Reason
from tumblecal.estimation.plausibility import implausible_words
from tumblecal.ground.counted import shortened
from tumblecal.ground.numbers_shown import changed, p_words
from tumblecal.lab.diagnosed_use import diagnosed_use
from tumblecal.planning.next_plan import NextPlan
from tumblecal.report.calibration_words import gravity_warning, many_settings_words
from tumblecal.report.cause_words import (
    ambiguity,
    by_finding,
    label_words,
    less_probable_words,
    odds_words,
    order_sizes,
    patchwork_words,
    polynomial_words,
    size_words,
    unexplained_words,
)
from tumblecal.report.diagnosis_details import details
from tumblecal.report.unnamed_words import command_for_law, unnamed_findings
from tumblecal.show.next_plan import next_words
from tumblecal.show.verdict import Finding, Unresolved, Verdict, as_sentence


_NUMBERS = {1: "One", 2: "Two", 3: "Three", 4: "Four", 5: "Five", 6: "Six"}
# If the noise of the raw samples does not explain the dispersion of the positions.
_NOT_IN_SAMPLES = (
    "The raw samples do not show this noise. It is slower than a dwell, or it comes from setting the positions (repeatability "
    "of the head, handling)."
)
_MOST_OTHERS, _LEAST_OTHER = 4, 0.02
_MOST_MEMBERS = 4
_COLUMN_WORDS = {"time_s": "time", "temperature_degc": "temperature", "pitch": "the pitch angle"}
_REASONS = {
    "identity": (
        "the same function in a 1 g field (u_x^2 + u_y^2 + u_z^2 = 1), with equal corrections: no measurement in gravity "
        "distinguishes them"
    ),
    "size": "the error is too small; one three times as large would be distinguished",
    "angles": "the same signal at these angles",
    "unnamed": "it may be an effect that is not in the catalogue",
}


def verdict_of_diagnosis(diagnosis: Diagnosis, plan: NextPlan | None = None, folder: Path | None = None) -> Verdict:
    """The verdict of a diagnosis.

    `plan`: the next measurement, if requested. `folder`: where its plans are written; None: no plans are written, so no
    commands are suggested.
    """
    before = [*_before_causes(diagnosis), *unnamed_findings(diagnosis)]
    together = findings_of_causes(diagnosis)
    causes = [_finding(diagnosis, of_finding) for of_finding in together.values()]
    numbers = {cause.label: number for number, of_finding in together.items() for cause in of_finding}
    found = (*before, *causes, *_unnamed(diagnosis))
    open_causes = sum(not factor.resolved for factor in diagnosis.factors)
    return Verdict(
        verdict=diagnosis.verdict,
        headline=headline(diagnosis, len(found), open_causes),
        source=Path(diagnosis.data.source).name,
        use=diagnosed_use(diagnosis).words,
        found=found,
        unresolved=tuple(_unresolved(diagnosis, numbers)),
        evidence=tuple(_evidence(diagnosis)),
        next=tuple(_next(diagnosis, plan, folder, numbers)),
        details=tuple(details(diagnosis)),
    )


def findings_of_causes(diagnosis: Diagnosis) -> dict[int, tuple[Cause, ...]]:
    """Causes of each finding by its number; errors of the data, of their noise and unnamed ones come before."""
    before = len([*_before_causes(diagnosis), *unnamed_findings(diagnosis)])
    # A candidate law states the unnamed error more exactly.
    with_law = diagnosis.unnamed is not None and diagnosis.unnamed.law is not None
    together = by_finding([cause for cause in diagnosis.members if cause.named or not with_law])
    return dict(enumerate(together, before + 1))


def first_unnamed(diagnosis: Diagnosis) -> int:
    """Number of the first finding of an unexplained error."""
    return sum(1 for _ in _before_causes(diagnosis)) + 1


def headline(diagnosis: Diagnosis, found: int, open_causes: int) -> str:
    """The consequence of the verdict in a line.

    `found`: number of findings. `open_causes`: number of causes that others can replace.
    """
    if diagnosis.implausible:
        stated = all(unusual.stated is not None for unusual in diagnosis.implausible)
        if not diagnosis.best.labels:
            return (
                "Stated parameter values are contradicted: without these stated values the data are consistent with the "
                "nominal model."
                if stated
                else "Implausible parameter values: the nominal model fits only with them. Check the set-up first."
            )
        return "Stated parameter values are contradicted." if stated else "Implausible values. Check the set-up first."
    p_value = p_words(diagnosis.screened.detection.p_value)
    if diagnosis.verdict == "adequate":
        noise = 1e3 * diagnosis.level * float(np.median(diagnosis.problem.sd))
        return f"No error found that {len(diagnosis.data)} positions with {noise:.2g} mg noise can show ({p_value})."
    if diagnosis.verdict == "unexplained":
        where = " that acts on all positions" if diagnosis.located else ""
        return f"The nominal model is rejected ({p_value}); no catalogued effect{where} explains the data."
    if not diagnosis.best.labels:
        return _of_data(diagnosis)
    count = f"{_NUMBERS.get(found, found)} error{'s' if found > 1 else ''} found"
    if diagnosis.verdict == "identified":
        return f"{count} and identified (probability {diagnosis.best.probability:.2f})."
    if open_causes:
        which = "the cause of one is" if open_causes == 1 else f"the causes of {open_causes} are"
        return f"{count}; {'its cause is' if found == 1 else which} not resolved."
    others = (e.probability for e in diagnosis.screened.explanations if e is not diagnosis.best)
    way = ambiguity(diagnosis.best.probability, others, indistinguishable=not diagnosis.best.single_name)
    return f"The nominal model is rejected; {way}."


def _of_data(diagnosis: Diagnosis) -> str:
    """Headline if only the data or their noise are in error."""
    faults = {
        "the data do not agree with their columns": diagnosis.setup_errors,
        "the noise is not as assumed": diagnosis.noise_labels,
    }
    wrong = " and ".join(words for words, there in faults.items() if there)
    doubt = ""
    if diagnosis.verdict == "ambiguous":
        unnamed = diagnosis.located or any(fault.alternative == UNEXPLAINED for fault in diagnosis.noise_wrong.values())
        probability = f" (probability {diagnosis.best.probability:.2f})"
        doubt = ", or an effect without an entry is present" if unnamed else probability
    return f"{as_sentence(wrong)}{doubt}; otherwise the data are consistent with the nominal model."


def _before_causes(diagnosis: Diagnosis) -> Iterator[Finding]:
    """Implausible values, and errors of the data and of their noise."""
    yield from (Finding(words) for words in implausible_words(diagnosis.implausible))
    for setup_error in dict.fromkeys(diagnosis.setup_errors):
        yield Finding(f"{as_sentence(setup_error.description)}; corrected in this diagnosis", id=setup_error.label)
    for label, fault in diagnosis.noise_wrong.items():
        yield Finding(f"Noise: {fault.words}", id=label)


def _unnamed(diagnosis: Diagnosis) -> Iterator[Finding]:
    """Errors that no entry describes, and where an unexplained error is."""
    if diagnosis.best.unexplained and not diagnosis.members:
        yield Finding(f"An effect that is not in the catalogue ({unexplained_words(diagnosis)})")
    if diagnosis.verdict == "unexplained":
        yield from (Finding(words) for words in _located(diagnosis))


def _finding(diagnosis: Diagnosis, causes: Sequence[Cause]) -> Finding:
    cause, *further = causes
    if further:
        return Finding(*polynomial_words(diagnosis, causes), label_words(tuple([one.label for one in causes])))
    if not cause.named:
        return Finding(f"An effect that is not in the catalogue ({cause.words})", id=UNEXPLAINED)
    id, _, positions = cause.label.partition(":")
    words = title(diagnosis.entries[id].cause)
    if positions:
        known = f" ({cause.words})" if cause.words else ""
        return Finding(f"{words}, at {positions.replace('+', ' and ')}{known}", id=id)
    if cause.slot.of_several_orders:
        return Finding(words, order_sizes(diagnosis, cause), id)
    sizes = [size.removeprefix(f"{id} = ") for _, size in size_words(diagnosis, cause)]
    return Finding(words, "; ".join(sizes), id)


def title(cause: str) -> str:
    """A catalogue entry's cause without explanation in brackets or after a colon: `The x axis ends at its range`."""
    for mark in (":", " ("):
        first = cause.partition(mark)[0]
        cause = first if first.count(" ") > 1 else cause
    return cause.removesuffix(".")


def _located(diagnosis: Diagnosis) -> Iterator[str]:
    unnamed = diagnosis.best.labels == (UNEXPLAINED,)
    acts = "an unnamed effect" if unnamed else "these causes"
    for located in diagnosis.located:
        yield f"{located.words}. Odds in favour of this, against {acts} at all positions: {odds_words(located.log_odds)}"


def _unresolved(diagnosis: Diagnosis, numbers: Mapping[str, int]) -> Iterator[Unresolved]:
    for factor in sorted(diagnosis.factors, key=lambda one: (one.resolved, numbers.get(one.members[0][0], 0))):
        yield from alternatives(factor, numbers)
    yield from map(Unresolved, less_probable_words(diagnosis.best))
    if patchwork := patchwork_words(diagnosis):
        yield Unresolved(patchwork)
    if diagnosis.verdict != "unexplained":
        yield from (Unresolved(words) for words in _located(diagnosis))
    yield from (Unresolved(words) for words in filter(None, [identity_words(diagnosis.data)]))


def alternatives(factor: Factor, numbers: Mapping[str, int]) -> Iterator[Unresolved]:
    """The causes that can take the place of one that was found, those of one reason together.

    `numbers`: of the findings, by label.
    """
    first, *others = factor.members
    by_reason: dict[Reason, list[tuple[str, ...]]] = {}
    for labels, reason in zip(others, factor.reasons, strict=True):
        same = next((known for known in by_reason if known[:2] == reason[:2]), reason)
        by_reason.setdefault(same, []).append(labels)
    about = tuple([numbers[label] for label in first if label in numbers])
    for reason, sets in by_reason.items():
        yield Unresolved(_either([first, *sets]), reason_words(reason), about)


def reason_words(reason: Reason) -> str:
    """Why causes cannot be distinguished."""
    if reason.kind == "columns":
        first, second = (_COLUMN_WORDS.get(name, name) for name in reason.columns)
        return f"{first} and {second} are fully correlated in these data (r = {reason.r:.2f})"
    if reason.kind == "range":
        return f"{_COLUMN_WORDS.get(reason.columns[0], reason.columns[0])} does not vary enough in these data"
    return _REASONS[reason.kind]


def _either(sets: Sequence[tuple[str, ...]]) -> str:
    return shortened(list(map(label_words, sets)), _MOST_MEMBERS, " or ", " or")


def _evidence(diagnosis: Diagnosis) -> Iterator[str]:
    test = diagnosis.screened.detection
    slow = ", slow noise included" if diagnosis.problem.correlated and not diagnosis.noise_labels else ""
    noise = f"stated noise{slow}" if diagnosis.problem.known else "noise estimated from the data"
    if diagnosis.samples is not None:
        level = "" if diagnosis.problem.known else ", its level estimated from the data"
        noise = f"noise of {diagnosis.samples.origin}{level}"
    before = f"; under the noise as assumed {p_words(diagnosis.assumed_p_value)}" if diagnosis.noise_labels else ""
    tested = f"{p_words(test.p_value)} (global test over all causes, {noise}{before})"
    if diagnosis.implausible and not test.detected:
        # The test uses the fitted values, so it does not confirm them.
        yield f"With these values the residuals are consistent with the noise, {tested}; this does not confirm them."
    else:
        yield f"Nominal model {'' if test.detected else 'not '}rejected, {tested}."
    if not diagnosis.best.labels:
        size, dof = diagnosis.nominal.rms * 1e3, diagnosis.nominal.dof
        yield f"Residuals: {size:.3g} mg rms with {diagnosis.model.nominal} parameters, {dof} degrees of freedom."
        if diagnosis.noise_labels:
            yield _probability(diagnosis)
        return
    yield _probability(diagnosis)
    if diagnosis.screened.contradicted:
        yield "The linearised fit favoured these causes, but their exact fit does not reproduce the data."
    gain = diagnosis.gain
    before_mg, after_mg = gain.cv_rms_before_g * 1e3, gain.cv_rms_after_g * 1e3
    same = (
        ""
        if gain.cv_same_causes is None
        else f"; {100 * gain.cv_same_causes:.0f} % of the folds select the same causes"
    )
    yield f"Held-out error {changed(before_mg, after_mg, gain.cv_gain_sd_g * 1e3)} mg ({gain.cv_kind}){same}."
    if after_mg > before_mg:
        yield "Warning: the extended model predicts held-out positions WORSE. Do not use it to correct other positions."


def _probability(diagnosis: Diagnosis) -> str:
    """Probability of the statement, and the next explanations with theirs."""
    of = "this class of causes" if diagnosis.best.separable else "this explanation"
    explanations = diagnosis.screened.explanations
    others = [e for e in explanations if e is not diagnosis.best and e.more_probable_than(_LEAST_OTHER)]
    nothing = "no other error" if diagnosis.noise_labels else "adequate"
    listed = ", ".join(f"{label_words(e.labels) or nothing} {e.probability:.2f}" for e in others[:_MOST_OTHERS])
    return f"Probability of {of} {diagnosis.best.probability:.2f}{f'; next: {listed}' if listed else ''}."


def _next(
    diagnosis: Diagnosis, plan: NextPlan | None, folder: Path | None, numbers: Mapping[str, int]
) -> Iterator[str]:
    if diagnosis.implausible and any(unusual.stated is None for unusual in diagnosis.implausible):
        yield "Check the set-up. A rig file can state other usual values ([usual])."
    if gravity := gravity_warning(diagnosis.extended):
        yield f"WARNING: {gravity}"
    if many := many_settings_words(diagnosis.nominal):
        yield as_sentence(many)
    if diagnosis.noise_labels and diagnosis.samples is not None:
        yield _NOT_IN_SAMPLES
    if plan is not None:
        yield from next_words(diagnosis, plan, folder, numbers)
        if folder is not None:
            yield from command_for_law(diagnosis, folder)
    causes = [id_of(cause.label) for cause in diagnosis.members if cause.named]
    by_advice: dict[str, dict[str, None]] = {}
    for id in (*(setup_error.label for setup_error in diagnosis.setup_errors), *diagnosis.noise_labels, *causes):
        by_advice.setdefault(diagnosis.entries[id].advice, {})[id] = None
    yield from (f"{', '.join(ids)}: {advice}" for advice, ids in by_advice.items())

"""The verdict of a check: it agrees, the sensor changed, or an attitude must be repeated."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from tumblecal.check.drift import ProcessNoise
from tumblecal.check.result import CheckResult
from tumblecal.check.update import Update
from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.estimation.attitudes import attitude_words
from tumblecal.ground.numbers_shown import p_words
from tumblecal.ground.suggested_command import suggested
from tumblecal.report.check_words import (
    attitudes_words,
    change_in_use,
    explanation_size,
    explanation_words,
    explanations_words,
    limit_words,
    probability_words,
    rest_words,
    sensitivity_words,
    size_of_gravity_words,
    test_words,
    unseen_lines,
    worst_words,
)
from tumblecal.report.verdict import Finding, Unresolved, Verdict, as_sentence


TONES = {"agrees": "good", "changed": "bad", "repeat": "open"}


def verdict_of_check(
    result: CheckResult,
    words: Sequence[object],
    made: tuple[Update, ProcessNoise] | None = None,
    written: Path | None = None,
) -> Verdict:
    """The verdict.

    **Arguments:**

    - `words`: calibration and recording, for suggested commands. `made`: update and process noise. `written`: the file of an
      update that is asked for.
    """
    return Verdict(
        result.outcome,
        _headline(result),
        result.data.source,
        result.use.words,
        tuple(_found(result)),
        tuple(_unresolved(result)),
        tuple(_evidence(result, made, written)),
        tuple(_next(result, words, written if made is not None else None)),
        tuple(_details(result)),
    )


def _headline(result: CheckResult) -> str:
    if result.outcome == "agrees":
        return f"The calibration agrees with {attitudes_words(result)} ({p_words(result.test.p_value)})."
    if result.disturbed:
        others = len(result.data) - 1
        return f"Attitude {result.disturbed} contradicts the calibration; the other {others} agree with it."
    if result.outcome == "repeat":
        return (
            f"The attitudes disagree with each other, whatever the parameters are ({p_words(result.test.rest_p or 0)})."
        )
    assert result.moved is not None
    named = result.moved.named
    if named is not None:
        size = explanation_size(named)
        changed = (
            f"the {explanation_words(named)}" if named.kind in ("bias", "scale", "angle") else explanation_words(named)
        )
        probability = probability_words(named.probability)
        return f"The sensor changed: {changed}{f' by {size}' if size else ''} (probability {probability})."
    if result.moved.biases > 0.95:
        return "The sensor changed: a bias; these attitudes do not show which one."
    return "The sensor changed; these attitudes do not show which parameter."


def _found(result: CheckResult) -> Iterator[Finding]:
    if result.moved is None:
        return
    named = result.moved.named
    if named is not None:
        id = named.parameters[0] if len(named.parameters) == 1 else ""
        what = explanation_words(named)
        words = as_sentence(what) if result.disturbed else f"Change of the {what}" if id else f"Change of {what}"
        yield Finding(words, explanation_size(named), id)
    if not result.disturbed:
        yield Finding("Largest change of a corrected force over all attitudes", change_in_use(result))


def _unresolved(result: CheckResult) -> Iterator[Unresolved]:
    if result.moved is not None and result.moved.named is None:
        yield Unresolved("Which parameter changed (probability)", f"{explanations_words(result)}.", (1,))
    if result.gravity.unknown:
        yield Unresolved("Gravity is not compared", f"{result.gravity.words}.")
    if result.outside_degc is not None:
        low, high = result.outside_degc
        at = f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
        reason = "its temperature dependence is not in the calibration, and looks like a change of the sensor."
        yield Unresolved(f"Recorded at {at} degC, outside the range of the calibration", reason)
    if result.test.disagree and not result.disturbed:
        yield from (Unresolved(f"{line}.") for line in rest_words(result))
    yield from (Unresolved("Not visible", f"{line}.") for line in unseen_lines(result))


def _evidence(result: CheckResult, made: tuple[Update, ProcessNoise] | None, written: Path | None) -> Iterator[str]:
    yield f"{test_words(result)}."
    yield f"{size_of_gravity_words(result)}."
    yield f"{sensitivity_words(result)}."
    if made is not None:
        update, process = made
        low, high = update.ratio.min(), update.ratio.max()
        yield f"{written}: standard uncertainties {low:.2g} to {high:.2g} times those before."
        yield f"Process noise of the update: {process.source}."


def _next(result: CheckResult, words: Sequence[object], written: Path | None) -> Iterator[str]:
    if result.outcome == "repeat":
        name = f"attitude {result.disturbed}" if result.disturbed else "the attitudes"
        yield f"Record {name} again, at rest on a firm support, and repeat the check."
        return
    if written is not None:
        yield f"Use the updated calibration, {written}, and keep the previous one with its check."
    if result.outcome == "agrees":
        if further := _further(result):
            yield further
        if written is None:
            yield "To improve the calibration with this recording:"
            yield suggested("check", *words, "--update", "updated.json")
        return
    if written is not None:
        return
    assert result.moved is not None
    named = result.moved.named
    if named is None:
        if result.moved.separating:
            attitudes = "; ".join(attitude.words for attitude in result.moved.separating)
            yield f"To see which parameter changed, record in addition: {attitudes}. Then repeat the check with all attitudes."
        yield "Calibrate the unit again, or correct only what is known to have changed (--update FILE --free PARAMETER)."
        return
    if len(named.parameters) == 1:
        yield f"To correct only the {explanation_words(named)}, with an uncertainty from this recording:"
        yield suggested("check", *words, "--update", "updated.json", "--free", named.parameters[0])
    yield "Otherwise calibrate the unit again." if len(named.parameters) == 1 else "Calibrate the unit again."


def _further(result: CheckResult) -> str:
    """Further attitudes for parameters that the recording hardly shows; "" if it shows all."""
    seen = result.sensitivity
    if not (seen.invisible or len(seen.hidden) or 0 < len(seen.poorly_visible) < len(SENSOR)):
        return ""
    words = attitude_words(result.noise.data.readings)
    return f"To see these changes too, record in addition: {words}." if words else ""


def _details(result: CheckResult) -> Iterator[tuple[str, str]]:
    yield "Noise of the attitudes", f"{result.noise.words}."
    if not result.test.disagree:
        yield from (("Attitudes among themselves", f"{line}.") for line in rest_words(result))
    if result.test.dof:
        yield "Most difficult visible change", f"{worst_words(result)}, detected with probability 0.8."
        yield "Sensitivity is limited by", f"{limit_words(result)}."
    yield "Gravity", f"{result.gravity.words}."
    if result.expected.degc is not None:
        yield "Temperature", f"{result.expected.degc:.4g} degC."

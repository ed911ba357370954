"""A diagnosis for people: its words, its verdict, and all its files."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tumblecal.data.calibration import calibration_text
from tumblecal.data.position_comments import WITHIN_DWELLS, identity_words
from tumblecal.data.positions import joined_arguments
from tumblecal.data.sensor_parameters import SENSOR, leaf_of
from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import Cause, id_of, label_words
from tumblecal.diagnosis.causes.generic import UNEXPLAINED
from tumblecal.diagnosis.coefficients import about_one_reference, coefficients, findings_of_causes, first_unnamed
from tumblecal.diagnosis.findings.candidate_law import Term, law_words, term_words
from tumblecal.diagnosis.findings.factors import Factor, Reason
from tumblecal.diagnosis.sets.patchwork import Neighbours, is_patchwork
from tumblecal.estimation.identifiability import formula
from tumblecal.estimation.mountings import mounting_words
from tumblecal.estimation.plausibility import implausible_words
from tumblecal.ground.atomic import writable_folder, write_texts
from tumblecal.ground.json_file import json_text
from tumblecal.lab.diagnosed_use import diagnosed_use, lacking_of_diagnosis
from tumblecal.lab.extended_rig import NAME as EXTENDED_RIG
from tumblecal.lab.extended_rig import extended_rig_text
from tumblecal.lab.sensor_terms import held_words
from tumblecal.plan.next.record import DiagnosisWithPlanRecord
from tumblecal.planning import NextPlan
from tumblecal.show.fit import fit_words
from tumblecal.show.next_plan import next_plan_texts, next_words
from tumblecal.show.verdict import Finding, Unresolved, Verdict, verdict_lines
from tumblecal.show.words import Words, words_of
from tumblecal.words import text_of


SUGGESTED = "suggested_effect.py"
# Changes of parameters and harms of undetectable effects that are listed; smaller changes (in u) are not.
_MOST_LISTED, _LEAST_CHANGE_U = 3, 0.5
# Uncertainties are listed from this multiple of the noise's on, with so many effects that contribute most.
_MUCH_WIDER, _MOST_EFFECTS = 2.0, 2
_OF_SENSOR = {leaf_of(name) for name in SENSOR}


def words_of_diagnosis(
    diagnosis: Diagnosis,
    plan: NextPlan | None = None,
    folder: Path | None = None,
    template: str = "diagnosis",
    **more: Any,
) -> Words:
    """The words of a diagnosis.

    **Arguments:**

    - `plan`: the next measurement, if requested. `folder`: where its plans are written; None: no plans are written, so no
      commands are suggested.
    - `template`: that of the verdict, or one that includes it; `more`: further values that it uses.
    """
    best, unnamed = diagnosis.best, diagnosis.unnamed
    findings, first = findings_of_causes(diagnosis), first_unnamed(diagnosis)
    numbers = {cause.label: number for number, causes in findings.items() for cause in causes}
    neighbours = Neighbours(diagnosis.screened.at) if (UNEXPLAINED,) in best.equivalents else None
    moved, harm = diagnosis.shifts, harm_in_u(diagnosis)
    changes = [item for item in moved.items() if abs(item[1].in_sd) > _LEAST_CHANGE_U]
    changes = sorted(changes, key=lambda item: -abs(item[1].in_sd))[:_MOST_LISTED]
    largest = [max((abs(size), id, name) for name, size in of.items()) for id, of in harm.items() if of]
    faults = [*(error.label for error in diagnosis.setup_errors), *diagnosis.noise_wrong]
    ids = dict.fromkeys([*faults, *(id_of(cause.label) for cause in diagnosis.members)])
    named = [diagnosis.entries[id] for id in ids if id in diagnosis.entries]
    advice: dict[str, list[str]] = {}
    for entry in named:
        advice.setdefault(entry.advice, []).append(entry.id)
    of_fit, of_nominal = fit_words(diagnosis.extended), fit_words(diagnosis.nominal)
    return words_of(
        template,
        d=diagnosis,
        plan=plan,
        use=diagnosed_use(diagnosis),
        source=Path(diagnosis.data.source).name,
        noise_mg=1e3 * diagnosis.level * float(np.median(diagnosis.problem.sd)),
        unusual=implausible_words(diagnosis.implausible),
        first=first,
        count=first - 1 + len(findings) + bool(best.unexplained and not diagnosis.members),
        findings=[_finding(diagnosis, number, causes) for number, causes in findings.items()],
        law=unnamed and unnamed.law,
        alternatives=list(alternatives(diagnosis.factors, numbers)),
        dead_zone=neighbours and neighbours.at_a_jump(best.labels),
        patchwork=neighbours and is_patchwork(best.labels, neighbours=neighbours),
        identity=identity_words(diagnosis.data),
        gravity_warning=of_fit.text("gravity warning"),
        gravity=of_fit.text("gravity"),
        many_settings=of_nominal.text("many settings"),
        read_settings=of_nominal.text("read settings"),
        steps=[] if plan is None else list(next_words(diagnosis, plan, folder, numbers)),
        folder=plan and folder,
        files=joined_arguments(diagnosis.data.files or [diagnosis.data.source]),
        suggested=SUGGESTED,
        changes=changes if changes and abs(changes[0][1].in_sd) > 1.0 else [],
        wider=_wider(diagnosis),
        named=named,
        advice=advice,
        mountings=mounting_words(diagnosis.mountings),
        held=list(held_words(diagnosis.extended, diagnosis.model.nominal_chain, diagnosis.entries)),
        missed=list(lacking_of_diagnosis(diagnosis)),
        within_dwells=diagnosis.data.comments.get(WITHIN_DWELLS),
        harm=harm,
        largest_harm=sorted(largest, reverse=True)[:_MOST_LISTED],
        undetermined=[name for name in diagnosis.extended.undetermined if name in moved],
        found_elsewhere=[id for id, entry in diagnosis.entries.items() if entry.found_as],
        formula=formula,
        label_words=label_words,
        law_words=law_words,
        title=_title,
        **more,
    )


def verdict_of_diagnosis(diagnosis: Diagnosis, plan: NextPlan | None = None, folder: Path | None = None) -> Verdict:
    """The verdict of a diagnosis, with the arguments of `words_of_diagnosis`."""
    return words_of_diagnosis(diagnosis, plan, folder).verdict


def _finding(diagnosis: Diagnosis, number: int, causes: Sequence[Cause]) -> dict[str, Any]:
    """A finding with the sizes that the data determine, and the reference of those of a polynomial."""
    sizes, reference = about_one_reference(diagnosis, causes)
    if not sizes:
        listed = [one for cause in causes for one in coefficients(diagnosis, cause)]
        known = {name for one in listed if one.sd is not None for name in one.weights}
        sizes = [one for one in listed if one.sd is not None or known.isdisjoint(one.weights)]
    return {"number": number, "causes": causes, "sizes": sizes, "reference": reference}


def alternatives(factors: Sequence[Factor], numbers: Mapping[str, int]) -> Iterator[dict[str, Any]]:
    """The causes that can take the place of those that were found, those of one reason together, open questions first.

    **Arguments:**

    - `numbers`: of the findings, by label.
    """
    for factor in sorted(factors, key=lambda one: (one.resolved, numbers.get(one.members[0][0], 0))):
        first, *others = factor.members
        by_reason: dict[tuple, tuple[Reason, list[str]]] = {}
        for labels, reason in zip(others, factor.reasons, strict=True):
            by_reason.setdefault(reason[:2], (reason, [label_words(first)]))[1].append(label_words(labels))
        about = [numbers[label] for label in first if label in numbers]
        yield from ({"about": about, "sets": sets, "reason": reason} for reason, sets in by_reason.values())


def _title(cause: str) -> str:
    """A catalogue entry's cause without explanation in brackets or after a colon: `The x axis ends at its range`."""
    for mark in (":", " ("):
        first = cause.partition(mark)[0]
        cause = first if first.count(" ") > 1 else cause
    return cause.removesuffix(".")


def _wider(diagnosis: Diagnosis) -> list[tuple[str, float, list[str]]]:
    """The sensor parameters whose uncertainties exceed those of the noise most: name, ratio, and the undetected effects that
    contribute most; [] if the other explanations contribute more."""
    used, parts, listed = diagnosis.in_use, diagnosis.in_use.parts, []
    for k, name in enumerate(used.names[: diagnosis.model.nominal]):
        if leaf_of(name) in _OF_SENSOR and used.sd[k] > _MUCH_WIDER * parts["noise"][k] > 0:
            undetected = parts["undetected_effects"][k] > parts["explanations"][k]
            effects = used.undetected.strongest(k, _MOST_EFFECTS) if undetected else []
            listed.append((name, float(used.sd[k] / parts["noise"][k]), effects))
    return sorted(listed, key=lambda one: -one[1])[:_MOST_LISTED]


def harm_in_u(diagnosis: Diagnosis) -> dict[str, dict[str, float]]:
    """Change of each parameter that an undetectable effect of its typical size causes, in standard uncertainties of the
    calibration file, by effect and parameter."""
    used = diagnosis.in_use
    u = dict(zip(used.names, used.sd.tolist(), strict=True))
    return {
        id: {name: shift["shift"] / u[name] if u[name] > 0 else 0.0 for name, shift in hidden.harm.items()}
        for id, hidden in diagnosis.invisible.items()
    }


def write_diagnosis(
    folder: Path,
    diagnosis: Diagnosis,
    plan: NextPlan,
    *,
    figures: bool,
    said: Mapping[str, Any] | None = None,
    verdict: Verdict | None = None,
) -> list[str]:
    """Write diagnosis.json, verdict.txt; calibration.json, extended_rig.toml, suggested_effect.py and plans if there are any;
    figures and page.

    `said`: what else the provenance of the calibration says, such as of the head (`MeasuredHead.record`). `verdict`: the record
    to write; by default that of the diagnosis, with commands for this folder.

    **Returns:** their names.
    """
    if not folder.is_dir():
        writable_folder(folder)
    verdict = verdict or verdict_of_diagnosis(diagnosis, plan, folder)
    text = "\n".join(verdict_lines(verdict))
    texts = {"diagnosis.json": json_text(record(diagnosis, plan, verdict)), "verdict.txt": f"{text}\n"}
    if (calibration := diagnosis.calibration) is not None:
        provenance = calibration.provenance | dict(said or {})
        texts["calibration.json"] = calibration_text(replace(calibration, provenance=provenance))
    texts |= {EXTENDED_RIG: extended_rig_text(diagnosis), SUGGESTED: suggested_effect(diagnosis)}
    texts = {name: text for name, text in texts.items() if text} | next_plan_texts(diagnosis, plan, folder)
    write_texts(folder, texts)
    if not figures:
        return [*texts]
    from tumblecal.show.diagnosis_page import write_diagnosis_page
    from tumblecal.show.figures.diagnosis import figures_of
    from tumblecal.show.figures.drawing import write_each

    drawn = write_each(folder, figures_of(diagnosis), diagnosis)
    return [*texts, *drawn, *write_diagnosis_page(folder / "diagnosis.html", diagnosis, plan, drawn, verdict)]


class DiagnosisFile(DiagnosisWithPlanRecord):
    """`diagnosis.json`: a diagnosis, the next measurement, and the verdict."""

    findings: list[Finding]
    unresolved: list[Unresolved]


def record(diagnosis: Diagnosis, plan: NextPlan, verdict: Verdict | None = None) -> DiagnosisFile:
    """The record of a diagnosis, a plan and a verdict; the verdict by default that of the two."""
    verdict = verdict or verdict_of_diagnosis(diagnosis, plan)
    return DiagnosisFile.of(
        diagnosis,
        plan=plan,
        use=diagnosed_use(diagnosis),
        text="\n".join(verdict_lines(verdict)),
        findings=verdict.found,
        unresolved=verdict.unresolved,
    )


def suggested_effect(diagnosis: Diagnosis) -> str:
    """The candidate law of an unexplained error as effects for `--effects`; "" without one."""
    if diagnosis.unnamed is None or diagnosis.unnamed.law is None:
        return ""
    named: dict[str, Term] = {}
    for term in diagnosis.unnamed.law.terms:
        id = f"{term.form.name}{'_' if term.of_head else '.'}{term.acts_on}"
        while id in diagnosis.entries or id in named:
            id = f"again_{id}"
        named[id] = term
    return text_of(
        "suggested_effect.j2",
        source=diagnosis.data.source.replace("\\", "/").replace('"', "'"),
        law=diagnosis.unnamed.law,
        named=named,
        term_words=term_words,
        hypot=math.hypot,
    )

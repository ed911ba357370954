"""An unexplained error in words: where it is, how large, and its candidate law, also as effects for `--effects`."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tumblecal.data.positions import joined_arguments
from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.findings.candidate_law import Law, Term
from tumblecal.diagnosis.findings.unexplained import Unnamed
from tumblecal.ground.numbers_shown import changed, rounded_together
from tumblecal.ground.suggested_command import suggested
from tumblecal.show.verdict import Finding


SUGGESTED = "suggested_effect.py"
_ANGLE_WORDS = {"alpha": "spindle angle alpha", "beta": "pitch angle beta"}


def unnamed_findings(diagnosis: Diagnosis) -> Iterator[Finding]:
    """Where an unexplained error is, and its candidate law."""
    unnamed = diagnosis.unnamed
    if unnamed is not None:
        yield Finding(unnamed.excess.words)
        if unnamed.law is not None:
            yield Finding(f"Candidate law: {law_words(unnamed.law)}", f"{held_out_words(unnamed.law)}; {SUGGESTED}")


def command_for_law(diagnosis: Diagnosis, folder: Path) -> Iterator[str]:
    """The command that tests the candidate law."""
    if diagnosis.unnamed is not None and diagnosis.unnamed.law is not None:
        yield "To test the candidate law, with the new positions joined if there are any:"
        files = diagnosis.data.files or [diagnosis.data.source]
        yield suggested("diagnose", *joined_arguments(files), "--effects", folder / SUGGESTED, "--out", "with_law")


def law_words(law: Law) -> str:
    """The terms of the law, each with the output or angle that it acts on."""
    return "; ".join(term_words(term) for term in law.terms)


def term_words(term: Term) -> str:
    """`z: 0.52 +- 0.06 mg/g^3 u_x u_y^2`."""
    sizes = [
        f"({rounded_together(1e3 * size, 1e3 * sd)}) {term.unit} {words}"
        for size, sd, words in zip(term.sizes, term.sd, term.form.words, strict=True)
    ]
    return f"{_ANGLE_WORDS.get(term.acts_on, f'output {term.acts_on}')}: {' + '.join(sizes)}"


def held_out_words(law: Law) -> str:
    """The held-out improvement."""
    return f"held-out error {changed(law.before_g * 1e3, law.after_g * 1e3)} mg"


def unnamed_record(unnamed: Unnamed | None) -> dict[str, Any] | None:
    """As plain numbers and texts; g, rad and the units stated."""
    if unnamed is None:
        return None
    excess, law = unnamed.excess, unnamed.law
    return {
        "region": excess.region or None,
        "positions": [unnamed.fit.problem.names[k] for k in np.flatnonzero(excess.positions).tolist()],
        "ranges_g": {part.axis: [part.low, part.high] for part in excess.ranges},
        "law": None
        if law is None
        else {
            "terms": [
                {
                    "acts_on": term.acts_on,
                    "words": list(term.form.words),
                    "coefficients": [1e3 * size for size in term.sizes],
                    "u": [1e3 * sd for sd in term.sd],
                    "unit": term.unit,
                }
                for term in law.terms
            ],
            "held_out_before_g": law.before_g,
            "held_out_after_g": law.after_g,
            "same_in_folds": law.same,
        },
    }


_HEAD = '''\
"""Candidate law of an error that no entry of the catalogue explains, by tumblecal diagnose of {source}.

{law}
It was found in these data, so these data cannot confirm it: measure further positions, and give them and this file to

    tumblecal diagnose --effects suggested_effect.py

Change names, units and the text of `cause` as you like; keep the file for later measurements if the effect is named again.
"""
'''


def suggested_effect_text(diagnosis: Diagnosis) -> str:
    """The file; "" if there is no candidate law."""
    law = diagnosis.unnamed.law if diagnosis.unnamed is not None else None
    if law is None:
        return ""
    words = "\n".join([*(f"{term_words(term)}." for term in law.terms), f"Cross-validation: {held_out_words(law)}."])
    source = diagnosis.data.source.replace("\\", "/").replace('"', "'")
    lines = [_HEAD.format(source=source, law=words)]
    code = [line for term in law.terms for line in term.form.code]
    makers = {"angle_effect" if term.of_head else "output_effect" for term in law.terms}
    if any("jnp." in line for line in code):
        lines += ["import jax.numpy as jnp", ""]
    lines.append(f"from tumblecal.effects import {', '.join(sorted(makers))}")
    if any("elapsed(" in line for line in code):
        lines.append("from tumblecal.effects.effect import elapsed")
    lines += ["", "", "EFFECTS = ["]
    used_ids = set(diagnosis.entries)
    for term in law.terms:
        lines += [f"    {line}" for line in _entry(term, used_ids)]
    return "\n".join([*lines, "]", ""])


def _entry(term: Term, used_ids: set[str]) -> Iterator[str]:
    form, on = term.form, term.acts_on
    base = f"{form.name}_{on}" if term.of_head else f"{form.name}.{on}"
    id = next(id for id in (base, *(f"again_{k}_{base}" for k in range(1, len(used_ids) + 2))) if id not in used_ids)
    used_ids.add(id)
    maker, argument = ("angle_effect", "angle") if term.of_head else ("output_effect", "u")
    several = len(form.code) > 1
    what = "The angle" if term.of_head else "Output"
    yield f"{maker}("
    yield f'    "{id}",'
    yield f'    "{on}",'
    yield "    ("
    yield from (f"        lambda {argument}, where: {code}," for code in form.code)
    yield "    ),"
    if several:
        yield '    components=("sin", "cos"),'
    yield f'    unit="{term.unit}",'
    yield f"    typical={float(f'{1e3 * np.linalg.norm(term.sizes):.2g}')!r},"
    yield f'    physics="{_physics(term)}",'
    yield f'    cause="{what} {on} changes with {" and ".join(form.words)}.",'
    yield '    advice="Confirm it with positions that were not measured yet; then look for its origin.",'
    if form.needs:
        yield f"    needs={list(form.needs)},".replace("'", '"')
    if form.held is not None and not term.of_head:
        yield f"    forms=[{ {'axis': on} | form.held }],".replace("'", '"')
    yield "),"


def _physics(term: Term) -> str:
    names = [chr(ord("a") + k) for k in range(len(term.form.words))]
    return " + ".join(f"{name} {words}" for name, words in zip(names, term.form.words, strict=True))

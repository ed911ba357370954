"""`suggested_effect.py`: the candidate law of an unexplained error as effects for `--effects`."""

from collections.abc import Iterator

import numpy as np

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.findings.candidate_law import Term
from tumblecal.report.unnamed_words import held_out_words, term_words


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

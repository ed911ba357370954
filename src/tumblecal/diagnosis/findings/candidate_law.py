"""The sparsest closed form that explains residuals without a catalogue entry.

The forms of `law_shapes` are searched by `law_search`, on one output, all outputs or an angle of the head. A form is accepted
if it explains more than its coefficients cost (BIC, Schwarz 1978) and than its prior weight among all forms does (Chen and Chen
2008). The held-out error is that of the whole procedure: in every fold the law is chosen again from the most likely forms.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from tumblecal.chain import Where
from tumblecal.diagnosis.findings.law_search import ALL_OUTPUTS, ANGLES, Chosen, Dictionary, Products, outputs_of
from tumblecal.diagnosis.findings.law_shapes import Form, forms, nonzero_functions
from tumblecal.diagnosis.findings.residual_space import ResidualSpace
from tumblecal.diagnosis.priors import LAW_FOLDS, LEAST_COEFFICIENT, SURE_LAW
from tumblecal.ground.numbers_shown import rounded_together
from tumblecal.ground.showing import brief


class Term(NamedTuple):
    """One form where it acts: an output (x, y, z) or an angle of the head (alpha, beta); `sizes` of its functions, with their
    standard uncertainties `sd`: g or rad and the form's unit."""

    form: Form
    acts_on: str
    sizes: tuple[float, ...]
    sd: tuple[float, ...]

    @property
    def of_head(self) -> bool:
        """Whether it acts on an angle of the head."""
        return self.acts_on in ANGLES

    @property
    def unit(self) -> str:
        """Unit of the displayed coefficients, 1e-3 of the stored unit."""
        return f"{'mrad' if self.of_head else 'mg'}{self.form.unit}"


@dataclass(frozen=True)
class Law:
    """A closed form, fitted.

    - `terms`. `signal`: contribution to the readings, g (positions, 3).
    - `before_g`, `after_g`: root mean square of held-out errors without and with it.
    - `same`: share of the folds that choose the same first form.
    """

    __repr__ = brief

    terms: tuple[Term, ...]
    signal: Float[np.ndarray, "positions 3"]
    before_g: float
    after_g: float
    same: float


_ANGLE_WORDS = {"alpha": "spindle angle alpha", "beta": "pitch angle beta"}


def law_words(law: Law) -> str:
    """The terms of a law, each with the output or angle that it acts on."""
    return "; ".join(map(term_words, law.terms))


def term_words(term: Term) -> str:
    """`output z: (0.52 +- 0.06) mg/g^3 u_x u_y^2`."""
    sizes = [
        f"({rounded_together(1e3 * size, 1e3 * sd)}) {term.unit} {words}"
        for size, sd, words in zip(term.sizes, term.sd, term.form.words, strict=True)
    ]
    return f"{_ANGLE_WORDS.get(term.acts_on, f'output {term.acts_on}')}: {' + '.join(sizes)}"


def candidate_law(
    whole: ResidualSpace,
    where: Where,
    inputs: Float[np.ndarray, "positions 3"],
    head: Float[np.ndarray, "positions 3 angles"],
) -> Law | None:
    """The law, or None if no form explains enough to predict held-out positions better.

    **Arguments:**

    - `whole`: residual of the fit without it. `inputs`: g.
    - `head`: change of the readings per rad of the spindle angle and of the pitch angle, g.
    """
    every = Dictionary(*nonzero_functions(forms(where), where, inputs), head)
    in_whole = Products.of(every, whole)
    taken = in_whole.chosen()
    if not taken:
        return None
    likely = every.some(in_whole.likely(taken))
    before, after, same = _held_out(likely, whole, where, every.listed[taken[0].form].name)
    rms = float(np.sqrt(np.mean(before**2))), float(np.sqrt(np.mean(after**2)))
    # A prediction that has nothing to do with the errors lowers their sum of squares by less than zero, with this sd.
    if np.sum(before**2 - after**2) < SURE_LAW * 2 * rms[1] * np.linalg.norm(before - after):
        return None
    columns = every.columns(taken, whole.responses)
    sizes, sd = _fitted(columns, whole)
    # Of single readings, the columns are the signals themselves.
    readings = np.eye(head.shape[0] * 3).reshape(-1, *head.shape[:2])
    signal = (every.columns(taken, readings) @ sizes).reshape(-1, 3)
    return Law(tuple(_terms(every, taken, sizes, sd)), signal, *rms, same)


def _fitted(columns: Float[np.ndarray, "nu columns"], whole: ResidualSpace) -> tuple[np.ndarray, np.ndarray]:
    """Sizes and their standard uncertainties."""
    inverse = np.linalg.pinv(columns, rcond=1e-9)
    level = np.sqrt(whole.without(columns).variance)
    return inverse @ whole.z, level * np.linalg.norm(inverse, axis=1)


def _terms(every: Dictionary, taken: Sequence[Chosen], sizes: np.ndarray, sd: np.ndarray):
    at = 0
    for one in taken:
        form = every.listed[one.form]
        for on in outputs_of(one.on):
            here = slice(at, at + len(form.code))
            at += len(form.code)
            if one.on != ALL_OUTPUTS or np.any(np.abs(sizes[here]) > LEAST_COEFFICIENT * sd[here]):
                yield Term(form, on, tuple(sizes[here].tolist()), tuple(sd[here].tolist()))


def _held_out(
    likely: Dictionary, whole: ResidualSpace, where: Where, name: str
) -> tuple[Float[np.ndarray, "positions 3"], Float[np.ndarray, "positions 3"], float]:
    """Errors of held-out positions without a law, and with one chosen without them; share of folds with the same first form.
    Positions that repeat an attitude are held out together."""
    attitude = where.attitude
    order = np.random.default_rng(0).permutation(int(attitude.max()) + 1)
    fold = order[attitude] % LAW_FOLDS
    before, after, same = np.zeros((len(fold), 3)), np.zeros((len(fold), 3)), []
    for number in np.unique(fold).tolist():
        inside = fold == number
        chosen = Products.of(likely, whole.without(whole.of_positions(inside))).chosen()
        before[inside], _ = whole.predicted_errors(inside)
        after[inside], _ = whole.predicted_errors(inside, likely.columns(chosen, whole.responses) if chosen else None)
        same.append(bool(chosen) and likely.listed[chosen[0].form].name == name)
    return before, after, float(np.mean(same))

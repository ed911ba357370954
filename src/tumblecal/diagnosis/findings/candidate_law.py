"""The sparsest closed form that explains residuals without a catalogue entry.

Every form of `law_forms`, on one output, all outputs or an angle of the head, is scored in closed form in the residual space
of the fit: what it explains, less the cost of its coefficients (BIC, Schwarz 1978) and of its prior weight among all forms
(Chen and Chen 2008). The best is accepted, then the best in the space that the accepted ones leave (orthogonal matching
pursuit, Pati, Rezaiifar and Krishnaprasad 1993). For the held-out error the law is chosen again in every fold.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from tumblecal.chain import Where
from tumblecal.diagnosis.findings.law_forms import Form, forms, values_of
from tumblecal.diagnosis.findings.residual_space import ResidualSpace, log_odds
from tumblecal.diagnosis.priors import LAW_FOLDS, LAW_TERMS, LEAST_COEFFICIENT, LIKELY_FORMS, OF_HEAD, SURE_LAW
from tumblecal.effects import AXES
from tumblecal.ground.numbers_shown import rounded_together
from tumblecal.ground.showing import brief


_ALL_OUTPUTS, _ANGLES = "xyz", {"alpha": "spindle angle alpha", "beta": "pitch angle beta"}
# The places where a form may act, as columns of `_responses`.
_PLACES = {"x": [0], "y": [1], "z": [2], "alpha": [3], "beta": [4], _ALL_OUTPUTS: [0, 1, 2]}
# Forms that the catalogue has already, by name and place: cubes, steps at zero, eccentric and elliptic index.
_LISTED = {*((f"product_{axis * 3}", axis) for axis in AXES), *((f"step_{axis}_6", axis) for axis in AXES)}
_LISTED |= {("harmonic_1", "alpha"), ("harmonic_2", "alpha")}
# Values of a function below this are rounding; digits of scores beyond which they are equal.
_ROUNDING, _EQUAL_DIGITS = 1e-9, 6


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
        return self.acts_on in _ANGLES

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


def law_words(law: Law) -> str:
    """The terms of a law, each with the output or angle that it acts on."""
    return "; ".join(map(term_words, law.terms))


def term_words(term: Term) -> str:
    """`output z: (0.52 +- 0.06) mg/g^3 u_x u_y^2`."""
    sizes = [
        f"({rounded_together(1e3 * size, 1e3 * sd)}) {term.unit} {words}"
        for size, sd, words in zip(term.sizes, term.sd, term.form.words, strict=True)
    ]
    return f"{_ANGLES.get(term.acts_on, f'output {term.acts_on}')}: {' + '.join(sizes)}"


# A form by its number, and the place where it acts.
_Chosen = tuple[int, str]


@dataclass(frozen=True)
class _Table:
    """All forms for one problem, without functions that are zero at every position.

    - `values`: of the functions, the second of a form with one function being zero. `price`: minus twice the logarithm of the
      prior weight of each form at each place. `head`: what a rad of each angle of the head adds to the readings, g.
    """

    forms: Sequence[Form]
    values: Float[np.ndarray, "forms 2 positions"]
    price: Float[np.ndarray, "places forms"]
    head: Float[np.ndarray, "positions 3 angles"]

    @classmethod
    def of(cls, where: Where, inputs: Float[np.ndarray, "positions 3"], head: np.ndarray) -> "_Table":
        """The forms of all families, which share the prior weight equally, as do the forms of a family and the places."""
        families, kept, rows, price = forms(where), list[Form](), [], []
        values = iter(values_of([form for family in families.values() for form in family], where, inputs))
        for form, count in ((form, len(family)) for family in families.values() for form in family):
            functions = [(*pair, next(values)) for pair in zip(form.words, form.code, strict=True)]
            functions = [function for function in functions if np.max(np.abs(function[2])) > _ROUNDING]
            if functions:
                words, code, own = zip(*functions, strict=True)
                kept.append(form._replace(words=words, code=code))
                rows.append([*own, np.zeros(len(inputs))][:2])
                # Nothing suffices where the catalogue has a form, and an angle does not depend on an input.
                price.append([
                    np.inf
                    if (form.name, place) in _LISTED or (form.of_input and place in _ANGLES)
                    else 2 * np.log(len(families) * count * len(_PLACES)) + OF_HEAD * (place in _ANGLES)
                    for place in _PLACES
                ])  # fmt: skip
        return cls(kept, np.array(rows), np.array(price).T, head)

    def only(self, numbers: Int[np.ndarray, " kept"]) -> "_Table":
        """Some of the forms alone."""
        return _Table([self.forms[k] for k in numbers], self.values[numbers], self.price[:, numbers], self.head)

    def responses(self, space: Float[np.ndarray, "nu positions 3"]) -> Float[np.ndarray, "places nu positions"]:
        """Response of a space to one unit at every position, on each output and each angle of the head."""
        return np.concatenate([np.moveaxis(space, 2, 0), np.einsum("npk,pka->anp", space, self.head)])

    def columns(self, chosen: Sequence[_Chosen], space: np.ndarray) -> Float[np.ndarray, "nu columns"]:
        """Signals of some forms in a space: form after form, output after output."""
        responses, columns = self.responses(space), [np.zeros((len(space), 0))]
        for form, place in chosen:
            values = self.values[form, : len(self.forms[form].code)].T
            columns += [responses[number] @ values for number in _PLACES[place]]
        return np.hstack(columns)

    def scores(self, space: ResidualSpace, given: Sequence[_Chosen] = ()) -> Float[np.ndarray, "places forms"]:
        """Twice the log odds of each form at each place against none, including its prior weight, given some forms."""
        space = space.without(self.columns(given, space.responses)) if given else space
        responses, counts = self.responses(space.responses), np.array([len(form.code) for form in self.forms])
        odds = np.empty(self.price.shape)
        for some in (counts == 1, counts == 2):
            odds[:, some] = log_odds(
                space, self.values[some, : counts[some].max(initial=1)], responses, _PLACES.values()
            )
        # Forms may be equal at the positions of a fold: the first of them, however rounding falls.
        return np.round(odds - self.price, _EQUAL_DIGITS)

    def best(self, scores: Float[np.ndarray, "places forms"]) -> _Chosen | None:
        """The most probable form and its place; None if it is less probable than none."""
        place, form = np.unravel_index(np.argmax(scores), scores.shape)
        return (int(form), [*_PLACES][place]) if scores[place, form] > 0 else None

    def chosen(self, space: ResidualSpace) -> list[_Chosen]:
        """Forms one by one, each the best given those selected before; each is then searched again, given the others."""
        taken: list[_Chosen] = []
        while len(taken) < LAW_TERMS and (best := self.best(self.scores(space, taken))) is not None:
            taken.append(best)
            for k in range(len(taken) - 1):
                taken[k] = self.best(self.scores(space, taken[:k] + taken[k + 1 :])) or taken[k]
        return taken

    def likely(self, space: ResidualSpace) -> "_Table":
        """The most probable forms, alone or given the best one."""
        alone = self.scores(space)
        listed = [alone, *(self.scores(space, [best]) for best in [self.best(alone)] if best)]
        ranked = [np.argsort(-np.max(scores, axis=0), kind="stable")[:LIKELY_FORMS] for scores in listed]
        return self.only(np.unique(ranked))


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
    table = _Table.of(where, inputs, head).likely(whole)
    taken = table.chosen(whole)
    if not taken:
        return None
    before, after, same = _held_out(table, whole, where, taken[0][0])
    rms = float(np.sqrt(np.mean(before**2))), float(np.sqrt(np.mean(after**2)))
    # A prediction that has nothing to do with the errors lowers their sum of squares by less than zero, with this sd.
    if np.sum(before**2 - after**2) < SURE_LAW * 2 * rms[1] * np.linalg.norm(before - after):
        return None
    columns = table.columns(taken, whole.responses)
    inverse, level = np.linalg.pinv(columns, rcond=1e-9), np.sqrt(whole.without(columns).variance)
    sizes, sd = inverse @ whole.z, level * np.linalg.norm(inverse, axis=1)
    # Of single readings, the columns are the signals themselves.
    readings = np.eye(before.size).reshape(-1, *before.shape)
    signal = (table.columns(taken, readings) @ sizes).reshape(-1, 3)
    return Law(tuple(_terms(table, taken, sizes.tolist(), sd.tolist())), signal, *rms, same)


def _terms(table: _Table, taken: Sequence[_Chosen], sizes: list[float], sd: list[float]) -> Iterator[Term]:
    """The terms by output; those of several outputs without the ones of small coefficients."""
    first = 0
    for number, place in taken:
        form = table.forms[number]
        for on in place if place == _ALL_OUTPUTS else [place]:
            last = first + len(form.code)
            term = Term(form, on, tuple(sizes[first:last]), tuple(sd[first:last]))
            first = last
            ratios = [abs(size) / max(u, 1e-300) for size, u in zip(term.sizes, term.sd, strict=True)]
            if place != _ALL_OUTPUTS or max(ratios) > LEAST_COEFFICIENT:
                yield term


def _held_out(
    table: _Table, whole: ResidualSpace, where: Where, first: int
) -> tuple[Float[np.ndarray, "positions 3"], Float[np.ndarray, "positions 3"], float]:
    """Errors of held-out positions without a law, and with one chosen without them; share of folds with this form first.
    Positions that repeat an attitude are held out together."""
    attitude = where.attitude
    fold = np.random.default_rng(0).permutation(int(attitude.max()) + 1)[attitude] % LAW_FOLDS
    before, after, same = np.zeros((len(fold), 3)), np.zeros((len(fold), 3)), []
    for inside in (fold == number for number in np.unique(fold)):
        chosen = table.chosen(whole.without(whole.of_positions(inside)))
        law = table.columns(chosen, whole.responses) if chosen else None
        before[inside], _ = whole.predicted_errors(inside)
        after[inside], _ = whole.predicted_errors(inside, law)
        same.append(bool(chosen) and chosen[0][0] == first)
    return before, after, float(np.mean(same))

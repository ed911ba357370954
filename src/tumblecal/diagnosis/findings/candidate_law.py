"""The sparsest closed form that explains residuals without a catalogue entry.

Orthogonal matching pursuit (Pati, Rezaiifar and Krishnaprasad 1993) over the forms of `law_shapes`, on one output, all outputs
or an angle of the head. A form is accepted if it explains more than its coefficients cost (BIC, Schwarz 1978) and than its
prior weight among all forms does (Chen and Chen 2008). The held-out error is that of the whole procedure: in every fold the
law is chosen again from the most likely forms.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from tumblecal.chain import Where
from tumblecal.diagnosis.findings.law_shapes import Form, forms, nonzero_functions
from tumblecal.diagnosis.findings.residual_space import ResidualSpace
from tumblecal.diagnosis.priors import (
    LAW_FOLDS,
    LAW_TERMS,
    LEAST_COEFFICIENT,
    LIKELY_FORMS,
    OF_HEAD,
    SURE_LAW,
    VISIBLE_TERM,
)
from tumblecal.effects import AXES
from tumblecal.ground.showing import brief


ALL_OUTPUTS, ANGLES = "xyz", ("alpha", "beta")
# Forms that the catalogue has already, by name and where they act.
_LISTED = {*((f"product_{axis * 3}", axis) for axis in AXES), *((f"harmonic_{k}", "alpha") for k in (1, 2))}


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


class _Chosen(NamedTuple):
    """A form by its number, and where it acts."""

    form: int
    on: str


@dataclass(frozen=True)
class _Dictionary:
    """All forms for one problem: `values` of every function, `head` (positions, 3, 2): what a rad of each head's angle adds."""

    listed: Sequence[Form]
    values: Float[np.ndarray, "positions functions"]
    head: Float[np.ndarray, "positions 3 angles"]

    @cached_property
    def first(self) -> Int[np.ndarray, " forms"]:
        """The number of each form's first function."""
        widths = [len(form.code) for form in self.listed]
        return np.cumsum([0, *widths])[:-1]

    def carriers(self, responses: Float[np.ndarray, "nu positions 3"]) -> dict[str, Float[np.ndarray, "nu positions"]]:
        """Effect of one unit at every position, on each output and each angle of the head."""
        made = {axis: responses[:, :, k] for k, axis in enumerate(AXES)}
        return made | {name: np.einsum("npa,pa->np", responses, self.head[:, :, k]) for k, name in enumerate(ANGLES)}

    def columns(self, chosen: Sequence[_Chosen], responses: np.ndarray) -> Float[np.ndarray, "nu columns"]:
        """Signals of some forms: form after form, output after output."""
        carriers = self.carriers(responses)
        blocks = [carriers[on] @ self._functions(one.form) for one in chosen for on in _outputs(one.on)]
        return np.hstack([np.zeros((len(responses), 0)), *blocks])

    def _functions(self, form: int) -> Float[np.ndarray, "positions functions"]:
        first = self.first[form]
        return self.values[:, first : first + len(self.listed[form].code)]

    def some(self, numbers: Sequence[int]) -> "_Dictionary":
        """Some of the forms alone."""
        values = np.concatenate([self._functions(number) for number in numbers], axis=1)
        return _Dictionary([self.listed[number] for number in numbers], values, self.head)

    def scores(self, residual: ResidualSpace, whole: ResidualSpace) -> dict[str, Float[np.ndarray, " forms"]]:
        """By place of action, twice the log odds of each form against none, including its prior weight.

        **Arguments:**

        - `residual`: given the forms selected so far; `whole`: without any.
        """
        projected = self._projected(residual, whole)
        widths = np.array([len(form.code) for form in self.listed])
        scored = {on: np.full(len(self.listed), -np.inf) for on in (*projected, ALL_OUTPUTS)}
        for width in np.unique(widths).tolist():
            numbers = np.flatnonzero(widths == width)
            rows = self.first[numbers][:, None] + np.arange(width)
            together = np.concatenate([projected[axis][rows] for axis in AXES], axis=1)
            for on, block in (*((on, signals[rows]) for on, signals in projected.items()), (ALL_OUTPUTS, together)):
                explained, rank = explained_by(block, residual.z)
                scored[on][numbers] = residual.log_gain(explained) - rank * np.log(whole.responses[0].size)
        price = self._price()
        for on, score in scored.items():
            in_catalogue = [(form.name, on) in _LISTED or (form.of_input and on in ANGLES) for form in self.listed]
            score -= price + OF_HEAD * (on in ANGLES)
            score[in_catalogue] = -np.inf
        return scored

    def _projected(self, residual: ResidualSpace, whole: ResidualSpace) -> dict[str, Float[np.ndarray, "functions nu"]]:
        """By place of action, the signal of each function in the residual space; zero if too little of it is visible."""
        projected = {on: self.values.T @ carrier.T for on, carrier in self.carriers(residual.responses).items()}
        for on, carrier in self.carriers(whole.responses).items():
            sizes = np.sqrt(self.values.T**2 @ np.vecdot(carrier.T, carrier.T))
            visible = np.linalg.norm(projected[on], axis=1) > VISIBLE_TERM * np.maximum(sizes, 1e-300)
            projected[on] *= visible[:, None]
        return projected

    def _price(self) -> Float[np.ndarray, " forms"]:
        """Minus twice the log of each form's prior weight: equal for families, then for forms of a family, then for places of
        action."""
        families = [form.family for form in self.listed]
        counts = {family: families.count(family) for family in dict.fromkeys(families)}
        return np.array([2 * np.log(len(counts) * counts[family] * 6) for family in families])

    def chosen(self, whole: ResidualSpace) -> list[_Chosen]:
        """Forms one by one, each the best given those selected before; each is then searched again, given the others."""
        taken: list[_Chosen] = []
        while len(taken) < LAW_TERMS:
            best = self._best(taken, whole)
            if best is None:
                break
            taken.append(best)
            for k in range(len(taken) - 1):
                rest = [*taken[:k], *taken[k + 1 :]]
                taken[k] = self._best(rest, whole) or taken[k]
        return taken

    def _best(self, given: Sequence[_Chosen], whole: ResidualSpace) -> _Chosen | None:
        scored = self._scores_given(given, whole)
        on = max(scored, key=lambda name: np.max(scored[name]))
        number = int(np.argmax(scored[on]))
        return _Chosen(number, on) if scored[on][number] > 0 else None

    def _scores_given(self, given: Sequence[_Chosen], whole: ResidualSpace) -> dict[str, Float[np.ndarray, " forms"]]:
        residual = whole.without(self.columns(given, whole.responses)) if given else whole
        return self.scores(residual, whole)

    def likely(self, whole: ResidualSpace, taken: Sequence[_Chosen]) -> list[int]:
        """Numbers of the most probable forms, alone or given the first selected one."""
        numbers = {one.form for one in taken}
        for given in ([], taken[:1]):
            best = np.max(np.stack(list(self._scores_given(given, whole).values())), axis=0)
            numbers |= set(np.argsort(-best)[:LIKELY_FORMS].tolist())
        return sorted(numbers)


def _outputs(on: str) -> Sequence[str]:
    return tuple(AXES) if on == ALL_OUTPUTS else (on,)


def explained_by(
    blocks: Float[np.ndarray, "forms functions nu"], z: Float[np.ndarray, " nu"]
) -> tuple[Float[np.ndarray, " forms"], Int[np.ndarray, " forms"]]:
    """The sum of squares that each block explains, and its rank."""
    norms = np.linalg.norm(blocks, axis=2, keepdims=True)
    unit = np.divide(blocks, norms, out=np.zeros_like(blocks), where=norms > 0)
    values, vectors = np.linalg.eigh(unit @ unit.mT)
    along = np.einsum("fij,fi->fj", vectors, unit @ z)
    seen = values > VISIBLE_TERM**2
    return np.sum(np.divide(along**2, values, out=np.zeros_like(along), where=seen), axis=1), seen.sum(axis=1)


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
    every = _Dictionary(*nonzero_functions(forms(where), where, inputs), head)
    taken = every.chosen(whole)
    if not taken:
        return None
    likely = every.some(every.likely(whole, taken))
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


def _terms(every: _Dictionary, taken: Sequence[_Chosen], sizes: np.ndarray, sd: np.ndarray):
    at = 0
    for one in taken:
        form = every.listed[one.form]
        for on in _outputs(one.on):
            here = slice(at, at + len(form.code))
            at += len(form.code)
            if one.on != ALL_OUTPUTS or np.any(np.abs(sizes[here]) > LEAST_COEFFICIENT * sd[here]):
                yield Term(form, on, tuple(sizes[here].tolist()), tuple(sd[here].tolist()))


def _held_out(
    likely: _Dictionary, whole: ResidualSpace, where: Where, name: str
) -> tuple[Float[np.ndarray, "positions 3"], Float[np.ndarray, "positions 3"], float]:
    """Errors of held-out positions without a law, and with one chosen without them; share of folds with the same first form.
    Positions that repeat an attitude are held out together."""
    attitude = where.attitude
    order = np.random.default_rng(0).permutation(int(attitude.max()) + 1)
    fold = order[attitude] % LAW_FOLDS
    before, after, same = np.zeros((len(fold), 3)), np.zeros((len(fold), 3)), []
    for number in np.unique(fold).tolist():
        inside = fold == number
        chosen = likely.chosen(whole.without(whole.of_positions(inside)))
        before[inside], _ = whole.predicted_errors(inside)
        after[inside], _ = whole.predicted_errors(inside, likely.columns(chosen, whole.responses) if chosen else None)
        same.append(bool(chosen) and likely.listed[chosen[0].form].name == name)
    return before, after, float(np.mean(same))

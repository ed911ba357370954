"""Search for the closed forms that explain a residual: the best form and place of action, one after the other.

Orthogonal matching pursuit (Pati, Rezaiifar and Krishnaprasad 1993) by the products of all forms with each other and with the
residual.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.findings.law_shapes import Form
from tumblecal.diagnosis.findings.residual_space import ResidualSpace, explained_by, products
from tumblecal.diagnosis.priors import LAW_TERMS, LIKELY_FORMS, OF_HEAD, VISIBLE_TERM
from tumblecal.effects import AXES
from tumblecal.estimation.identifiability import RANK_TOLERANCE


ALL_OUTPUTS, ANGLES = "xyz", ("alpha", "beta")
# Forms that the catalogue has already, by name and where they act.
_LISTED = {*((f"product_{axis * 3}", axis) for axis in AXES), *((f"harmonic_{k}", "alpha") for k in (1, 2))}
# Square of a norm, of the largest one, that is rounding; digits of scores beyond which they are equal.
_ROUNDING, _EQUAL_DIGITS = 1e-18, 6


class Chosen(NamedTuple):
    """A form by its number, and where it acts."""

    form: int
    on: str


@dataclass(frozen=True)
class Dictionary:
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

    def columns(self, chosen: Sequence[Chosen], responses: np.ndarray) -> Float[np.ndarray, "nu columns"]:
        """Signals of some forms: form after form, output after output."""
        carriers = self.carriers(responses)
        blocks = [carriers[on] @ self._functions(one.form) for one in chosen for on in outputs_of(one.on)]
        return np.hstack([np.zeros((len(responses), 0)), *blocks])

    def _functions(self, form: int) -> Float[np.ndarray, "positions functions"]:
        first = self.first[form]
        return self.values[:, first : first + len(self.listed[form].code)]

    def some(self, numbers: Sequence[int]) -> "Dictionary":
        """Some of the forms alone."""
        values = np.concatenate([self._functions(number) for number in numbers], axis=1)
        return Dictionary([self.listed[number] for number in numbers], values, self.head)

    @cached_property
    def partners(self) -> Int[np.ndarray, "functions most"]:
        """The numbers of all functions of each function's form, the last repeated where it has fewer than others."""
        widths = np.array([len(form.code) for form in self.listed])
        steps = np.minimum(np.arange(widths.max()), np.repeat(widths, widths)[:, None] - 1)
        return np.repeat(self.first, widths)[:, None] + steps

    @cached_property
    def price(self) -> Float[np.ndarray, " forms"]:
        """Minus twice the log of each form's prior weight: equal for families, then for forms of a family, then for places of
        action."""
        families = [form.family for form in self.listed]
        counts = {family: families.count(family) for family in dict.fromkeys(families)}
        return np.array([2 * np.log(len(counts) * counts[family] * 6) for family in families])


@dataclass(frozen=True)
class Products:
    """Products of the functions of all forms in a residual space, by the places where they act: without the signals themselves,
    which would need many times the memory.

    - `towards`: of each function with the residual. `gram`: by two places, of each function with those of its form.
    - `removed`, `rank`: sum of squares and dimension of the forms that are given.
    """

    forms: Dictionary
    whole: ResidualSpace
    towards: dict[str, Float[np.ndarray, " functions"]]
    gram: dict[tuple[str, str], Float[np.ndarray, "functions most"]]
    removed: float = 0.0
    rank: int = 0

    @classmethod
    def of(cls, forms: Dictionary, whole: ResidualSpace) -> "Products":
        """The products in a residual space."""
        carriers = forms.carriers(whole.responses)
        pairs = [*combinations_with_replacement(AXES, 2), *((angle, angle) for angle in ANGLES)]
        gram = {(a, b): products(forms.values, carriers[a], carriers[b], forms.partners) for a, b in pairs}
        towards = {on: (whole.z @ carrier) @ forms.values for on, carrier in carriers.items()}
        return cls(forms, whole, towards, gram)

    def given(self, chosen: Sequence[Chosen]) -> "Products":
        """The products in the part of the space that some forms do not reach."""
        if not chosen:
            return self
        vectors, singular, _ = np.linalg.svd(self.forms.columns(chosen, self.whole.responses), full_matrices=False)
        q = vectors[:, singular > RANK_TOLERANCE * singular[0]]
        along, partners = q.T @ self.whole.z, self.forms.partners.T
        carriers = self.forms.carriers(self.whole.responses)
        reached = {on: ((q.T @ carrier) @ self.forms.values).T for on, carrier in carriers.items()}
        towards = {on: values - reached[on] @ along for on, values in self.towards.items()}
        gram = {
            (a, b): values - np.stack([np.vecdot(reached[a], reached[b][k]) for k in partners], axis=1)
            for (a, b), values in self.gram.items()
        }
        return replace(self, towards=towards, gram=gram, removed=float(along @ along), rank=q.shape[1])

    @cached_property
    def _visible(self) -> dict[str, Bool[np.ndarray, " functions"]]:
        """By place of action, whether enough of each function is visible."""
        count, first = np.arange(len(self.forms.partners)), self.forms.partners[:, 0]
        visible = {}
        for on, carrier in self.forms.carriers(self.whole.responses).items():
            whole = np.vecdot(carrier.T, carrier.T) @ self.forms.values**2
            # Functions that act at excluded positions only are rounding.
            least = np.maximum(VISIBLE_TERM**2 * whole, _ROUNDING * np.max(whole))
            visible[on] = self.gram[on, on][count, count - first] > least
        return visible

    def _blocks(
        self, rows: Int[np.ndarray, "forms width"], places: Sequence[str]
    ) -> tuple[Float[np.ndarray, "forms columns columns"], Float[np.ndarray, "forms columns"]]:
        """Gram matrices of forms that act at some places, and their products with the residual; zero if not visible."""
        width = rows.shape[1]
        gram = np.zeros((len(rows), width * len(places), width * len(places)))
        for first, a in enumerate(places):
            for second, b in enumerate(places[first:], first):
                here, there = slice(first * width, (first + 1) * width), slice(second * width, (second + 1) * width)
                gram[:, here, there] = self.gram[a, b][rows][:, :, :width]
                gram[:, there, here] = gram[:, here, there].mT
        visible = np.concatenate([self._visible[on][rows] for on in places], axis=1)
        towards = np.concatenate([self.towards[on][rows] for on in places], axis=1)
        return gram * (visible[:, :, None] & visible[:, None]), towards * visible

    def scores(self) -> dict[str, Float[np.ndarray, " forms"]]:
        """By place of action, twice the log odds of each form against none, including its prior weight."""
        listed, whole = self.forms.listed, self.whole
        widths = np.array([len(form.code) for form in listed])
        scored, price = {on: np.empty(len(listed)) for on in (*self.towards, ALL_OUTPUTS)}, self.forms.price
        for on, score in scored.items():
            for width in np.unique(widths).tolist():
                numbers = np.flatnonzero(widths == width)
                rows = self.forms.first[numbers][:, None] + np.arange(width)
                explained, rank = explained_by(*self._blocks(rows, outputs_of(on)))
                gain = whole.log_gain(explained, self.removed, self.rank)
                score[numbers] = gain - rank * np.log(whole.responses[0].size)
            score -= price + OF_HEAD * (on in ANGLES)
            score[[(form.name, on) in _LISTED or (form.of_input and on in ANGLES) for form in listed]] = -np.inf
        # Forms may be equal at the positions of a fold: the first of them, however rounding falls.
        return {on: np.round(score, _EQUAL_DIGITS) for on, score in scored.items()}

    def chosen(self) -> list[Chosen]:
        """Forms one by one, each the best given those selected before; each is then searched again, given the others."""
        taken: list[Chosen] = []
        while len(taken) < LAW_TERMS:
            best = self.given(taken).best()
            if best is None:
                break
            taken.append(best)
            for k in range(len(taken) - 1):
                taken[k] = self.given([*taken[:k], *taken[k + 1 :]]).best() or taken[k]
        return taken

    def best(self) -> Chosen | None:
        """The most probable form and its place of action; None if it is less probable than none."""
        scored = self.scores()
        on = max(scored, key=lambda name: np.max(scored[name]))
        number = int(np.argmax(scored[on]))
        return Chosen(number, on) if scored[on][number] > 0 else None

    def likely(self, taken: Sequence[Chosen]) -> list[int]:
        """Numbers of the most probable forms, alone or given the first selected one."""
        numbers = {one.form for one in taken}
        for given in ([], taken[:1]):
            best = np.max(np.stack([*self.given(given).scores().values()]), axis=0)
            numbers |= set(np.argsort(-best)[:LIKELY_FORMS].tolist())
        return sorted(numbers)


def outputs_of(on: str) -> Sequence[str]:
    """The places of action that a name refers to."""
    return tuple(AXES) if on == ALL_OUTPUTS else (on,)

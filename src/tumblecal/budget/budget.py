"""The budget of a fit: contributions, combined and expanded uncertainty of every parameter (JCGM 100, annex G).

`C = P + sum u^2 s s'`: P the covariance of the fit (type A), s the shift of the parameters by one unit of an input,
`s = (J'J)^-1 J' W dA/dinput`, J and W those of the fit itself.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from tumblecal.budget.inputs import Input, inputs_of, sensitivity_to_readings, shifts, signals
from tumblecal.chain import Chain
from tumblecal.chain.considered import Considered
from tumblecal.data.coverage_factor import coverage_factors, effective_dof
from tumblecal.effects.catalogue import Catalogue
from tumblecal.estimation.fit import Fit


TYPE_A = "noise (type A)"


@dataclass(frozen=True)
class Budget:
    """The uncertainty of a fit's parameters.

    - `fit`: with its covariance (type A). `inputs`: considered in addition; `shifts` of each: change of the parameters by its
      components at one standard uncertainty, base units.
    - `chain`, `derivatives`: the fitted chain with the inputs in it, and the readings' derivatives by their names.
    - `level`: of the expanded uncertainty.
    - `diagnosis_parts`: standard uncertainties that a diagnosis adds to the noise, by label; the fit's covariance
      includes them, and they share the degrees of freedom of the noise. `noise_dof`: these; None: those of the fit.
    """

    fit: Fit
    inputs: tuple[Input, ...]
    shifts: tuple[Float[np.ndarray, "free components"], ...]
    chain: Chain
    derivatives: Mapping[str, Float[np.ndarray, "positions 3"]]
    level: float
    diagnosis_parts: Mapping[str, Float[np.ndarray, " free"]] = field(default_factory=dict)
    noise_dof: float | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters."""
        return self.fit.names

    @property
    def sources(self) -> tuple[str, ...]:
        """All contributions: the noise, parts of a diagnosis, then the inputs."""
        return TYPE_A, *self.diagnosis_parts, *(given.label for given in self.inputs)

    @cached_property
    def table(self) -> Float[np.ndarray, "sources free"]:
        """Standard uncertainties by each of `sources`; the first is type A."""
        parts = [*self.diagnosis_parts.values()]
        of_noise = np.sqrt(np.maximum(self.fit.sd**2 - sum(size**2 for size in parts), 0.0))
        return np.vstack([of_noise, *parts, *(np.linalg.norm(shift, axis=1) for shift in self.shifts)])

    @property
    def type_b(self) -> Float[np.ndarray, "free free"]:
        """Covariance of the parameters by the inputs alone."""
        return sum((shift @ shift.T for shift in self.shifts), np.zeros(self.fit.covariance.shape))

    @property
    def as_fit(self) -> Fit:
        """The fit with the combined covariance of the parameters."""
        return replace(self.fit, covariance=self.fit.covariance + self.type_b)

    @property
    def combined(self) -> Float[np.ndarray, " free"]:
        """Combined standard uncertainties."""
        return self.as_fit.sd

    @property
    def dof(self) -> Float[np.ndarray, " free"]:
        """Effective degrees of freedom (Welch-Satterthwaite); infinite where all contributions have infinitely many."""
        return effective_dof(*self._terms())

    @property
    def coverage(self) -> Float[np.ndarray, " free"]:
        """Coverage factors k."""
        return coverage_factors(self.dof, self.level)

    @property
    def expanded(self) -> Float[np.ndarray, " free"]:
        """Expanded uncertainties, U = k u."""
        return self.coverage * self.combined

    @property
    def without_each(self) -> Float[np.ndarray, "sources free"]:
        """Expanded uncertainties without each of `sources`."""
        remaining = [self._terms(number) for number in range(len(self.sources))]
        return np.array(
            [coverage_factors(effective_dof(*each), self.level) * np.linalg.norm(each[0], axis=0) for each in remaining]
        )

    def _terms(self, omitted: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Standard uncertainties that are combined, and their degrees of freedom; noise and parts of a diagnosis are one."""
        sizes, of_noise = self.table.copy(), 1 + len(self.diagnosis_parts)
        if omitted is not None:
            sizes[omitted] = 0.0
        dof = self.fit.dof if self.fit.noise == "estimated" else np.inf
        dof = dof if self.noise_dof is None else self.noise_dof
        terms = np.vstack([np.linalg.norm(sizes[:of_noise], axis=0), sizes[of_noise:]])
        return terms, np.array([dof, *(given.stated.freedom for given in self.inputs)])


def budget_of(
    fit: Fit, considered: Mapping[str, Considered], entries: Catalogue, file: str, *, level: float = 0.95
) -> Budget:
    """The budget of an exact fit.

    **Arguments:**

    - `considered`: inputs by label. `entries`: the catalogue that they may name. `file`: named in faults.
    - `level`: of the expanded uncertainties.

    **Raises:** `InputError` for an input that is unknown or fitted.
    """
    inputs = inputs_of(considered, fit, entries, file)
    chain, derivatives = signals(fit, inputs)
    by_reading = sensitivity_to_readings(fit)
    moved = tuple(shifts(fit, given, derivatives, by_reading) for given in inputs)
    return Budget(fit, tuple(inputs), moved, chain, derivatives, level)

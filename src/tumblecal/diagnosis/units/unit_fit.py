"""Contribution of one unit to the joint fit: its information on the head, with its parameters and causes eliminated."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from tumblecal.chain.head_file import pitch_names
from tumblecal.diagnosis.model.tangent import tangent
from tumblecal.diagnosis.units.spread import Spread
from tumblecal.diagnosis.units.unit import OwnCauses, SharedSignal, Unit, slots_of


class Information(NamedTuple):
    """Information of a unit on the shared directions and the pitch errors: the matrix, and its product with them."""

    matrix: Float[np.ndarray, "unknowns unknowns"]
    towards: Float[np.ndarray, " unknowns"]


def levels_of(unit: Unit) -> tuple[str, ...]:
    """Names of a unit's pitch errors; none where they are not free, or not one for each setting."""
    leaves = [leaf for leaf in unit.at.model.nominal_chain.free if leaf.name == "dbeta" and leaf.by == "pitch"]
    return pitch_names(leaves[0], unit.at.problem.where) if leaves else ()


class UnitFit:
    """A unit during the joint fit.

    **Arguments:**

    - `own`: its causes, also fitted, or undone.
    - `signals`, `moves`: the shared effects, and the directions of their coefficients (base units) that are fitted.
    - `spreads`: effects whose amount differs from unit to unit, about a shared mean or about zero.
    - `levels`: names of all units' pitch errors.
    """

    def __init__(
        self,
        unit: Unit,
        own: OwnCauses,
        signals: Sequence[SharedSignal],
        moves: Float[np.ndarray, "coefficients directions"],
        spreads: Sequence[Spread],
        levels: Sequence[str],
    ):
        self.unit, self.moves = unit, moves
        self.model = unit.at.model
        self.causes = [unit.pool.causes[k] for k in own.members]
        self.problem = unit.at.problem
        for cause in self.causes:
            self.problem = cause.undone(self.problem)
        self.vector = self.model.with_nominal(unit.at.vector[: self.model.nominal])
        names = levels_of(unit)
        self.pitch = [self.model.names.index(f"dbeta_{k}") for k in range(len(names))]
        self.private = [k for k in range(self.model.nominal) if k not in self.pitch]
        self.places = moves.shape[1] + np.array([levels.index(name) for name in names], int)
        slots = slots_of(self.model)
        # Columns of the shared coefficients, and their numbers among those; an effect that cannot act here has none.
        self.columns: list[int] = []
        self.numbers: list[int] = []
        first = 0
        for signal in signals:
            slot = signal.slot_in(slots)
            if slot is not None:
                self.columns += slot.columns
                self.numbers += range(first, first + len(slot.columns))
            first += len(signal.scales)
        # Directions (full, scaled) of what is the unit's own: of its causes, then its deviations, each with its prior sd.
        whole = np.eye(len(self.model.start))
        beside = [
            whole[:, list(cause.slot.columns)] @ cause.directions
            for cause in self.causes
            if cause.directions is not None
        ]
        taus = [np.full(own.shape[1], np.inf) for own in beside]
        for spread in spreads:
            slot = spread.signal.slot_in(slots)
            if slot is not None:
                beside.append(whole[:, list(slot.columns)])
                taus.append(np.full(len(slot.columns), spread.tau))
        self._beside = np.concatenate([np.zeros((len(whole), 0)), *beside], axis=1)
        self._deviate = np.diag(1.0 / np.concatenate([np.zeros(0), *taus]))
        self._own = np.zeros(self._beside.shape[1])
        self.count = moves.shape[1] + len(levels)
        self.information = Information(np.zeros((self.count, self.count)), np.zeros(self.count))

    def linearise(self, coefficients: Float[np.ndarray, " coefficients"]) -> None:
        """The information of the unit at given shared coefficients (base units) and at its present parameters."""
        vector, model = self._with_effects(self.vector[: self.model.nominal], coefficients), self.model
        at = tangent(model, self.problem, vector)
        rows = at.jacobian / model.scales / self.unit.sigma
        mask = np.ones(len(rows))
        mask[: self.problem.readings.size] = np.repeat(self.problem.takes_part, 3)
        unknowns = np.zeros((len(rows), self.count))
        unknowns[:, : self.moves.shape[1]] = rows[:, self.columns] @ self.moves[self.numbers]
        unknowns[:, self.places] = rows[:, self.pitch]
        terms = [np.pad(term, (0, len(rows) - len(term))) for cause in self.causes for term in cause.terms]
        own = at.jacobian @ np.concatenate([np.eye(len(vector))[:, self.private], self._beside], axis=1)
        private = np.column_stack([own, *terms]) / self.unit.sigma * mask[:, None]
        residual = (at.residual / self.unit.sigma + rows[:, self.pitch] @ vector[self.pitch]) * mask
        # What is known of the deviations counts as readings of them.
        priors = np.zeros((len(self._deviate), private.shape[1]))
        priors[:, len(self.private) : own.shape[1]] = self._deviate
        private = np.concatenate([private, priors])
        self._inverse = np.linalg.pinv(private, rcond=1e-10)
        self._unknowns = np.concatenate([unknowns * mask[:, None], np.zeros((len(priors), self.count))])
        self._residual, self.vector = np.concatenate([residual, np.zeros(len(priors))]), vector
        left = self._unknowns - private @ (self._inverse @ self._unknowns)
        self.information = Information(left.T @ self._unknowns, left.T @ self._residual)

    @property
    def _pitch_alone(self) -> np.ndarray:
        """Inverse of the information on the unit's pitch errors, what is shared being known."""
        return np.linalg.inv(self.information.matrix[np.ix_(self.places, self.places)])

    @property
    def without_pitch(self) -> Information:
        """The information on the shared errors, with separate pitch errors for the unit."""
        matrix, towards = self.information
        count = self.moves.shape[1]
        taken = matrix[:count, self.places] @ self._pitch_alone
        return Information(
            matrix[:count, :count] - taken @ matrix[self.places, :count], towards[:count] - taken @ towards[self.places]
        )

    def step(self, shared: Float[np.ndarray, " directions"]) -> None:
        """Update the parameters of the unit from the shared solution."""
        matrix, towards = self.information
        solution = np.zeros(self.count)
        solution[: len(shared)] = shared
        solution[self.places] = self._pitch_alone @ (towards - matrix @ solution)[self.places]
        change = self._inverse @ (self._residual - self._unknowns @ solution)
        self._own = change[len(self.private) : len(self.private) + len(self._own)]
        nominal = self.vector[: self.model.nominal].copy()
        nominal[self.private] += self.model.scales[self.private] * change[: len(self.private)]
        nominal[self.pitch] = solution[self.places]
        self.vector = self._with_effects(nominal, self.moves @ shared)

    def _with_effects(
        self, nominal: Float[np.ndarray, " nominal"], coefficients: Float[np.ndarray, " coefficients"]
    ) -> Float[np.ndarray, " full"]:
        """The full vector with these nominal parameters and shared coefficients, and what is the unit's own."""
        vector = self.model.with_nominal(nominal)
        vector[self.columns] += coefficients[self.numbers]
        return vector + self.model.scales * (self._beside @ self._own)

    def own_estimate(self, moves: Float[np.ndarray, "coefficients directions"]) -> tuple[np.ndarray, np.ndarray]:
        """Some of the shared coefficients, by the directions fitted, from this unit alone, and their sd, base units; nan where
        it shows nothing of one."""
        matrix, towards = self.without_pitch
        values, vectors = np.linalg.eigh(matrix)
        seen = values > 1e-9 * np.max(values, initial=1e-300)
        inverse = (vectors[:, seen] / values[seen]) @ vectors[:, seen].T
        sd = np.sqrt(np.diag(moves @ inverse @ moves.T))
        return np.where(sd > 0, moves @ (inverse @ towards), np.nan), np.where(sd > 0, sd, np.nan)

"""Lack of fit that no entry describes: something that moves smoothly with the attitude or the time, whatever its curve.

Every field (an output, an error of the head, a turn of the triad, the scale factors) is given a Gaussian process over the
attitude, the spindle and pitch angles, or the time, of a stated correlation length. Such a process has no coefficients to pay
for one by one: its evidence is that of a covariance, `I + s^2 K` on the residual space, averaged over sizes s from 3 to 10000
noise standard deviations (Rasmussen and Williams 2006, chapter 5; Kennedy and O'Hagan 2001 for the discrepancy of a model).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.causes import Cause
from tumblecal.diagnosis.evidence import LARGEST, SMALLEST, log_evidence_of_noise
from tumblecal.diagnosis.generic_causes import HEAD_ANGLES, Generic
from tumblecal.diagnosis.shape_causes import products
from tumblecal.diagnosis.tangent import Tangent
from tumblecal.diagnosis.tuning import LACK_OF_FIT_WEIGHT, LEAST_VISIBLE_TERM
from tumblecal.effects import AXES
from tumblecal.ground.showing import brief


# Correlation lengths: of the direction of gravity and the head's angles (rad), of an input (g), of the spindle angle (rad),
# and of the time (shares of the whole).
_ATTITUDE, _INPUT, _SPINDLE, _TIMES = 0.5, 0.2, 0.25, (0.05, 0.2)
# Of a process the components that carry all but this share of it, at most so many.
_LEFT_OUT, _MOST_COMPONENTS = 0.01, 16
# Components of less than this share of the largest one's variance are left out, and these many sizes tried.
_LEAST_VARIANCE, _SIZES = 1e-4, 16
# Components are fitted from this variance on, in units of the noise's: fitted freely, smaller ones spoil what is predicted.
_FITTED = 9.0


@dataclass(frozen=True)
class LackOfFit:
    """Processes of which each may be what the model lacks.

    - `words`: what depends on what. `directions` (nu, all components), orthonormal within each process; `variances`
      (processes, most components): of the components at size one, 0 where there are fewer. `signals` (rows, components) of
      each process: what these directions are the visible part of.
    """

    __repr__ = brief

    words: tuple[str, ...]
    directions: Float[np.ndarray, "nu columns"]
    variances: Float[np.ndarray, "processes most"]
    signals: tuple[Float[np.ndarray, "rows _"], ...]

    def log_evidence(self, z: Float[np.ndarray, "draws nu"], known: bool) -> Float[np.ndarray, "draws processes"]:
        """Log evidence with prior weight, on the scale of `evidence.log_evidence`."""
        if not self.words:
            return np.zeros((len(z), 0))
        scores = self._log_evidence_by_size(z, known)
        highest = np.max(scores, axis=1)
        mean = np.mean(np.exp(scores - highest[:, None]), axis=1)
        return (highest + np.log(mean) + np.log(LACK_OF_FIT_WEIGHT / len(self.words))).T

    def cause(self, z: Float[np.ndarray, " nu"], known: bool) -> Cause:
        """The most probable process as a term with a coefficient for each component that is clearly above the noise."""
        best = int(np.argmax(self.log_evidence(z[None], known)[0]))
        size = int(np.argmax(self._log_evidence_by_size(z[None], known)[best, :, 0]))
        first, count = int(np.sum(self.variances[:best] > 0)), self.signals[best].shape[1]
        seen = int(np.sum(self._scaled[best, size, :count] > _FITTED)) or 1
        block, terms = self.directions[:, first : first + seen], tuple(self.signals[best].T[:seen])
        weight = float(np.log(LACK_OF_FIT_WEIGHT / len(self.words)))
        return Generic(weight, weight, block, terms, self.words[best])

    @cached_property
    def _scaled(self) -> Float[np.ndarray, "processes sizes most"]:
        """Variances of the components; a process of size s has the norm s over all readings."""
        sizes = np.exp(np.linspace(np.log(SMALLEST), np.log(LARGEST), _SIZES))
        shares = self.variances / np.sum(self.variances, axis=1, keepdims=True)
        return sizes[:, None] ** 2 * shares[:, None]

    @cached_property
    def _explained(self) -> tuple[Float[np.ndarray, "processes sizes most"], Float[np.ndarray, "processes sizes 1"]]:
        """Share of each component's square that each size explains, and half the logarithm of the determinant."""
        return self._scaled / (1.0 + self._scaled), 0.5 * np.sum(np.log1p(self._scaled), axis=2, keepdims=True)

    def _log_evidence_by_size(
        self, z: Float[np.ndarray, "draws nu"], known: bool
    ) -> Float[np.ndarray, "processes sizes draws"]:
        shares, half_log_dets = self._explained
        along, total = np.zeros((*self.variances.shape, len(z))), np.sum(z**2, axis=1)
        along[self.variances > 0] = (self.directions.T @ z.T) ** 2
        left = np.maximum(total - shares @ along, 1e-12 * total)
        return log_evidence_of_noise(left, z.shape[1], known) - half_log_dets


def lack_of_fit(at: Tangent) -> LackOfFit:
    """The processes of which the residuals can show enough."""
    words, directions, variances, visible = [], [np.zeros((at.dof, 0))], [], []
    for name, signals in _processes(at):
        rows = at.problem.rows(signals)
        left, singular, right = np.linalg.svd(at.basis[: len(rows)].T @ rows, full_matrices=False)
        if np.sum(singular**2) < LEAST_VISIBLE_TERM**2 * np.sum(rows**2):
            continue
        kept = singular**2 > _LEAST_VARIANCE * singular[0] ** 2
        words.append(name)
        directions.append(left[:, kept])
        variances.append(singular[kept] ** 2)
        visible.append(rows @ right[kept].T)
    most = max(map(len, variances), default=0)
    padded = [np.pad(own, (0, most - len(own))) for own in variances]
    return LackOfFit(tuple(words), np.hstack(directions), np.array(padded).reshape(len(words), most), tuple(visible))


def _processes(at: Tangent) -> Iterator[tuple[str, Float[np.ndarray, "positions 3 components"]]]:
    """Words and components."""
    where, inputs = at.problem.where, at.evaluation.inputs
    probe = at.evaluation.jacobian[:, :, at.model.probe]
    alpha, beta = np.asarray(where.alpha), np.asarray(where.beta)
    order = where.measuring_order
    time = ((order - order.min()) / max(np.ptp(order), 1e-12))[:, None]
    of_gravity = _components(inputs / np.linalg.norm(inputs, axis=1, keepdims=True) / _ATTITUDE)
    of_head = _components(np.stack([np.cos(alpha), np.sin(alpha), beta], axis=1) / _ATTITUDE)
    of_spindle = _components(np.stack([np.cos(alpha), np.sin(alpha)], axis=1) / _SPINDLE)
    of_inputs = {f"input {axis}": _components(inputs[:, k : k + 1] / _INPUT) for k, axis in enumerate(AXES)}
    in_time = {
        "the time, quickly changing": _components(time / _TIMES[0]),
        "the time, slowly changing": _components(time / _TIMES[1]),
    }
    outputs = np.broadcast_to(np.eye(3), (len(alpha), 3, 3))
    gains = inputs[:, :, None] * outputs
    for k, axis in enumerate(AXES):
        for variable, own in {"the attitude": of_gravity, **of_inputs, **in_time}.items():
            yield f"output {axis}: a function of {variable}", products(outputs[:, :, k : k + 1], own)
    for k, name in enumerate(HEAD_ANGLES):
        for variable, own in {
            "the head's angles": of_head,
            "the spindle angle": of_spindle,
            **in_time,
        }.items():
            yield f"{name}: a function of {variable}", products(probe[:, :, k : k + 1], own)
    for variable, own in {"the head's angles": of_head, **in_time}.items():
        yield f"a turn of the triad: a function of {variable}", products(probe, own)
    for variable, own in in_time.items():
        yield f"the scale factors: functions of {variable}", products(gains, own)


def _components(values: Float[np.ndarray, "positions variables"]) -> Float[np.ndarray, "positions components"]:
    """Principal components of a process with a Gaussian kernel of length one."""
    apart = np.sum((values[:, None] - values) ** 2, axis=2)
    variances, vectors = np.linalg.eigh(np.exp(-0.5 * apart))
    variances, vectors = variances[::-1], vectors[:, ::-1]
    kept = np.cumsum(variances) < (1 - _LEFT_OUT) * np.sum(variances)
    count = min(int(np.sum(kept)) + 1, _MOST_COMPONENTS)
    return vectors[:, :count] * np.sqrt(np.maximum(variances[:count], 0.0))

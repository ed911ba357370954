"""Lack of fit that no entry describes: something that follows the attitude or the time, whatever its curve.

Every field (an output, an error of the head, a turn of the triad, the scale factors) is given a Gaussian process over the
attitude, the spindle and pitch angles, or the time: smooth over a stated correlation length, in steps, bent at planes across
gravity, or swinging in time. Such a process has no coefficients to pay for one by one: its evidence is that of a covariance,
`I + s^2 K` on the residual space, averaged over sizes s from 3 to 10000 noise standard deviations (Rasmussen and Williams
2006, chapter 5; Kennedy and O'Hagan 2001 for the discrepancy of a model).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache

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
# Swings in time: how often in the whole, and over which share of it they keep their phase.
_SWINGS, _IN_PHASE = range(3, 12), 0.7
# The prior share, beside any other process, of each count of swings, of which neighbours are alike, and of steps in time, most
# of which are one jump that the catalogue has.
_IN_SWINGS, _IN_STEPS, _SHARE = " swings", ", in steps", 1 / 3
# How far from the middle (sd, in g) planes lie at which something falls to another side.
_PLANES = 0.5
# Of a process the components that carry all but this share of it, at most so many, and so many for each position: with as
# many as positions it would be a scatter from one to the next.
_LEFT_OUT, _MOST_COMPONENTS, _FOR_EACH = 0.01, 32, 2 / 3
# Components of less than this share of the largest one's variance are left out, and these many sizes tried.
_LEAST_VARIANCE, _SIZES = 1e-4, 16
# Components are fitted from this variance on, in units of the noise's: fitted freely, smaller ones spoil what is predicted.
_FITTED = 9.0


@dataclass(frozen=True)
class LackOfFit:
    """Processes of which each may be what the model lacks.

    - `words`: what depends on what; `log_weights`: of each as an explanation.
    - `directions` (nu, all components), orthonormal within each process; `variances` (processes, most components): of the
      components at size one, 0 where there are fewer.
    - `signals` (rows, components) of each process: what these directions are the visible part of.
    """

    __repr__ = brief

    words: tuple[str, ...]
    log_weights: Float[np.ndarray, " processes"]
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
        return (highest + np.log(mean) + self.log_weights[:, None]).T

    def cause(self, z: Float[np.ndarray, " nu"], known: bool) -> Cause:
        """The most probable process as a term with a coefficient for each component that is clearly above the noise."""
        best = int(np.argmax(self.log_evidence(z[None], known)[0]))
        size = int(np.argmax(self._log_evidence_by_size(z[None], known)[best, :, 0]))
        first, count = int(np.sum(self.variances[:best] > 0)), self.signals[best].shape[1]
        seen = int(np.sum(self._scaled[best, size, :count] > _FITTED)) or 1
        block, terms = self.directions[:, first : first + seen], tuple(self.signals[best].T[:seen])
        weight = float(self.log_weights[best])
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
    words, shares, directions, variances, visible = [], [], [np.zeros((at.dof, 0))], [], []
    for name, signals in _processes(at):
        rows = at.problem.rows(signals)
        projected = at.basis[: len(rows)].T @ rows
        if np.sum(projected**2) < LEAST_VISIBLE_TERM**2 * np.sum(rows**2):
            continue
        # Components this far above rounding need no singular values.
        own, mixed = np.linalg.eigh(projected.T @ projected)
        own, mixed = own[::-1], mixed[:, ::-1]
        kept = own > _LEAST_VARIANCE * own[0]
        words.append(name)
        shares.append(_SHARE if name.endswith((_IN_SWINGS, _IN_STEPS)) else 1.0)
        directions.append(projected @ mixed[:, kept] / np.sqrt(own[kept]))
        variances.append(own[kept])
        visible.append(rows @ mixed[:, kept])
    most = max(map(len, variances), default=0)
    padded = np.array([np.pad(own, (0, most - len(own))) for own in variances]).reshape(len(words), most)
    log_weights = np.log(LACK_OF_FIT_WEIGHT * np.array(shares) / sum(shares))
    return LackOfFit(tuple(words), log_weights, np.hstack(directions), padded, tuple(visible))


def _processes(at: Tangent) -> Iterator[tuple[str, Float[np.ndarray, "positions 3 components"]]]:
    """Words and components."""
    where, inputs = at.problem.where, at.evaluation.inputs
    probe = at.evaluation.jacobian[:, :, at.model.probe]
    smooth, wandering, swings = _of_time(tuple(where.measuring_order.tolist()))
    gravity = inputs / np.linalg.norm(inputs, axis=1, keepdims=True)
    of_gravity, (steps, ramps) = _smooth(gravity / _ATTITUDE), _sides(gravity)
    slowly = _smooth(_shares(where.measuring_order) / _TIMES[1])
    changing = {"the attitude and the time": _components(of_gravity * slowly)}
    of_attitude = {"the attitude": _components(of_gravity), **changing}
    of_inputs = {f"input {axis}": _components(_smooth(inputs[:, k : k + 1] / _INPUT)) for k, axis in enumerate(AXES)}
    sides = {"the side to which gravity pulls": _components(steps)}
    outputs = np.broadcast_to(np.eye(3), (len(inputs), 3, 3))
    for k, axis in enumerate(AXES):
        output = outputs[:, :, k : k + 1]
        for variable, own in {**of_attitude, **of_inputs, **smooth, **swings}.items():
            yield f"output {axis}: a function of {variable}", products(output, own)
    for variable, own in {**sides, "the lean to one side": _components(ramps), **smooth, **wandering}.items():
        yield f"the outputs: functions of {variable}", products(outputs, own)
    for variable, own in {**smooth, **wandering}.items():
        yield f"the scale factors: functions of {variable}", products(inputs[:, :, None] * outputs, own)
    if at.model.hand_held:
        # Unknown attitudes take up any turn.
        return
    head, spindle = _of_angles(tuple(np.asarray(where.alpha).tolist()), tuple(np.asarray(where.beta).tolist()))
    for k, name in enumerate(HEAD_ANGLES):
        for variable, own in {**head, **spindle, **smooth, **wandering}.items():
            yield f"{name}: a function of {variable}", products(probe[:, :, k : k + 1], own)
    for variable, own in {**head, **changing, **sides, **smooth, **wandering}.items():
        yield f"a turn of the triad: a function of {variable}", products(probe, own)


# What varies, in words, and the components of its process (positions, components).
_Varying = dict[str, Float[np.ndarray, "positions _"]]


@lru_cache(maxsize=64)
def _of_time(order: tuple[float, ...]) -> tuple[_Varying, _Varying, _Varying]:
    """Smooth changes in time, those in steps (the covariance of a random walk whose level is unknown), and swings."""
    time = _shares(np.array(order))
    smooth = {
        "the time, quickly changing": _components(_smooth(time / _TIMES[0])),
        "the time, slowly changing": _components(_smooth(time / _TIMES[1])),
    }
    apart, in_phase = time - time.T, _smooth(time / _IN_PHASE)
    swings = {
        f"the time, in some {count}{_IN_SWINGS}": _components(in_phase * np.cos(2 * np.pi * count * apart))
        for count in _SWINGS
        if 2 * count < len(time) - 1
    }
    return smooth, {f"the time{_IN_STEPS}": _components(1.0 - np.abs(apart))}, swings


@lru_cache(maxsize=64)
def _of_angles(alpha: tuple[float, ...], beta: tuple[float, ...]) -> tuple[_Varying, _Varying]:
    """Functions of the head's angles, and of the spindle's alone."""
    spindle = np.stack([np.cos(alpha), np.sin(alpha)], axis=1)
    head = np.column_stack([spindle, beta])
    return (
        {"the head's angles": _components(_smooth(head / _ATTITUDE))},
        {"the spindle angle": _components(_smooth(spindle / _SPINDLE))},
    )


def _shares(order: Float[np.ndarray, " positions"]) -> Float[np.ndarray, "positions 1"]:
    """The time as shares of the whole."""
    return ((order - order.min()) / max(np.ptp(order), 1e-12))[:, None]


def _components(kernel: Float[np.ndarray, "positions positions"]) -> Float[np.ndarray, "positions components"]:
    """Principal components of a process with this covariance."""
    variances, vectors = np.linalg.eigh(kernel)
    variances, vectors = variances[::-1], vectors[:, ::-1]
    kept = np.cumsum(variances) < (1 - _LEFT_OUT) * np.sum(variances)
    count = min(int(np.sum(kept)) + 1, _MOST_COMPONENTS, int(_FOR_EACH * len(kernel)))
    return vectors[:, :count] * np.sqrt(np.maximum(variances[:count], 0.0))


def _smooth(values: Float[np.ndarray, "positions variables"]) -> Float[np.ndarray, "positions positions"]:
    """A Gaussian kernel of length one."""
    return np.exp(-0.5 * np.sum((values[:, None] - values) ** 2, axis=2))


def _sides(direction: Float[np.ndarray, "positions 3"]) -> tuple[np.ndarray, np.ndarray]:
    """Kernels of what falls to one side or the other, and of what is touched on one side alone: sums of steps, and of
    ramps that begin, at planes across the direction of gravity (arc-cosine kernels of order 0 and 1, Cho and Saul 2009)."""
    beside = np.column_stack([direction, np.full(len(direction), _PLANES)])
    cosine = np.clip(beside @ beside.T / (1.0 + _PLANES**2), -1.0, 1.0)
    angle = np.arccos(cosine)
    return 1.0 - angle / np.pi, (np.sqrt(1.0 - cosine**2) + (np.pi - angle) * cosine) / np.pi

"""Lack of fit without a catalogue entry: an error that depends on the attitude or the time, with any curve.

Every field (an output, all outputs, the scale factors, an error of the head, a rotation of the triad) is given a Gaussian
process over each of the variables (`variables`). A process has no single coefficients: its evidence is that of a covariance,
`I + s^2 K` on the residual space, averaged over sizes s from 3 to 10000 noise standard deviations (Rasmussen and Williams 2006,
chapter 5; Kennedy and O'Hagan 2001 for the discrepancy of a model). The best ones of three fields are also evaluated with one
curve for all three (`evidence.one_curve`).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.causes.cause import GENERIC, UNEXPLAINED, Cause
from tumblecal.diagnosis.causes.table import Blocks
from tumblecal.diagnosis.causes.terms import HEAD_ANGLES, products
from tumblecal.diagnosis.lack_of_fit.evidence import (
    best_curve,
    by_size,
    log_evidence_by_size,
    mean_over_sizes,
    one_curve,
)
from tumblecal.diagnosis.lack_of_fit.variables import Variable, variables
from tumblecal.diagnosis.priors import (
    FITTED,
    LACK_OF_FIT_TEST_WEIGHT,
    LACK_OF_FIT_WEIGHT,
    LEAST_VISIBLE_TERM,
    NEAR_CURVE,
    SAME_TERM,
)
from tumblecal.effects import AXES
from tumblecal.full_model.tangent import Tangent
from tumblecal.ground.showing import brief


# Products of inputs with the three axes: the turns in the mount.
_CROSS = np.cross(np.eye(3)[:, None], np.eye(3)).swapaxes(1, 2).reshape(3, 9)
# More than a bound by this share may be rounding.
_ROUNDING = 1.001
# Components of less than this share of the largest one's variance are no more than rounding.
_OMITTED = 1e-12


@dataclass(frozen=True, eq=False)
class Process:
    """A process of `fields`, one or three, each with a separate curve over the variable; `kind` in words; `signals`: each
    field times each component of the variable in the residual space as rows, those of each component together; `seen`: their
    sum of squares; `largest`: the one with the largest."""

    __repr__ = brief

    kind: str
    fields: Float[np.ndarray, "positions 3 fields"]
    variable: Variable
    signals: Float[np.ndarray, "signals nu"]
    seen: float
    largest: Float[np.ndarray, " nu"]

    @property
    def words(self) -> str:
        """Dependent quantity and variable."""
        return f"{self.kind} {self.variable.words}"

    @property
    def width(self) -> int:
        """Number of fields."""
        return self.fields.shape[2]

    @cached_property
    def products(self) -> Float[np.ndarray, "signals signals"]:
        """Products of the signals with each other."""
        return self.signals @ self.signals.T

    def readings(
        self, direction: Float[np.ndarray, " fields"] | None = None
    ) -> Float[np.ndarray, "positions 3 columns"]:
        """The signals as readings, field after field; those of one curve, of which each field has the shares `direction`."""
        fields = self.fields if direction is None else (self.fields @ direction)[:, :, None]
        return products(fields, self.variable.components)


def visible_processes(at: Tangent, effects: Blocks) -> list[Process]:
    """The processes of which the residuals can show enough, and that are more than one of the effects with these blocks."""
    if not (listed := list(_shown(at))):
        return []
    largest, seen = np.array([process.largest for process in listed]), np.array([process.seen for process in listed])
    # Two bounds: of all signals no less remains, given an effect, than of the largest; and as many of the components' variances
    # as an effect has directions, r, are together no more than the root of r times the sum of the squares of all.
    near = np.vecdot(largest, largest) - _held(effects, largest).max(axis=0) <= _ROUNDING * (1 - SAME_TERM**2) * seen
    squares = np.array([np.vdot(process.products, process.products) for process in listed])
    near &= effects.ranks.max(initial=0) * squares >= (SAME_TERM**2 / _ROUNDING * seen) ** 2
    if np.any(near):
        signals = [listed[k].signals for k in np.flatnonzero(near).tolist()]
        held = _held(effects, np.concatenate(signals))
        ends = np.cumsum([len(own) for own in signals])
        most = np.add.reduceat(held, [0, *ends[:-1].tolist()], axis=1).max(axis=0)
        near[near] = most >= SAME_TERM**2 * seen[near]
    return [process for process, is_one in zip(listed, near.tolist(), strict=True) if not is_one]


def _shown(at: Tangent) -> Iterator[Process]:
    """The processes of one problem of which the residuals can show enough."""
    inputs, where = np.asarray(at.evaluation.inputs), at.problem.where
    outputs = np.broadcast_to(np.eye(3), (len(inputs), 3, 3))
    scales = inputs[:, :, None] * outputs
    of_time = "smooth", "wandering"
    # Words, fields, kinds of variables.
    kinds = list[tuple[str, np.ndarray, tuple[str, ...]]]()
    slow = [f"input {axis}" for axis in AXES]
    for k, axis in enumerate(AXES):
        followed = ("attitude", "changing", *slow, "quick input", "smooth", "swing")
        kinds.append((f"output {axis}: a function of", outputs[:, :, [k]], followed))
        kinds.append((f"scale factor {axis}: a function of", scales[:, :, [k]], (*slow[:k], *slow[k + 1 :])))
    of_outputs = ("attitude", "side", "lean", *of_time, *(() if at.model.hand_held else ("spindle",)))
    kinds.append(("the outputs: functions of", outputs, of_outputs))
    kinds.append(("the scale factors: functions of", scales, of_time))
    # Unknown attitudes take up any turn.
    if not at.model.hand_held:
        turns, in_mount = at.evaluation.jacobian[:, :, at.model.probe], (inputs @ _CROSS).reshape(-1, 3, 3)
        for k, name in enumerate(HEAD_ANGLES):
            kinds.append((f"{name}: a function of", turns[:, :, [k]], ("head", "spindle", *of_time)))
        kinds.append(("a rotation of the triad: a function of", turns, ("head", "changing", "side", *of_time)))
        kinds.append(("a rotation in the mount: a function of", in_mount, of_time))
    every, responses = variables(inputs, where), at.responses.swapaxes(0, 1)
    for words, fields, followed in kinds:
        # One kind of fields at a time: those of all need more memory than the signals.
        own = [variable for variable in every if variable.kind in followed]
        components, width = np.hstack([variable.components for variable in own]), fields.shape[2]
        ends = np.cumsum([variable.components.shape[1] for variable in own]).tolist()
        starts = [0, *ends[:-1]]
        signals = (components.T @ (responses @ fields).swapaxes(1, 2).reshape(len(inputs), -1)).reshape(-1, at.dof)
        sizes = np.vecdot(signals, signals)
        seen = np.add.reduceat(sizes, width * np.array(starts))
        whole = np.add.reduceat(
            np.sum((fields * at.whole_responses[:, :, None]) ** 2, axis=(1, 2)) @ components**2, starts
        )
        if at.problem.correlated:
            each = (at.problem.rows(products(fields, variable.components)) for variable in own)
            whole = np.array([np.sum(rows**2) for rows in each])
        for k in np.flatnonzero(seen > LEAST_VISIBLE_TERM**2 * whole).tolist():
            here = slice(width * starts[k], width * ends[k])
            largest = signals[here.start + np.argmax(sizes[here])]
            yield Process(words, fields, own[k], signals[here], float(seen[k]), largest)


def _held(effects: Blocks, signals: Float[np.ndarray, "signals nu"]) -> Float[np.ndarray, "effects signals"]:
    """The sum of squares of each signal along each of the effects; 0 without any."""
    squares = (effects.rows @ signals.T) ** 2
    if not len(squares):
        return np.zeros((1, len(signals)))
    return np.add.reduceat(squares, np.cumsum(effects.ranks) - effects.ranks, axis=0)


@dataclass(frozen=True)
class LackOfFit:
    """Processes, each of which may be missing in the model: those that the residuals of a problem can show and that are more
    than an effect, with the logarithms of their prior shares. Each of several fields has its share a second time for one
    curve."""

    __repr__ = brief

    at: Tangent
    visible: list[Process]
    log_shares: Float[np.ndarray, " processes"]

    @classmethod
    def of(cls, at: Tangent, effects: Blocks) -> "LackOfFit":
        """Of a problem, given effects with these blocks."""
        visible = visible_processes(at, effects)
        shares = np.array([process.variable.share for process in visible])
        twice = np.array([1 + (process.width > 1) for process in visible])
        return cls(at, visible, np.log(shares / np.sum(shares * twice)))

    @property
    def test_log_weights(self) -> Float[np.ndarray, " processes"]:
        """Logarithms of the weights in the test."""
        return self.log_shares + np.log(LACK_OF_FIT_TEST_WEIGHT)

    def by_size(self, z: Float[np.ndarray, "draws nu"], known: bool) -> Float[np.ndarray, "processes sizes draws"]:
        """Log evidence of each process and size, on the scale of `evidence.log_evidence`."""
        inner = [process.signals @ z.T for process in self.visible]
        return log_evidence_by_size([process.products for process in self.visible], inner, z, known)

    def test_log_evidence(
        self, by_size: Float[np.ndarray, "processes sizes draws"]
    ) -> Float[np.ndarray, "draws processes"]:
        """Log evidence of each with its weight in the test, the size averaged over."""
        return mean_over_sizes(by_size).T + self.test_log_weights

    def log_evidence(
        self, by_size: Float[np.ndarray, "processes sizes 1"], z: Float[np.ndarray, " nu"], known: bool
    ) -> float:
        """Log evidence of all together, with their prior weight."""
        scores = [own for _, _, own in self._scored(by_size, z, known)]
        return float(np.logaddexp.reduce(scores, initial=-np.inf) + np.log(LACK_OF_FIT_WEIGHT))

    def cause(self, by_size: Float[np.ndarray, "processes sizes 1"], z: Float[np.ndarray, " nu"], known: bool) -> Cause:
        """The most probable process as a term with a coefficient for each component that is clearly above the noise."""
        process, direction, _ = max(self._scored(by_size, z, known), key=lambda own: own[2])
        return _as_cause(self.at, process, direction, z, known)

    def _scored(
        self, by_size: Float[np.ndarray, "processes sizes 1"], z: Float[np.ndarray, " nu"], known: bool
    ) -> list[tuple[Process, Float[np.ndarray, " fields"] | None, float]]:
        """Log evidence of each process with its prior share, the size averaged over; and of the best process of each kind of
        several fields with one curve for all, if it is not far behind the best of all, with the fields' shares."""
        scores = (mean_over_sizes(by_size)[:, 0] + self.log_shares).tolist()
        listed, best = list[tuple[Process, np.ndarray | None, float]](), dict[str, int]()
        listed += [(own, None, score) for own, score in zip(self.visible, scores, strict=True)]
        for row, process in enumerate(self.visible):
            if process.width > 1 and scores[row] > scores[best.setdefault(process.kind, row)]:
                best[process.kind] = row
        for row in best.values():
            if scores[row] > max(scores) - NEAR_CURVE:
                process = self.visible[row]
                inner = (process.signals @ z).reshape(-1, process.width)
                crossed, size = process.products.reshape(*inner.shape, *inner.shape), int(by_size[row, :, 0].argmax())
                direction, log_evidence = one_curve(crossed, inner, size, z, known)
                listed.append((process, direction, log_evidence + float(self.log_shares[row])))
        return listed


def _as_cause(
    at: Tangent, process: Process, direction: np.ndarray | None, z: Float[np.ndarray, " nu"], known: bool
) -> Cause:
    """A process as a term, as of `LackOfFit.cause`; `direction`: the fields' shares of one curve."""
    words, weight = process.words + ("" if direction is None else ", all by one curve"), np.log(LACK_OF_FIT_WEIGHT)
    rows = at.problem.rows(process.readings(direction))
    projected = at.basis[: len(rows)].T @ rows
    crossed = projected.T @ projected
    variances, mixed = np.linalg.eigh(crossed)
    variances = np.where(variances > _OMITTED * variances[-1], variances, 0.0)
    scaled = by_size(variances)[0][best_curve(crossed, z @ projected, z, known).size]
    largest = np.argsort(-scaled)[: int(np.sum(scaled > FITTED)) or 1]
    signals = projected @ mixed[:, largest]
    block, terms = signals / np.linalg.norm(signals, axis=0), tuple((rows @ mixed[:, largest]).T)
    return Cause(GENERIC, UNEXPLAINED, float(weight), float(weight), block, terms=terms, words=words)

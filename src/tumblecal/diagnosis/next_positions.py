"""Where to measure next: positions that separate the leading explanations, or else help the worst parameter.

Candidates are single positions of a grid in the present mounting, and whole turns with the triad remounted (turned by a
quarter in its fixture), which brings its own mounting angles as new unknowns. The value of a candidate is what it adds
to the expected log Bayes factor between the leading explanation and its rivals: half the squared norm of the part of
the leader's signal that the rival, refitted to old and new positions together, cannot make.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tumblecal.chain import Where, nominal_chain, settings
from tumblecal.chain.frames import rotation_matrix
from tumblecal.data import PositionSet
from tumblecal.diagnosis.adapt import Fit
from tumblecal.diagnosis.candidates import Candidate
from tumblecal.diagnosis.linear import Weighting
from tumblecal.diagnosis.model import Model, model_of
from tumblecal.diagnosis.screen import Screened
from tumblecal.effects import Catalogue


MOST = 6
_SINGLE_STEP_DEG = 15
_SIDES = {"turned 90 deg about y": (0.0, np.pi / 2, 0.0), "turned 90 deg about z": (0.0, 0.0, np.pi / 2)}
_TURN_DEG = tuple(range(0, 360, 45))


@dataclass(frozen=True)
class NextPosition:
    """A proposal, its angles in degrees.

    `mount`: "" for the present mounting, else how to turn the triad; `alpha_deg` is then the first of a whole turn in
    steps of 45 degrees. `purpose`: what it is for; `value`: the expected log Bayes factor that it adds, or the share by
    which it lowers the worst parameter's sd.
    """

    alpha_deg: float
    beta_deg: float
    mount: str
    purpose: str
    value: float


@dataclass(frozen=True)
class _Plan:
    """Old positions and all candidates in one set of settings: rows of `groups` number the candidates (-1: old)."""

    where: Where
    groups: np.ndarray
    listed: list[tuple[float, float, str]]
    nominal_rotation: np.ndarray


def next_positions(
    screened: Screened,
    members: tuple[Candidate, ...],
    fit: Fit,
    model: Model,
    where: Where,
    entries: Catalogue,
    how: Weighting,
    data: PositionSet,
    grid: tuple[tuple[float, ...], tuple[float, ...]] | None = None,
) -> list[NextPosition]:
    """The most useful positions to measure next, best first.

    **Arguments:**

    - `screened`, `members`, `fit`: what was found, and the extended fit.
    - `model`, `where`, `entries`, `how`, `data`: of the present data.
    - `grid`: spindle and pitch angles (deg) that may be used; every 15 degrees within those of the data where left out.

    **Returns:** at most six; empty for data of several mountings, or where a rig of one's own gives no plan to extend.
    """
    if len(set(data.mount or ("1",))) > 1 or len(data.runs) > 1 or how.whiten is not None or np.any(how.prior_weights):
        return []
    plan = _plan(where, data, grid)
    chain = nominal_chain(plan.where, dbeta_by="mount.pitch", dtheta_by="mount", mount_nominal=plan.nominal_rotation)
    wide = model_of(chain, plan.where, entries)
    vector = _carried(model, fit, wide)
    evaluation = wide.evaluate(plan.where, vector)
    weight = float(np.median(how.weights))
    rows = evaluation.jacobian * (weight if how.known else weight / fit.sigma)
    rivals = _rivals(screened, members)
    if rivals and members:
        purpose = "separate the leading explanations"
        columns = [column for one in members if one.slot for column in one.slot.columns]
        amplitudes = fit.vector[columns] / model.scales[columns]
        values = _separation(rows, plan, wide, members, amplitudes, rivals)
    else:
        purpose = "lower the standard deviation of the worst parameter"
        values = _sharpening(rows, plan, wide)
    order = np.argsort(-values)[:MOST]
    proposals = []
    for k in order[values[order] > 1e-3]:
        alpha_deg, beta_deg, mount = plan.listed[int(k)]
        proposals.append(NextPosition(alpha_deg, beta_deg, mount, purpose, float(values[k])))
    return proposals


def _plan(where: Where, data: PositionSet, grid: tuple[tuple[float, ...], tuple[float, ...]] | None) -> _Plan:
    """Old positions, a grid of new ones in the present mounting, and whole turns with the triad remounted."""
    turns, levels = grid or (
        tuple(range(0, 360, _SINGLE_STEP_DEG)),
        tuple(
            np.unique(
                np.round(
                    np.concatenate([data.beta_deg, np.arange(data.beta_deg.min(), data.beta_deg.max() + 1, 15)]), 6
                )
            )
        ),
    )
    listed = [(float(a), float(b), "") for b in levels for a in turns]
    cells = list(enumerate(listed))
    listed += [(0.0, float(b), side) for side in _SIDES for b in np.unique(data.beta_deg)]
    for k, (_, b, side) in enumerate(listed[len(cells) :], start=len(cells)):
        cells += [(k, (float(a), b, side)) for a in _TURN_DEG]
    groups = np.array([-1] * len(data) + [k for k, _ in cells])
    alpha = np.radians([*data.alpha_deg, *(a for _, (a, _, _) in cells)])
    beta = np.radians([*data.beta_deg, *(b for _, (_, b, _) in cells)])
    mounts = ["present"] * len(data) + [side or "present" for _, (_, _, side) in cells]
    last = {}
    for name in ("time_s", "temperature_degc", "approach"):
        column = getattr(where, name)
        if column is not None:
            column = np.asarray(column, float)
            step = np.ptp(column) / max(1, len(column) - 1) if name == "time_s" else 0.0
            later = column.max() + step if name == "time_s" else float(np.median(column))
            later = 1.0 if name == "approach" else later
            last[name] = np.concatenate([column, np.full(len(cells), later)])
    rotations = np.stack([np.eye(3), *(rotation_matrix(np.array(angles)) for angles in _SIDES.values())])
    return _Plan(settings(alpha, beta, mount=mounts, **last), groups, listed, rotations)


def _carried(model: Model, fit: Fit, wide: Model) -> np.ndarray:
    """The fitted nominal values where the wider model has parameters of the same name; zero elsewhere."""
    values = dict(zip(model.nominal_chain.names, fit.vector[: model.nominal], strict=True))
    vector = wide.start.copy()
    for k, name in enumerate(wide.nominal_chain.names):
        # Pitch settings are numbered anew with the new ones among them; their small errors do not matter here.
        if not name.startswith("dbeta"):
            vector[k] = values.get(name.replace("@mount=present", ""), 0.0)
    return vector


def _rivals(screened: Screened, members: tuple[Candidate, ...]) -> list[tuple[Candidate, ...]]:
    """Explanations that are still possible and made of effects only: the equivalents, then the next ones."""
    by_label = {one.label: one for one in screened.pool.candidates if one.family == "effect"}
    sets = [*screened.best.equivalents, *(one.labels for one in screened.explanations if one.probability > 0.02)]
    rivals = []
    for labels in dict.fromkeys(sets):
        # A set that holds the leader's effects can always make its signal.
        if not set(screened.best.labels) <= set(labels) and all(label in by_label for label in labels):
            rivals.append(tuple(by_label[label] for label in labels))
    return [one for one in rivals if one][:4] if all(one.slot is not None for one in members) else []


def _separation(
    rows: np.ndarray,
    plan: _Plan,
    wide: Model,
    members: tuple[Candidate, ...],
    amplitudes: np.ndarray,
    rivals: list[tuple[Candidate, ...]],
) -> np.ndarray:
    """What each candidate adds to the leader's distance from its nearest rival, as an expected log Bayes factor."""
    signal = rows[:, :, _columns(wide, members)] @ amplitudes
    spans = [rows[:, :, [*range(wide.nominal), *_columns(wide, rival)]] for rival in rivals]
    old = plan.groups < 0
    before = [_rest(signal[old], span[old]) for span in spans]
    values = []
    for chosen in _chosen(plan):
        gains = [_rest(signal[chosen], span[chosen]) - rest for span, rest in zip(spans, before, strict=True)]
        values.append(0.5 * min(gains))
    return np.array(values)


def _sharpening(rows: np.ndarray, plan: _Plan, wide: Model) -> np.ndarray:
    """By what share each candidate lowers the worst parameter's sd (worst: largest in its own scale)."""
    names = wide.nominal_chain.names
    sensor = [k for k, name in enumerate(names) if name.startswith(("dK", "bias", "gamma"))]
    old = plan.groups < 0
    worst_before = _worst(rows[old], wide, sensor)
    return np.array([1.0 - _worst(rows[chosen], wide, sensor) / worst_before for chosen in _chosen(plan)])


def _worst(rows: np.ndarray, wide: Model, sensor: list[int]) -> float:
    flat = rows[:, :, : wide.nominal].reshape(-1, wide.nominal)
    used = np.linalg.norm(flat, axis=0) > 0
    sd = np.zeros(wide.nominal)
    sd[used] = np.linalg.norm(np.linalg.pinv(flat[:, used], rcond=1e-9), axis=1)
    return float(np.max(sd[sensor]))


def _chosen(plan: _Plan) -> Iterator[np.ndarray]:
    for k in range(len(plan.listed)):
        yield (plan.groups < 0) | (plan.groups == k)


def _columns(wide: Model, members: tuple[Candidate, ...]) -> list[int]:
    slots = {(slot.id, slot.variant): slot for slot in wide.slots}
    return [column for one in members if one.slot for column in slots[one.slot.id, one.slot.variant].columns]


def _rest(signal: np.ndarray, span: np.ndarray) -> float:
    """Squared norm of a signal's part that a span cannot make."""
    flat = span.reshape(-1, span.shape[-1])
    used = np.linalg.norm(flat, axis=0) > 0
    left, singular, _ = np.linalg.svd(flat[:, used], full_matrices=False)
    basis = left[:, singular > 1e-9 * singular[0]]
    rows = signal.ravel()
    return float(rows @ rows - np.sum((basis.T @ rows) ** 2))

"""Where to measure next: positions that separate the leading explanations, or else help the worst parameter.

Candidates are single positions of a grid in the present mounting, and turns of the spindle with the triad remounted
(turned by a quarter in its fixture), which brings its own mounting angles as new unknowns.
"""

from dataclasses import dataclass

import numpy as np

from tumblecal.chain import Where
from tumblecal.data import PositionSet
from tumblecal.diagnosis.adapt import Fit
from tumblecal.diagnosis.candidates import Candidate
from tumblecal.diagnosis.linear import Weighting
from tumblecal.diagnosis.model import Model
from tumblecal.diagnosis.next_grid import Allowed, Proposal, proposals
from tumblecal.diagnosis.next_rows import remountings, rows_of
from tumblecal.diagnosis.next_value import DECIDED, Separation, Sharpening, Value
from tumblecal.diagnosis.repair import repaired
from tumblecal.diagnosis.screen import FAULTS, Screened


MOST = 6
MOST_IN_SET = 12
MOST_RIVALS = 6
LEAST_VALUE = 1e-3
# A set is complete when another position would take less than 3 % off the worst sd (a turn of several: less than 10 %),
# or add less than this to the log Bayes factor.
_LEAST_GAIN = 0.03
_LEAST_TURN = 0.1
LEAST_STEP = 0.05
SEPARATE = "separate the leading explanations"
SHARPEN = "lower the standard deviation of the worst parameter"


@dataclass(frozen=True)
class NextPosition:
    """A proposal, its angles in degrees.

    `mount`: "" for the present mounting, else how to turn the triad; `alpha_deg` is then the first of a turn, `turn_deg`
    all of it. `purpose`: what it is for; `value`: the expected log Bayes factor that it adds, or the share by which it
    lowers the worst parameter's sd.
    """

    alpha_deg: float
    beta_deg: float
    mount: str
    purpose: str
    value: float
    turn_deg: tuple[float, ...] = ()


@dataclass(frozen=True)
class NextPlan:
    """What to measure next.

    - `singles`: the best proposals, each for itself, best first.
    - `together`: a small set of positions that go well together, in the order in which they were chosen; the `value` of
      each is what it adds to those before it. `value`: of all of it.
    - `purpose`; `watched`: the worst parameter, where its sd is to be lowered.
    - `notes`: what was taken for granted, or why something is not proposed. `from_rig`: the chain is a rig file's.
    """

    singles: tuple[NextPosition, ...] = ()
    together: tuple[NextPosition, ...] = ()
    purpose: str = ""
    value: float = 0.0
    watched: str = ""
    notes: tuple[str, ...] = ()
    from_rig: bool = False

    @property
    def positions(self) -> int:
        """Number of positions of the set."""
        return sum(len(one.turn_deg) or 1 for one in self.together)


def next_plan(
    screened: Screened,
    members: tuple[Candidate, ...],
    fit: Fit,
    model: Model,
    where: Where,
    readings: np.ndarray,
    how: Weighting,
    data: PositionSet,
    allowed: Allowed,
    from_rig: bool,
) -> NextPlan:
    """The most useful positions to measure next.

    **Arguments:**

    - `screened`, `members`, `fit`: what was found, and the extended fit.
    - `model`, `where`, `readings`, `how`, `data`: of the present data.
    - `allowed`: angles and mountings that may be used.
    - `from_rig`: whether the chain is that of a rig file.
    """
    sides, why_not = remountings(model, data, from_rig) if allowed.remount else ((), "")
    listed = proposals(data, allowed, sides)
    rows = rows_of(model, repaired(where, readings, list(members)), data, how, fit, listed, from_rig)
    notes = [why_not] if why_not else []
    if how.whiten is not None:
        notes.append("The noise is correlated from position to position; new positions are counted as independent.")
    rivals, leader = _rivals(screened, members), _columns(members)
    separation = None
    if rivals and leader:
        spans, odds = [_columns(effects) for _, effects, _ in rivals], [odds for *_, odds in rivals]
        amplitudes = fit.vector[leader] / model.scales[leader]
        separation = Separation(rows, model.nominal, leader, amplitudes, spans, odds)
        hopeless = separation.inseparable(rows.cells)
        if hopeless:
            names = "; ".join(" + ".join(rivals[k][0]) or "a right model" for k in hopeless)
            notes.append(f"None of these positions would tell it from {names}.")
            kept = [k for k in range(len(rivals)) if k not in hopeless]
            spans, odds = [spans[k] for k in kept], [odds[k] for k in kept]
            separation = Separation(rows, model.nominal, leader, amplitudes, spans, odds) if kept else None
    notes += _repeats(members)
    if separation is not None:
        separating = _planned(separation, listed, rows.cells, SEPARATE, "", notes, from_rig)
        if separating.together:
            return separating
    watching = _watched(model, where)
    sharpening = Sharpening(rows, [*range(model.nominal), *leader], watching)
    worst = model.nominal_chain.names[watching[int(np.argmax(sharpening.variances()))]]
    return _planned(sharpening, listed, rows.cells, SHARPEN, worst, notes, from_rig)


def _planned(
    value: Value,
    listed: list[Proposal],
    cells: list[np.ndarray],
    purpose: str,
    watched: str,
    notes: list[str],
    from_rig: bool,
) -> NextPlan:
    values = value.of(cells)
    best = np.argsort(-values, kind="stable")[:MOST]
    singles = tuple(_told(listed[k], purpose, float(values[k])) for k in best.tolist() if values[k] > LEAST_VALUE)
    together = tuple(_told(listed[k], purpose, gain) for k, gain in _greedy(value, listed, cells, purpose))
    if from_rig and any(one.mount for one in together):
        notes = [
            *notes,
            "The rig file must get a [mounts] entry for the new mounting, and dtheta one value a mounting.",
        ]
    return NextPlan(singles, together, purpose, value.total if together else 0.0, watched, tuple(notes), from_rig)


def _told(one: Proposal, purpose: str, value: float) -> NextPosition:
    turn = one.alpha_deg if one.side else ()
    return NextPosition(one.alpha_deg[0], one.beta_deg, one.side, purpose, float(value), turn)


def _greedy(value: Value, listed: list[Proposal], cells: list[np.ndarray], purpose: str) -> list[tuple[int, float]]:
    """Proposals taken one by one, each the best per position beside those before it, and what each adds."""
    taken: list[tuple[int, float]] = []
    spent, open_ = 0, set(range(len(listed)))
    costs = np.array([one.cost for one in listed])
    while purpose == SHARPEN or value.total < DECIDED:
        fits = [k for k in sorted(open_) if costs[k] <= MOST_IN_SET - spent]
        if not fits:
            break
        own = [cells[k] for k in fits]
        values = value.of(own)
        place = int(np.argmax(value.per_position(own, values)))
        least = min(_LEAST_GAIN * costs[fits[place]], _LEAST_TURN) if purpose == SHARPEN else LEAST_STEP
        if values[place] < least:
            break
        taken.append((fits[place], float(values[place])))
        value.take(cells[fits[place]])
        spent += int(costs[fits[place]])
        # The same position is not proposed twice: a turn of four is part of that of eight.
        same = listed[fits[place]]
        open_ -= {
            k
            for k in open_
            if (listed[k].side, listed[k].beta_deg) == (same.side, same.beta_deg)
            and set(listed[k].alpha_deg) & set(same.alpha_deg)
        }
    return taken


def _watched(model: Model, where: Where) -> list[int]:
    """Columns of the sensor's parameters that hold for new positions; all nominal ones where a rig fixes those."""
    chosen, offset = [], 0
    for leaf in model.nominal_chain.free:
        groups, components = leaf.value.shape
        if leaf.name in ("dK", "bias", "gamma"):
            group = 0 if leaf.by is None else int(np.asarray(where.index(leaf.by))[-1])
            chosen += [offset + group * components + k for k in range(components)]
        offset += groups * components
    return chosen or list(range(model.nominal))


def _rivals(
    screened: Screened, members: tuple[Candidate, ...]
) -> list[tuple[tuple[str, ...], tuple[Candidate, ...], float]]:
    """Explanations that are still possible: labels, effects in them, odds against the leader (most likely first)."""
    by_label = {one.label: one for one in screened.pool.candidates if one.family == "effect"}
    best, leader = screened.best, {one.label for one in members if one.slot is not None}
    shared = (best.probability - best.own_probability) / max(1, len(best.equivalents))
    listed = [(labels, shared) for labels in best.equivalents]
    listed += [(one.labels, one.probability) for one in screened.explanations if one is not best and not one.noise]
    rivals = []
    for labels, probability in sorted(listed, key=lambda item: -item[1]):
        faults = {label for label in labels if label.split(":")[0] in _FAULT_IDS}
        # A set that holds the leader's effects can always make its signal; what no entry describes predicts nothing.
        if probability < 0.01 or leader <= set(labels) or not set(labels) - faults <= set(by_label):
            continue
        effects = tuple(by_label[label] for label in labels if label not in faults)
        rivals.append((labels, effects, probability / max(best.own_probability, 1e-12)))
    if any(one.slot is None and one.family not in FAULTS for one in members):
        return []
    return rivals[:MOST_RIVALS]


_FAULT_IDS = ("outlier_position", "swapped_positions", "mislabelled_angle")


def _columns(members: tuple[Candidate, ...]) -> list[int]:
    return [column for one in members if one.slot for column in one.slot.columns]


def _repeats(members: tuple[Candidate, ...]) -> list[str]:
    """Positions at fault are measured again first."""
    suspect = [one.label.partition(":")[2].replace("+", " and ") for one in members if one.family in FAULTS]
    return [f"Measure position {', '.join(suspect)} again first."] if suspect else []

"""Where to measure next: positions that separate the leading explanations, or else help the worst parameter.

Candidates are single positions of a grid in the present mounting, and turns of the spindle with the triad remounted
(turned by a quarter in its fixture), which brings its own mounting angles as new unknowns.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from tumblecal.data.positions import attitudes_of
from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import Cause
from tumblecal.estimation.attitudes import next_attitudes
from tumblecal.planning.confirming import Confirmation, confirmations
from tumblecal.planning.new_rows import Rows, remountings, rows_of
from tumblecal.planning.proposals import Allowed, Proposal, proposals
from tumblecal.planning.rivals import Rival, columns_of, rivals_of
from tumblecal.planning.value import Separation, Sharpening, Value


MOST = 6
MOST_IN_SET = 12
LEAST_VALUE = 1e-3
# A set is complete when it is enough, or another position would take less than 3 % off the worst sd (a turn of several: less
# than 10 %), or add less than this to the log Bayes factor.
_LEAST_GAIN = 0.03
_LEAST_TURN = 0.1
LEAST_STEP = 0.05
SEPARATE = "separate the leading explanations"
SHARPEN_WEAKEST = "lower the standard deviation of the weakest direction of the sensor's parameters"
_SIDES_BY_HAND = (
    "The +x face is the one that is up where x reads +1 g, the -x face the one that is down; so for y and z."
)
SHARPEN = "lower the standard deviation of the worst parameter"


@dataclass(frozen=True)
class NextPosition:
    """A proposal, its angles in degrees.

    `mount`: "" for the present mounting, else how to turn the triad; `alpha_deg` is then the first of a turn, `turn_deg`
    all of it. `purpose`: what it is for; `value`: the expected log Bayes factor that it adds, or the share by which it
    lowers the worst parameter's sd. `direction`: of a hand-held set, how to lay the triad down; the angles say no more.
    """

    alpha_deg: float
    beta_deg: float
    mount: str
    purpose: str
    value: float
    turn_deg: tuple[float, ...] = ()
    direction: str = ""


@dataclass(frozen=True)
class NextPlan:
    """What to measure next.

    - `singles`: the best proposals, each for itself, best first.
    - `together`: a small set of positions that go well together, in the order in which they were chosen; the `value` of
      each is what it adds to those before it. `value`: of all of it.
    - `purpose`; `watched`: the worst parameter, where its sd is to be lowered.
    - `notes`: what was taken for granted, or why something is not proposed. `from_rig`: the chain is a rig file's.
    - `confirming`: readings that test the named cause, with what it and its strongest rival predict.
    """

    singles: tuple[NextPosition, ...] = ()
    together: tuple[NextPosition, ...] = ()
    purpose: str = ""
    value: float = 0.0
    watched: str = ""
    notes: tuple[str, ...] = ()
    from_rig: bool = False
    confirming: tuple[Confirmation, ...] = ()

    @property
    def positions(self) -> int:
        """Number of positions of the set."""
        return sum(len(position.turn_deg) or 1 for position in self.together)


def next_plan(diagnosis: Diagnosis, allowed: Allowed | None = None) -> NextPlan:
    """The most useful positions to measure next; of a hand-held set as directions, for its weakest parameters.

    **Arguments:**

    - `diagnosis`: of the present data.
    - `allowed`: angles and mountings that may be used.
    """
    if diagnosis.data.hand_held:
        return _by_hand(diagnosis)
    allowed, model = allowed or Allowed(), diagnosis.model
    sides, why_not = remountings(diagnosis) if allowed.remount else ((), "")
    listed = proposals(diagnosis.data, allowed, sides)
    rows = rows_of(diagnosis, listed)
    notes = [why_not] if why_not else []
    if diagnosis.problem.correlated:
        notes.append("The noise is correlated from position to position; new positions are counted as independent.")
    rivals, leader = rivals_of(diagnosis, rows), columns_of(diagnosis.members)
    amplitudes = diagnosis.extended.vector[leader] / model.scales[leader]
    separation = None
    if rivals and leader:
        separation = Separation(rows, model.nominal, leader, amplitudes, rivals)
        hopeless = separation.inseparable(rows.cells)
        if hopeless:
            names = "; ".join(" + ".join(rivals[k].labels) or "a right model" for k in hopeless)
            notes.append(f"None of these positions would tell it from {names}.")
            rivals = [rival for k, rival in enumerate(rivals) if k not in hopeless]
            separation = Separation(rows, model.nominal, leader, amplitudes, rivals) if rivals else None
    notes += _repeats(diagnosis.members)
    confirming: tuple[Confirmation, ...] = ()
    if leader:
        rival = rivals[0] if rivals else Rival((), (), 1.0, rows)
        confirming = confirmations(rows, listed, model.nominal, (leader, amplitudes), rival)
    choosing = _Choosing(listed, rows, tuple(notes), diagnosis.from_rig, confirming)
    if separation is not None:
        separating = choosing.planned(separation, SEPARATE)
        if separating.together:
            return separating
    watching = _watched(diagnosis)
    sharpening = Sharpening(rows, [*range(model.nominal), *leader], watching)
    worst = model.names[watching[int(np.argmax(sharpening.variances()))]]
    return choosing.planned(sharpening, SHARPEN, worst)


def _by_hand(diagnosis: Diagnosis) -> NextPlan:
    """Attitudes that the kept positions of a hand-held set lack."""
    chosen = next_attitudes(diagnosis.data.readings[np.asarray(diagnosis.extended.kept, bool)])
    if not chosen:
        return NextPlan()
    alpha, beta = attitudes_of(np.array([attitude.up for attitude, _ in chosen]))
    together = tuple(
        NextPosition(float(a), float(b), "", SHARPEN_WEAKEST, gain, direction=attitude.words)
        for (attitude, gain), a, b in zip(chosen, alpha, beta, strict=True)
    )
    value = 1 - float(np.prod([1 - position.value for position in together]))
    return NextPlan(together=together, purpose=SHARPEN_WEAKEST, value=value, notes=(_SIDES_BY_HAND,))


@dataclass(frozen=True)
class _Choosing:
    """What is chosen from: `listed` with their `rows`, and what every plan says."""

    listed: list[Proposal]
    rows: Rows
    notes: tuple[str, ...]
    from_rig: bool
    confirming: tuple[Confirmation, ...]

    def planned(self, value: Value, purpose: str, watched: str = "") -> NextPlan:
        """The best proposals each for itself, and a set that goes well together."""
        values = np.where(self._usable([]), value.of(self.rows.cells), 0.0)
        best = np.argsort(-values, kind="stable")[:MOST]
        singles = tuple(
            _told(self.listed[k], purpose, float(values[k])) for k in best.tolist() if values[k] > LEAST_VALUE
        )
        together = tuple(_told(self.listed[k], purpose, gain) for k, gain in self._greedy(value, purpose))
        notes = self.notes
        if self.from_rig and any(position.mount for position in together):
            new_mounting = (
                "The rig file must get a [mounts] entry for the new mounting, and dtheta one value a mounting."
            )
            notes = (*notes, new_mounting)
        worth = value.total if together else 0.0
        return NextPlan(singles, together, purpose, worth, watched, notes, self.from_rig, self.confirming)

    def _greedy(self, value: Value, purpose: str) -> list[tuple[int, float]]:
        """Proposals taken one by one, each the best per position beside those before it, and what each adds."""
        taken: list[tuple[int, float]] = []
        spent, open_ = 0, set(range(len(self.listed)))
        costs = np.array([proposal.cost for proposal in self.listed])
        while not value.enough:
            usable = self._usable([k for k, _ in taken])
            fits = [k for k in sorted(open_) if costs[k] <= MOST_IN_SET - spent and usable[k]]
            if not fits:
                break
            own = [self.rows.cells[k] for k in fits]
            values = value.of(own)
            best = int(np.argmax(value.per_position(own, values)))
            least = min(_LEAST_GAIN * costs[fits[best]], _LEAST_TURN) if purpose == SHARPEN else LEAST_STEP
            if values[best] < least:
                break
            taken.append((fits[best], float(values[best])))
            value.take(self.rows.cells[fits[best]])
            spent += int(costs[fits[best]])
            # The same position is not proposed twice: a turn of four is part of that of eight.
            same = self.listed[fits[best]]
            open_ -= {
                k
                for k in open_
                if (self.listed[k].side, self.listed[k].beta_deg) == (same.side, same.beta_deg)
                and set(self.listed[k].alpha_deg) & set(same.alpha_deg)
            }
        return taken

    def _usable(self, taken: list[int]) -> Bool[np.ndarray, " listed"]:
        """Which proposals can be analysed beside those taken: what is measured in a new mounting must tell how the triad stands
        in it."""
        own: dict[str, list[np.ndarray]] = {}
        for k in taken:
            own.setdefault(self.listed[k].side, []).append(self.rows.cells[k])
        return np.array(
            [
                not proposal.side or self.rows.determine_their_own(np.concatenate([*own.get(proposal.side, ()), cells]))
                for proposal, cells in zip(self.listed, self.rows.cells, strict=True)
            ],
            bool,
        )


def _told(proposal: Proposal, purpose: str, value: float) -> NextPosition:
    turn = proposal.alpha_deg if proposal.side else ()
    return NextPosition(proposal.alpha_deg[0], proposal.beta_deg, proposal.side, purpose, float(value), turn)


def _watched(diagnosis: Diagnosis) -> list[int]:
    """Columns of the sensor's parameters that hold for new positions; all nominal ones where a rig fixes those."""
    chosen, offset, where = [], 0, diagnosis.problem.where
    for leaf in diagnosis.model.nominal_chain.free:
        groups, components = leaf.value.shape
        if leaf.name in ("dK", "bias", "gamma"):
            group = 0 if leaf.by is None else int(np.asarray(where.index(leaf.by))[-1])
            chosen += [offset + group * components + k for k in range(components)]
        offset += groups * components
    return chosen or list(range(diagnosis.model.nominal))


def _repeats(causes: tuple[Cause, ...]) -> list[str]:
    """Positions at fault are measured again first."""
    suspect = [cause.label.partition(":")[2].replace("+", " and ") for cause in causes if cause.positions]
    return [f"Measure position {', '.join(suspect)} again first."] if suspect else []

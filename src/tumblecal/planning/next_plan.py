"""Where to measure next: positions that separate the leading explanations, or else help the worst parameter.

Candidates are single positions of a grid in the present mounting, and turns of the spindle with the triad remounted
(turned by a quarter in its fixture), which brings its own mounting angles as new unknowns.
"""

from dataclasses import dataclass, replace

import numpy as np

from tumblecal.data.positions import attitudes_of
from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import Cause
from tumblecal.estimation.attitudes import next_attitudes
from tumblecal.ground.blas import single_blas_thread
from tumblecal.planning.choosing import MOST_IN_SET, Choosing
from tumblecal.planning.conditions import Conditions, going_on
from tumblecal.planning.confirming import Confirmation, confirmations
from tumblecal.planning.new_rows import remountings
from tumblecal.planning.promise import Promise
from tumblecal.planning.proposals import Allowed, Proposal, proposals
from tumblecal.planning.rivals import Rival, columns_of
from tumblecal.planning.sampling import REVERSED, SAMPLE, samples
from tumblecal.planning.separating import separate
from tumblecal.planning.value import Sharpening


MOST = 6
LEAST_VALUE = 1e-3
# A set is complete when another position would take less than 3 % off the worst sd (a turn of several: less than 10 %).
_LEAST_GAIN = 0.03
_LEAST_TURN = 0.1
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
    all of it. `purpose`: what it is for; `value`: the expected log Bayes factor that it adds, the share by which it lowers the
    worst parameter's sd, or the unexplained error there in noise sd. `direction`: of a hand-held set, how to lay the triad
    down; the angles say no more.
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
    - `conditions`: under which the values hold. `promise`: what the best positions would settle between the leading
      explanations, None where there is but one; `needed`: positions that would do where it is not sure, if any number would.
    """

    singles: tuple[NextPosition, ...] = ()
    together: tuple[NextPosition, ...] = ()
    purpose: str = ""
    value: float = 0.0
    watched: str = ""
    notes: tuple[str, ...] = ()
    from_rig: bool = False
    confirming: tuple[Confirmation, ...] = ()
    conditions: Conditions | None = None
    promise: Promise | None = None
    needed: int | None = None

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
    if diagnosis.unnamed is not None:
        chosen = samples(diagnosis, allowed, MOST_IN_SET)
        together = tuple([NextPosition(own.alpha_deg, own.beta_deg, "", SAMPLE, own.in_sd) for own in chosen])
        singles = tuple(sorted(together, key=lambda own: -own.value)[:MOST])
        notes = (REVERSED, why_not) if why_not else (REVERSED,)
        conditions = going_on(diagnosis.data)
        return NextPlan(singles, together, SAMPLE, notes=notes, from_rig=diagnosis.from_rig, conditions=conditions)
    listed = proposals(diagnosis.data, allowed, sides)
    notes = [why_not] if why_not else []
    if diagnosis.problem.correlated:
        notes.append("The noise is correlated from position to position; new positions are counted as independent.")
    notes += _repeats(diagnosis.members)
    with single_blas_thread():
        first, separated = separate(diagnosis, listed, MOST)
    rows, leader, told = first.rows, columns_of(diagnosis.members), first
    plan = NextPlan(from_rig=diagnosis.from_rig, conditions=going_on(diagnosis.data))
    if separated is not None:
        plan = replace(plan, promise=separated.promise, needed=separated.needed)
        if separated.promise.worth_measuring:
            plan, told = replace(plan, conditions=separated.conditions, value=separated.value), separated.told
    if leader:
        amplitudes = diagnosis.extended.vector[leader] / model.scales[leader]
        rival = told.rivals[0] if told.rivals else Rival((), (), 1.0, told.rows)
        confirming = confirmations(told.rows, listed, model.nominal, (leader, amplitudes), rival)
        plan = replace(plan, confirming=confirming)
    if separated is not None and separated.promise.worth_measuring:
        return _with(plan, listed, separated.singles, separated.chosen, SEPARATE, notes)
    watching, choosing = _watched(diagnosis), Choosing(listed, rows)
    sharpening = Sharpening(rows, [*range(model.nominal), *leader], watching)
    worst = model.names[watching[int(np.argmax(sharpening.variances()))]]
    singles = choosing.best(sharpening, MOST, LEAST_VALUE)
    chosen = choosing.greedy(sharpening, lambda positions: min(_LEAST_GAIN * positions, _LEAST_TURN))
    plan = replace(plan, watched=worst, value=sharpening.total if chosen else 0.0)
    return _with(plan, listed, singles, chosen, SHARPEN, notes)


def _with(
    plan: NextPlan,
    listed: list[Proposal],
    singles: list[tuple[int, float]],
    chosen: list[tuple[int, float]],
    purpose: str,
    notes: list[str],
) -> NextPlan:
    """A plan with proposals, by their numbers and values."""
    together = tuple(_told(listed[k], purpose, gain) for k, gain in chosen)
    if plan.from_rig and any(position.mount for position in together):
        new_mounting = "The rig file must get a [mounts] entry for the new mounting, and dtheta one value a mounting."
        notes = [*notes, new_mounting]
    told = tuple(_told(listed[k], purpose, value) for k, value in singles)
    return replace(plan, singles=told, together=together, purpose=purpose, notes=tuple(notes))


def _by_hand(diagnosis: Diagnosis) -> NextPlan:
    """Attitudes that the kept positions of a hand-held set lack."""
    chosen = next_attitudes(diagnosis.data.readings[np.asarray(diagnosis.extended.retained, bool)])
    if not chosen:
        return NextPlan()
    alpha, beta = attitudes_of(np.array([attitude.up for attitude, _ in chosen]))
    together = tuple(
        NextPosition(float(a), float(b), "", SHARPEN_WEAKEST, gain, direction=attitude.words)
        for (attitude, gain), a, b in zip(chosen, alpha, beta, strict=True)
    )
    value = 1 - float(np.prod([1 - position.value for position in together]))
    return NextPlan(together=together, purpose=SHARPEN_WEAKEST, value=value, notes=(_SIDES_BY_HAND,))


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

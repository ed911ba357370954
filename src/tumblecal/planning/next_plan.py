"""Where to measure next: positions that separate the leading explanations, otherwise those that improve the worst parameter.

Candidates are single positions of a grid in the present mounting, and turns of the spindle with the triad remounted (a quarter
turn in its fixture). A new mounting has new unknown angles.
"""

from dataclasses import dataclass, replace

import numpy as np

from tumblecal.data.positions import attitudes_of
from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import Cause
from tumblecal.estimation.attitudes import next_attitudes
from tumblecal.ground.blas import single_blas_thread
from tumblecal.planning.alternatives import Predicted, competition
from tumblecal.planning.choosing import MOST_IN_SET, Choosing
from tumblecal.planning.conditions import Conditions, continued
from tumblecal.planning.confirming import Confirmation, confirmations
from tumblecal.planning.new_rows import remountings
from tumblecal.planning.promise import Promise
from tumblecal.planning.proposals import Allowed, Proposal, proposals, reversed_run
from tumblecal.planning.sampling import REVERSED, SAMPLE, Sample, samples
from tumblecal.planning.separating import LEAST_STEP, separate
from tumblecal.planning.temperature_notes import temperature_notes
from tumblecal.planning.value import Separation, Sharpening


MOST = 6
LEAST_VALUE = 1e-3
# A set is complete when a further position would reduce the worst uncertainty by less than 3 % (a turn of several: 10 %).
_LEAST_GAIN = 0.03
_LEAST_TURN = 0.1
SEPARATE = "separate the leading explanations"
SHARPEN_WEAKEST = "reduce the standard uncertainty of the most poorly determined direction of the sensor's parameters"
_AT_SETTINGS = (
    "A cause that acts at one pitch setting returns with this setting only: repeats of the setting, or new settings, separate "
    "it from other causes."
)
_SIDES_BY_HAND = "The +x face is up when x reads +1 g, and the -x face is then down; y and z accordingly."
SHARPEN = "reduce the largest standard uncertainty"


@dataclass(frozen=True)
class NextPosition:
    """A proposal, its angles in degrees.

    `mount`: "" for the present mounting, otherwise the turn of the triad; `alpha_deg` is then the first of a turn, `turn_deg`
    all of it. `purpose` in words; `value`: the expected log Bayes factor that it adds, the share by which it reduces the
    largest uncertainty, or the unexplained error there in standard deviations of the noise. `direction`: for a hand-held set
    the orientation in words; the angles are equivalent.
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

    - `singles`: the best single proposals, best first.
    - `together`: a small set of positions in the order in which they were chosen; the `value` of each is the part that it
      adds to those before it. `value`: of the whole set.
    - `purpose`; `watched`: the parameter with the largest uncertainty, if that is to be reduced.
    - `notes`: assumptions, and reasons why something is not proposed. `from_rig`: the chain is that of a rig file.
    - `confirming`: readings that test the named cause, with the predictions of the cause and of its strongest alternative.
    - `conditions`: under which the values are valid. `promise`: what the best positions would settle between the leading
      explanations, None if there is only one.
    - `in_reverse`: whether the set is the whole last run again, in the reverse order.

    Examples:
        >>> from tumblecal.planning import NextPlan
        >>> NextPlan().positions
        0
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
    in_reverse: bool = False

    @property
    def positions(self) -> int:
        """Number of positions of the set."""
        return sum(len(position.turn_deg) or 1 for position in self.together)

    @property
    def settings(self) -> dict[tuple[str, float], list[float]]:
        """Spindle angles of the set by mounting and pitch setting, without directions of a hand-held set."""
        settings: dict[tuple[str, float], list[float]] = {}
        for position in sorted(self.together, key=lambda position: position.mount):
            if not position.direction:
                angles = position.turn_deg or (position.alpha_deg,)
                settings.setdefault((position.mount, position.beta_deg), []).extend(angles)
        return settings


def next_plan(diagnosis: Diagnosis, allowed: Allowed | None = None) -> NextPlan:
    """The most useful positions to measure next; for a hand-held set directions that improve its weakest parameters.

    **Arguments:**

    - `diagnosis`: of the present data.
    - `allowed`: angles and mountings that may be used.

    Examples:
        >>> import tumblecal
        >>> from tumblecal.planning import Allowed
        >>> data = tumblecal.simulate(tumblecal.read_rig("hidden_effect"), seed=4, noise_sd=0.1e-3)
        >>> plan = tumblecal.next_plan(tumblecal.diagnose(data, noise_sd=0.1e-3), Allowed(remount=False))
        >>> plan.purpose, plan.positions
        ('separate the leading explanations', 6)
    """
    if diagnosis.data.hand_held:
        return _by_hand(diagnosis)
    allowed, model = allowed or Allowed(), diagnosis.model
    sides, why_not = remountings(diagnosis) if allowed.remount else ((), "")
    if diagnosis.unnamed is not None:
        return _of_samples(diagnosis, samples(diagnosis, allowed, MOST_IN_SET), why_not)
    listed = proposals(diagnosis.data, allowed, sides)
    notes = [why_not] if why_not else []
    if diagnosis.problem.correlated:
        notes.append("The noise is correlated between positions; new positions are assumed independent.")
    notes += [*_repeats(diagnosis.members), *temperature_notes(diagnosis)]
    with single_blas_thread():
        competing = competition(diagnosis)
        if not all(hasattr(link, "setting") for link in competing.at_settings):
            # A value for each pitch setting predicts nothing at another one.
            measured = diagnosis.data.pitch_setting_deg
            listed = [one for one in listed if np.any(np.isclose(measured, one.beta_deg))] or listed
        if competing.at_settings and len(competing.competing) > 1:
            notes.append(_AT_SETTINGS)
        predicted = competing.at(listed)
        separated = separate(competing, predicted, listed, reversed_run(diagnosis.data, allowed))
    leader, worth = predicted[0], separated if separated is not None and separated.promise.worth_measuring else None
    plan = NextPlan(
        from_rig=diagnosis.from_rig,
        conditions=continued(diagnosis.data) if worth is None else worth.conditions,
        promise=None if separated is None else separated.promise,
    )
    predicted = predicted if worth is None else worth.competing
    choosing = Choosing(listed, predicted[0].rows)
    if len(leader.columns) > model.nominal:
        nominal = Predicted(replace(leader.by, labels=()), choosing.rows, (*range(model.nominal),))
        plan = replace(plan, confirming=confirmations(listed, *(*predicted, nominal)[:2]))
    if worth is not None:
        plan = replace(plan, purpose=SEPARATE, value=sum(worth.gains), in_reverse=worth.in_reverse)
        singles = choosing.best(Separation(predicted), MOST, LEAST_STEP)
        chosen = zip(worth.ordered, worth.gains, strict=True)
    else:
        watching = _watched(diagnosis)
        sharpening = Sharpening(choosing.rows, leader.columns, watching)
        worst = model.names[watching[int(np.argmax(sharpening.variances()))]]
        singles = choosing.best(sharpening, MOST, LEAST_VALUE)
        numbers = choosing.greedy(sharpening, lambda positions: min(_LEAST_GAIN * positions, _LEAST_TURN))
        chosen = [(listed[k], gain) for k, gain in numbers]
        plan = replace(plan, purpose=SHARPEN, watched=worst, value=sharpening.total if chosen else 0.0)
    together = tuple([_position(one, plan.purpose, gain) for one, gain in chosen])
    if plan.from_rig and any(position.mount for position in together):
        notes.append("Add a [mounts] entry for the new mounting to the rig file, and one value of dtheta per mounting.")
    best = tuple([_position(listed[k], plan.purpose, value) for k, value in singles])
    return replace(plan, singles=best, together=together, notes=tuple(notes))


def _of_samples(diagnosis: Diagnosis, chosen: list[Sample], why_not: str) -> NextPlan:
    """Positions that sample an unexplained error; `why_not`: why no remounting is proposed."""
    together = tuple([NextPosition(one.alpha_deg, one.beta_deg, "", SAMPLE, one.in_sd) for one in chosen])
    singles = tuple(sorted(together, key=lambda position: -position.value)[:MOST])
    notes, conditions = (REVERSED, why_not) if why_not else (REVERSED,), continued(diagnosis.data)
    return NextPlan(singles, together, SAMPLE, notes=notes, from_rig=diagnosis.from_rig, conditions=conditions)


def _by_hand(diagnosis: Diagnosis) -> NextPlan:
    """Attitudes that are missing among the positions of a hand-held set."""
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


def _position(proposal: Proposal, purpose: str, value: float) -> NextPosition:
    turn = proposal.alpha_deg if proposal.side else ()
    return NextPosition(proposal.alpha_deg[0], proposal.beta_deg, proposal.side, purpose, value, turn)


def _watched(diagnosis: Diagnosis) -> list[int]:
    """Columns of the sensor parameters of new positions; all nominal ones if a rig fixes these."""
    chosen, offset, where = [], 0, diagnosis.problem.where
    for leaf in diagnosis.model.nominal_chain.free:
        groups, components = leaf.value.shape
        if leaf.name in ("dK", "bias", "gamma"):
            group = 0 if leaf.by is None else int(np.asarray(where.index(leaf.by))[-1])
            chosen += [offset + group * components + k for k in range(components)]
        offset += groups * components
    return chosen or list(range(diagnosis.model.nominal))


def _repeats(causes: tuple[Cause, ...]) -> list[str]:
    """An instruction to repeat outlier positions first."""
    suspect = [cause.label.partition(":")[2].replace("+", " and ") for cause in causes if cause.positions]
    return [f"Measure position {', '.join(suspect)} again first."] if suspect else []

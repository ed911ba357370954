"""Where to measure next: positions that separate the leading explanations, otherwise those that improve the worst parameter.

Candidates are single positions of a grid in the present mounting, and turns of the spindle with the triad remounted (a quarter
turn in its fixture). A new mounting has new unknown angles.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pydantic import computed_field

from tumblecal.chain import parameters_of
from tumblecal.chain.nominal import Mount
from tumblecal.data.positions import attitudes_of
from tumblecal.diagnosis import Diagnosis
from tumblecal.estimation.attitudes import next_attitudes
from tumblecal.ground.axes import AXES
from tumblecal.ground.precision import single_blas_thread
from tumblecal.plan.next.competition import competition
from tumblecal.plan.next.conditions import Conditions, continued, temperature_notes
from tumblecal.plan.next.proposals import (
    REVERSED,
    SAMPLE,
    SIDES,
    Allowed,
    NextPosition,
    proposals,
    reversed_run,
    samples,
)
from tumblecal.plan.next.rows import Posterior, Rows, leaves_of
from tumblecal.plan.next.separating import (
    LEAST_STEP,
    MOST,
    MOST_IN_SET,
    Promise,
    Value,
    best_of,
    greedy,
    separate,
    separation,
    sharpenings,
)


LEAST_VALUE = 1e-3
# A set is complete when a further position would reduce the worst uncertainty by less than 3 % (a turn of several: 10 %).
_LEAST_GAIN = 0.03
_LEAST_TURN = 0.1
SEPARATE = "separate the leading explanations"
SHARPEN_WEAKEST = "reduce the standard uncertainty of the most poorly determined direction of the sensor's parameters"
_NOT_REMOUNTED = "No remounting is proposed: the chain has no free dtheta for each mounting, or no exact mount."
_CORRELATED = "The noise is correlated between positions; new positions are assumed independent."
_NEW_MOUNT = "Add a [mounts] entry for the new mounting to the rig file, and one value of dtheta per mounting."
_AT_SETTINGS = (
    "A cause that acts at one pitch setting returns with this setting only: repeats of the setting, or new settings, separate "
    "it from other causes."
)
_SIDES_BY_HAND = "The +x face is up when x reads +1 g, and the -x face is then down; y and z accordingly."
SHARPEN = "reduce the largest standard uncertainty"
# Largest number of readings that test a cause, smallest distance (deg) at one pitch setting, and smallest separation in
# standard deviations.
_MOST_CONFIRMING, _DISTANCE_DEG, _LEAST_SD = 3, 30.0, 1.0


@dataclass(frozen=True)
class Confirmation:
    """One reading that tests the named cause: the cause and the strongest alternative predict different values.

    - `alpha_deg`, `beta_deg`, `axis`: where, in the present mounting, and which reading.
    - `expected_g`: reading predicted by the named cause; `rival_g`: by the alternative (refitted to the data).
    - `sd_g`, `expected_sd_g`: standard deviation of the measured reading minus the prediction of the alternative, and minus
      that of the named cause; both include the noise and the uncertainty of the fit.
    - `rival`: labels of the causes of the alternative; empty: the nominal model.
    """

    alpha_deg: float
    beta_deg: float
    axis: str
    expected_g: float
    rival_g: float
    sd_g: float
    expected_sd_g: float
    rival: tuple[str, ...]

    @computed_field
    @property
    def sd_apart(self) -> float:
        """Separation of the two predictions in `sd_g`."""
        return abs(self.expected_g - self.rival_g) / self.sd_g


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
        return sum(len(position.angles_deg) for position in self.together)

    @property
    def conditions_of_positions(self) -> dict[str, Any] | None:
        """The conditions with the mountings of the set."""
        mounting = list(dict.fromkeys(position.mount for position in self.together))
        return None if self.conditions is None else self.conditions._asdict() | {"mounting": mounting}

    @property
    def settings(self) -> dict[tuple[str, float], list[float]]:
        """Spindle angles of the set by mounting and pitch setting, without directions of a hand-held set."""
        settings: dict[tuple[str, float], list[float]] = {}
        for position in sorted(self.together, key=lambda position: position.mount):
            if not position.direction:
                settings.setdefault((position.mount, position.beta_deg), []).extend(position.angles_deg)
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
    allowed, data = allowed or Allowed(), diagnosis.data
    sides = tuple(SIDES) if allowed.remount and _remounts(diagnosis) else ()
    notes = [_NOT_REMOUNTED] if allowed.remount and not sides else []
    plan = NextPlan(from_rig=diagnosis.from_rig, conditions=continued(data))
    if diagnosis.unnamed is not None:
        together = tuple(samples(diagnosis, allowed, MOST_IN_SET))
        singles = tuple(sorted(together, key=lambda position: -position.value)[:MOST])
        return replace(plan, singles=singles, together=together, purpose=SAMPLE, notes=(REVERSED, *notes))
    suspect = [cause.label.partition(":")[2] for cause in diagnosis.members if cause.positions]
    notes += [_CORRELATED] if diagnosis.problem.correlated else []
    notes += [f"Measure position {', '.join(suspect).replace('+', ' and ')} again first."] if suspect else []
    notes += temperature_notes(diagnosis)
    with single_blas_thread():
        return _proposed(diagnosis, plan, allowed, proposals(data, allowed, sides), notes)


def _proposed(
    diagnosis: Diagnosis, plan: NextPlan, allowed: Allowed, listed: list[NextPosition], notes: list[str]
) -> NextPlan:
    """The plan that separates explanations if that is worth measuring, otherwise the one that improves the worst parameter."""
    competing, data, model = competition(diagnosis), diagnosis.data, diagnosis.model
    settings, alternatives = {*data.pitch_setting_deg.tolist()}, competing.alternatives
    if competing.at_settings:
        listed = [one for one in listed if one.beta_deg in settings] or listed
        notes += [_AT_SETTINGS] if alternatives else []
    predicted, counted = competing.at(listed, continued(data)._replace(step_s=0.0)), np.ones(len(alternatives), bool)
    found, promise = separate(competing, predicted, listed, reversed_run(data, allowed)), None
    if alternatives:
        promise = Promise(0.0, 0.0, 1.0, (), alternatives) if found is None else found.promise
    if found is not None and found.promise.worth_measuring:
        plan = replace(plan, purpose=SEPARATE, conditions=found.conditions, in_reverse=found.in_reverse)
        predicted, counted, together = found.predicted, found.counted, found.ordered
        value = separation(competing, predicted, counted)
        singles = best_of(listed, predicted.rows.cells, value, LEAST_STEP)
        whole = sum(one.value for one in together)
    else:
        leader, cells, watched = predicted.posteriors[0], predicted.rows.cells, _watched(diagnosis)
        value = Value([leader], sharpenings(watched), np.zeros(1), np.inf)
        worst = model.names[watched[int(np.argmax(np.diag(leader.covariance)[watched]))]]
        plan = replace(plan, purpose=SHARPEN, watched=worst)
        least = -np.log1p(-np.minimum([_LEAST_GAIN * len(one.angles_deg) for one in listed], _LEAST_TURN))
        # The share by which an uncertainty is reduced, from the decrease of its logarithm.
        singles, together = (
            [replace(one, value=-float(np.expm1(-one.value))) for one in chosen]
            for chosen in (
                best_of(listed, cells, value, LEAST_VALUE),
                greedy(listed, cells, value, least, settings),
            )
        )
        whole = -float(np.expm1(-value.total))
    if any(cause.slot.all_columns for cause in diagnosis.members):
        others = zip(predicted.posteriors[1:], alternatives, strict=True)
        possible = [each for each, counts in zip(others, counted, strict=True) if counts]
        strongest, labels = (*possible, (predicted.rows.posterior((), model), ()))[0]
        explanations = predicted.posteriors[0], strongest
        plan = replace(plan, confirming=_confirmations(listed, predicted.rows, settings, explanations, labels))
    notes += [_NEW_MOUNT] if plan.from_rig and any(one.mount for one in together) else []
    best, chosen = (tuple([replace(one, purpose=plan.purpose) for one in each]) for each in (singles, together))
    return replace(plan, singles=best, together=chosen, value=whole, notes=tuple(notes), promise=promise)


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


def _remounts(diagnosis: Diagnosis) -> bool:
    """Whether the chain can describe the triad in a new mounting: by an exact mount with free angles for each mounting."""
    mounts = [link for link in diagnosis.model.nominal_chain.links if isinstance(link, Mount)]
    free = [leaf for leaf in parameters_of(tuple(mounts)) if leaf.name == "dtheta" and leaf.free]
    one_mounting = not diagnosis.from_rig or len(set(diagnosis.data.mount or ("1",))) == 1
    return len(mounts) == 1 and any(one_mounting if leaf.by is None else "mount" in leaf.by.split(".") for leaf in free)


def _watched(diagnosis: Diagnosis) -> list[int]:
    """Columns of the sensor parameters of new positions; all nominal ones if a rig fixes these."""
    chosen, where = list[int](), diagnosis.problem.where
    for leaf, columns in leaves_of(diagnosis.model):
        if leaf.name in ("dK", "bias", "gamma"):
            chosen += columns[0 if leaf.by is None else int(np.asarray(where.index(leaf.by))[-1])].tolist()
    return chosen or list(range(diagnosis.model.nominal))


def _confirmations(
    listed: Sequence[NextPosition],
    rows: Rows,
    settings: Collection[float],
    explanations: Sequence[Posterior],
    labels: tuple[str, ...],
) -> tuple[Confirmation, ...]:
    """The readings that best separate a cause from its alternative, the largest separation first.

    **Arguments:**

    - `listed`: the proposals, with their `rows`. Only single positions in the present mounting at measured pitch `settings`
      (deg) are used, as the fit predicts these.
    - `explanations`: the named causes and the strongest alternative (`labels`), each fitted to the data.
    """
    predicted = [known.predicted(np.arange(len(rows.new))[:, None]) for known in explanations]
    mean, other = (own.mean / rows.weight for own in predicted)
    sd, other_sd = (np.sqrt(np.diagonal(own.spread, axis1=1, axis2=2)) / rows.weight for own in predicted)
    apart, chosen = np.abs(mean - other) / other_sd, list[Confirmation]()
    for proposal, (cell, *_) in sorted(zip(listed, rows.cells, strict=True), key=lambda one: -np.max(apart[one[1][0]])):
        near = any(
            one.beta_deg == proposal.beta_deg
            and abs((one.alpha_deg - proposal.alpha_deg + 180.0) % 360.0 - 180.0) < _DISTANCE_DEG
            for one in chosen
        )
        axis = int(np.argmax(apart[cell]))
        usable = not proposal.mount and proposal.beta_deg in settings and apart[cell, axis] > _LEAST_SD
        if usable and not near and len(chosen) < _MOST_CONFIRMING:
            place = proposal.alpha_deg, proposal.beta_deg, AXES[axis]
            expected, rival, u, expected_u = (float(own[cell, axis]) for own in (mean, other, other_sd, sd))
            chosen.append(Confirmation(*place, expected, rival, u, expected_u, labels))
    return tuple(chosen)

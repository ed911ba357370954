"""The population `second`: physical mechanisms that were not written in terms of the catalogue (`second_instrument.py`).

Half of the cases have 7 sigma, half 15 (for a truth of two ids, that much of each); five plans, noise of 0.03 to 0.5 mg by
Allan coefficients. A mechanism is drawn again if too little of it is visible, if the stated truth leaves more than a sigma
of it, or, unlisted, if one id leaves less than 5 sigma. Measures: rms error of corrected readings at 200 new attitudes,
after the best rotation, with the calibration of the diagnosis and of the nominal model.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

import second_check as check
import second_head as geometry
import tumblecal
from blind.judge import Answer, Case, Outcome, answer_of_diagnosis, interval
from command_line import print_head, print_row
from second_instrument import KINDS, NEEDS_COLUMNS, UNLISTED


tumblecal.enable_float64()
from tumblecal.data import PositionSet  # noqa: E402
from tumblecal.diagnosis import Diagnoser  # noqa: E402
from tumblecal.lab.record import calibration_of  # noqa: E402


SIZES = (7.0, 15.0)
NOISE_G = (0.03e-3, 0.5e-3)
# Shares of flicker and random walk: hardly any, or most of the noise.
WHITE, COLOURED = (0.1, 0.1), (0.75, 1.5)
ATTITUDES = 200
COLOURED_ALONE = ("noise_coloured",)
# The least visible share is small because most of the signal of a bridge offset or a weak loop is bias and scale factor.
LEAST_SHARE, LARGEST = 0.003, 0.05
# After so many tries another plan is drawn.
_TRIES = 30


@dataclass(frozen=True)
class Hidden:
    """An instrument with its mechanism and what is measured; `sd`: of a reading, g."""

    instrument: geometry.Instrument
    schedule: geometry.Schedule
    sd: float


def cases(kind: str, count: int, seed: int) -> Iterator[Case]:
    """So many cases of a mechanism."""
    return (drawn(kind, number, seed) for number in range(count))


def drawn(kind: str, number: int, seed: int) -> Case:
    """The case of a number."""
    order, plans = list(KINDS).index(kind), [*geometry.PLANS]
    rng, d = np.random.default_rng([seed, order, number]), SIZES[number % len(SIZES)]
    known, with_columns = bool(rng.integers(2)), bool(rng.integers(2)) or kind in NEEDS_COLUMNS
    for tried in range(_TRIES * len(plans)):
        sd = float(np.exp(rng.uniform(*np.log(NOISE_G))))
        name = plans[(number // 2 + order + tried // _TRIES) % len(plans)]
        plan = geometry.schedule(name, rng)
        own = geometry.instrument(plan, rng)
        truth, mechanism = KINDS[kind](plan, rng)
        size = 0.0 if truth in ((), COLOURED_ALONE) else _size(own, plan, truth, mechanism, sd, d)
        if size is None:
            continue
        hidden = Hidden(mechanism(own, size), plan, sd)
        noise = geometry.noise(plan, sd, *(COLOURED if truth == COLOURED_ALONE else WHITE), rng)
        data = positions(hidden, geometry.readings(hidden.instrument, plan) + noise, known, with_columns)
        # Slow noise and a slow cause without a name are the same signal.
        accepted = (tuple(sorted(truth)), *([UNLISTED] if truth == COLOURED_ALONE else []))
        return Case(kind, number, name, known, accepted, data, hidden, d)
    raise RuntimeError(f"{kind} {number}: nothing drawn")


def positions(hidden: Hidden, measured: np.ndarray, known: bool, with_columns: bool) -> PositionSet:
    """The position set as it would be read from a file."""
    plan, count = hidden.schedule, len(measured)
    columns = {"time_s": plan.time_s, "temperature_degc": plan.temperature_degc, "approach": plan.approach}
    return PositionSet(
        tuple(f"p{k + 1}" for k in range(count)),
        np.degrees(plan.alpha).round(9),
        np.degrees(plan.beta).round(9),
        measured,
        sd=np.full((count, 3), hidden.sd) if known else None,
        mount=tuple("AB"[own] for own in plan.mounting) if plan.mounting.max() else None,
        **(columns if with_columns else {}),
    )


def _size(own, plan, truth: tuple[str, ...], mechanism, sd: float, d: float) -> float | None:
    """The size with a visible norm of d sigma; None if this is no fair case."""
    projector, plain = geometry.unreachable(own, plan), geometry.readings(own, plan)
    size, wanted, signal = 1e-5, d * np.sqrt(len(truth)), np.zeros(plain.size)
    for _ in range(6):
        whole = (geometry.readings(mechanism(own, size), plan) - plain).ravel() / sd
        signal = projector @ whole
        if not np.linalg.norm(signal) > LEAST_SHARE * np.linalg.norm(whole) or size > LARGEST:
            return None
        size *= wanted / np.linalg.norm(signal)
    ids = check.columns(own, plan, projector, () if truth == UNLISTED else truth)
    if truth == UNLISTED:
        others = (*ids.values(), *check.jumps(own, plan, projector))
        return size if all(check.left(signal, basis) >= 5.0 for basis in others) else None
    if any(id not in ids for id in truth):
        return None
    parts = [ids[id] for id in truth]
    needed = all(check.left(signal, *parts[:k], *parts[k + 1 :]) >= 0.6 * d for k in range(len(parts)))
    return size if needed and check.left(signal, *parts) <= 1.0 else None


def corrected(case: Case, diagnosis) -> dict[str, float]:
    """Rms error, mg, of both calibrations at new attitudes; nothing if one of them does not exist."""
    rng, plan = np.random.default_rng([case.number, 7]), case.hidden.schedule
    attitude = Rotation.random(ATTITUDES, rng=rng).as_matrix()
    force = attitude @ geometry.UP
    degc = rng.uniform(plan.temperature_degc.min(), plan.temperature_degc.max(), ATTITUDES)
    raw = geometry.outputs(case.hidden.instrument, attitude, degc)
    both = {"error / mg": diagnosis.calibration, "nominal error / mg": calibration_of(diagnosis.nominal)}
    if None in both.values():
        return {}
    errors = {}
    for name, calibration in both.items():
        found = calibration.corrected(raw, degc, float(np.mean(plan.time_s)))
        turn = Rotation.align_vectors(force, found)[0]
        errors[name] = 1e3 * float(np.sqrt(np.mean((turn.apply(found) - force) ** 2)))
    return errors


def answered(drawn: Iterable[Case]) -> Iterator[tuple[Case, Answer]]:
    """Diagnosed, plan by plan, so that one model is compiled for each."""
    diagnoser = Diagnoser(nested=False)
    for case in sorted(drawn, key=lambda case: (case.plan, case.data.time_s is not None)):
        diagnosis = diagnoser(case.data)
        yield case, answer_of_diagnosis(diagnosis, measures=corrected(case, diagnosis))


def summary(outcomes: Sequence[Outcome]) -> None:
    """Shares over all mechanisms."""
    truth = {id(own): own.case.accepted[0] for own in outcomes}
    listed = [own for own in outcomes if truth[id(own)] not in ((), UNLISTED, COLOURED_ALONE)]
    rows = {}
    for count in (1, 2):
        for size in SIZES:
            own = [one.alone for one in listed if one.case.d == size and len(truth[id(one)]) == count]
            rows[f"truth alone, {count} id(s), d = {size:g}"] = own
    rows["truth in the class, listed"] = [own.right for own in listed]
    rows["`unexplained` in the class, unlisted"] = [own.right for own in outcomes if truth[id(own)] == UNLISTED]
    rows["wrong with a probability above 0.9"] = [own.wrong for own in outcomes if truth[id(own)]]
    rows["false alarms"] = [own.detected for own in outcomes if not truth[id(own)]]
    print()
    print_head("total", "measured", "95 % interval")
    for words, own in rows.items():
        if own:
            low, high = interval(sum(own), len(own))
            print_row(words, f"{sum(own)} of {len(own)}, {np.mean(own):.1%}", f"{low:.1%} to {high:.1%}")

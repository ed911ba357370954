"""Physical mechanisms that were not written in terms of the catalogue: the second simulator of `blind_study.py`.

    python benchmarks/blind_study.py --simulator second --cases 10 --seed 1

draws the cases of each mechanism of `second_instrument.py` (half of 7, half of 15 sigma; a truth of two ids that much of each),
on five plans, with noise of 0.03 to 0.5 mg by Allan coefficients, stated or unknown, with or without columns of time,
temperature and approach. Each goes through `tumblecal.diagnose`; the calibration written is then applied at 200 held-out
attitudes, at temperatures of the measurement. A mechanism is drawn again if less than 5 % of it is visible, if the stated
truth leaves more than a sigma of it (or an id of it is not needed), or, unlisted, if one id leaves less than 5 sigma.
Measures: median rms error of corrected readings, after the best rotation, with the calibration of the diagnosis and of the
nominal model.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

import second_check as check
import second_head as head
import tumblecal
from blind_judge import Answer, Case, Outcome, answer_of_diagnosis, interval
from second_instrument import KINDS, NEEDS_COLUMNS, UNLISTED


tumblecal.enable_float64()
from tumblecal.data import PositionSet  # noqa: E402
from tumblecal.diagnosis import Diagnoser, Diagnosis  # noqa: E402
from tumblecal.report.result_file import calibration_of  # noqa: E402


SIZES = (7.0, 15.0)
NOISE_G = (0.03e-3, 0.5e-3)
# Shares of flicker and random walk (`second_head.noise`): hardly any, or most of the noise.
WHITE, COLOURED = (0.1, 0.1), (0.75, 1.5)
ATTITUDES = 200
COLOURED_ALONE = ("noise_coloured",)
# A mechanism of which less is visible, or that would be larger (rad or g), is no fair case. The share is small because most of
# the signal of an offset or a soft loop is bias and scale factor.
LEAST_SHARE, MOST = 0.003, 0.05
# Then another plan is drawn.
_TRIES = 30


@dataclass(frozen=True)
class Hidden:
    """What is hidden in which instrument; `sd`: of a reading, g."""

    instrument: head.Instrument
    schedule: head.Schedule
    sd: float


def cases(kind: str, count: int, seed: int) -> Iterator[Case]:
    """So many cases of a mechanism."""
    return (drawn(kind, number, seed) for number in range(count))


def drawn(kind: str, number: int, seed: int, sizes: Sequence[float] = SIZES) -> Case:
    """The case of a number, of one of these sizes in turn."""
    order = list(KINDS).index(kind)
    rng = np.random.default_rng([seed, order, number])
    d, plans = sizes[number % len(sizes)], [*head.PLANS]
    known, with_columns = bool(rng.integers(2)), bool(rng.integers(2)) or kind in NEEDS_COLUMNS
    for tried in range(_TRIES * len(plans)):
        sd, name = (
            float(np.exp(rng.uniform(*np.log(NOISE_G)))),
            plans[(number // 2 + order + tried // _TRIES) % len(plans)],
        )
        plan = head.schedule(name, rng)
        own = head.instrument(plan, rng)
        truth, mechanism = KINDS[kind](plan, rng)
        size = 0.0 if truth in ((), COLOURED_ALONE) else _size(own, plan, truth, mechanism, sd, d)
        if size is None:
            continue
        hidden = Hidden(mechanism(own, size), plan, sd)
        noise = head.noise(plan, sd, *(COLOURED if truth == COLOURED_ALONE else WHITE), rng)
        measured = head.readings(hidden.instrument, plan) + noise
        data = positions(hidden, measured, known, with_columns)
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
    """The size at which a mechanism shows by d sigma; None where it is no fair case."""
    projector, plain = head.unreachable(own, plan), head.readings(own, plan)
    size, wanted, signal = 1e-5, d * np.sqrt(len(truth)), np.zeros(plain.size)
    for _ in range(6):
        whole = (head.readings(mechanism(own, size), plan) - plain).ravel() / sd
        signal = projector @ whole
        if not np.linalg.norm(signal) > LEAST_SHARE * np.linalg.norm(whole) or size > MOST:
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


def corrected(case: Case, diagnosis: Diagnosis) -> tuple[float | None, float | None]:
    """Rms error, mg, of the calibrations of the extended and of the nominal model at attitudes that took no part."""
    rng, plan = np.random.default_rng([case.number, 7]), case.hidden.schedule
    attitude = Rotation.random(ATTITUDES, rng=rng).as_matrix()
    force = attitude @ head.UP
    degc = rng.uniform(plan.temperature_degc.min(), plan.temperature_degc.max(), ATTITUDES)
    raw = head.outputs(case.hidden.instrument, attitude, degc)
    errors = []
    for calibration in (diagnosis.calibration, calibration_of(diagnosis.nominal)):
        if calibration is None:
            errors.append(None)
            continue
        found = calibration.corrected(raw, degc, float(np.mean(plan.time_s)))
        turn = Rotation.align_vectors(force, found)[0]
        errors.append(1e3 * float(np.sqrt(np.mean((turn.apply(found) - force) ** 2))))
    return errors[0], errors[1]


def answered(drawn: Iterable[Case]) -> Iterator[tuple[Case, Answer]]:
    """Diagnosed, plan by plan, so that one model is compiled for each."""
    diagnoser = Diagnoser(nested=False)
    for case in sorted(drawn, key=lambda case: (case.plan, case.data.time_s is not None)):
        diagnosis = diagnoser(case.data)
        errors = dict(zip(("error / mg", "nominal error / mg"), corrected(case, diagnosis), strict=True))
        measures = {name: value for name, value in errors.items() if None not in errors.values()}
        yield case, answer_of_diagnosis(diagnosis, measures=measures)


def summary(outcomes: Sequence[Outcome]) -> None:
    """Shares over all mechanisms."""
    listed = [one for one in outcomes if one.truth not in ((), UNLISTED, COLOURED_ALONE)]
    for words, own in (
        *(
            (
                f"truth alone, {count} id{'s' * (count > 1)}, d = {size:g}",
                [one.alone for one in listed if one.d == size and len(one.truth) == count],
            )
            for size in SIZES
            for count in (1, 2)
        ),
        ("truth in the class, listed", [one.right for one in listed]),
        ("the same, unlisted", [one.right for one in outcomes if one.truth == UNLISTED]),
        ("wrong", [one.wrong for one in outcomes if one.truth]),
        ("false alarms", [one.detected for one in outcomes if not one.truth]),
    ):
        if own:
            low, high = interval(sum(own), len(own))
            print(f"{words}: {sum(own)} of {len(own)}, {np.mean(own):.1%} ({low:.1%} to {high:.1%})")

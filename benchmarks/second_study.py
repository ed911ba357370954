"""Blind study on a second instrument: physical mechanisms that were not written in terms of the catalogue.

    python benchmarks/second_study.py --cases 10 --seed 1

draws `--cases` of each mechanism of `second_instrument.py` (half of 7, half of 15 sigma; a truth of two ids that much of each),
on five plans, with noise of 0.03 to 0.5 mg by Allan coefficients, stated or unknown, with or without columns of time,
temperature and approach. Each goes through `tumblecal.diagnose`; the calibration written is then applied at 200 attitudes that
took no part, at temperatures of the measurement. A mechanism is drawn again if less than 5 % of it is visible, if the stated
truth leaves more than a sigma of it (or an id of it is not needed), or, unlisted, if one id leaves less than 5 sigma.

- alone: the truth, or what is the same function at 1 g, is claimed alone; identified: the verdict says so.
- class: the truth is the best explanation or one of its equivalents. Unlisted: the class includes `unexplained`.
- wrong: another single name with a probability above 0.9.
- error: median over the cases of the rms error of corrected readings, after the best rotation, with the calibration of the
  diagnosis / of the nominal model.
"""

import argparse
import contextlib
import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import second_check as check
import second_head as head
import tumblecal
from blind_judge import UNEXPLAINED, interval, print_reliability, right, stated, sure, with_unexplained
from second_instrument import KINDS, NEEDS_COLUMNS, UNLISTED


tumblecal.enable_float64()
from tumblecal.data import PositionSet  # noqa: E402
from tumblecal.diagnosis import Diagnoser, Diagnosis  # noqa: E402
from tumblecal.report.diagnosis_calibration import extended_calibration  # noqa: E402
from tumblecal.report.result_file import calibration_of  # noqa: E402


SIZES = (7.0, 15.0)
NOISE_G = (0.03e-3, 0.5e-3)
# Shares of flicker and random walk (`second_head.noise`): hardly any, or most of the noise.
WHITE, COLOURED = (0.1, 0.1), (0.75, 1.5)
ATTITUDES = 200
# A mechanism of which less is visible, or that would be larger (rad or g), is no fair case. The share is small because most of
# the signal of an offset or a soft loop is bias and scale factor.
LEAST_SHARE, MOST = 0.003, 0.05
# Then another plan is drawn.
_TRIES = 30


@dataclass(frozen=True)
class Case:
    """What is hidden in which instrument, and what a user has of it; `sd`: of a reading, g."""

    kind: str
    number: int
    d: float
    plan: str
    known: bool
    with_columns: bool
    sd: float
    truth: tuple[str, ...]
    own: head.Instrument
    schedule: head.Schedule
    measured: np.ndarray

    @property
    def data(self) -> PositionSet:
        """The position set as it would be read from a file."""
        plan, count = self.schedule, len(self.measured)
        columns = {"time_s": plan.time_s, "temperature_degc": plan.temperature_degc, "approach": plan.approach}
        return PositionSet(
            tuple(f"p{k + 1}" for k in range(count)),
            np.degrees(plan.alpha).round(9),
            np.degrees(plan.beta).round(9),
            self.measured,
            sd=np.full((count, 3), self.sd) if self.known else None,
            mount=tuple("AB"[own] for own in plan.mounting) if plan.mounting.max() else None,
            **(columns if self.with_columns else {}),
        )


@dataclass(frozen=True)
class Outcome:
    """One case judged; `error_mg`, `nominal_mg`: rms of corrected readings, None without a calibration."""

    kind: str
    number: int
    d: float
    plan: str
    known: bool
    with_columns: bool
    sd_mg: float
    truth: tuple[str, ...]
    said: tuple[str, ...]
    equivalents: tuple[tuple[str, ...], ...]
    probability: float
    verdict: str
    alone: bool
    in_class: bool
    stated: bool
    wrong: bool
    error_mg: float | None
    nominal_mg: float | None

    @property
    def detected(self) -> bool:
        """Whether anything is said to be wrong."""
        return self.verdict != "adequate"

    @property
    def identified(self) -> bool:
        """Whether the verdict names the truth alone."""
        return self.alone and self.verdict == "identified"

    @property
    def unexplained(self) -> bool:
        """Whether the verdict is that no entry describes it."""
        return self.verdict == "unexplained"


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
        size = 0.0 if truth in ((), ("noise_coloured",)) else _size(own, plan, truth, mechanism, sd, d)
        if size is None:
            continue
        hidden = mechanism(own, size)
        noise = head.noise(plan, sd, *(COLOURED if truth == ("noise_coloured",) else WHITE), rng)
        measured = head.readings(hidden, plan) + noise
        return Case(kind, number, d, name, known, with_columns, sd, tuple(sorted(truth)), hidden, plan, measured)
    raise RuntimeError(f"{kind} {number}: nothing drawn")


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
    rng, plan = np.random.default_rng([case.number, 7]), case.schedule
    attitude = Rotation.random(ATTITUDES, rng=rng).as_matrix()
    force = attitude @ head.UP
    degc = rng.uniform(plan.temperature_degc.min(), plan.temperature_degc.max(), ATTITUDES)
    raw = head.outputs(case.own, attitude, degc)
    errors = []
    for calibration in (extended_calibration(diagnosis), calibration_of(diagnosis.nominal)):
        if calibration is None:
            errors.append(None)
            continue
        found = calibration.corrected(raw, degc, float(np.mean(plan.time_s)))
        turn = Rotation.align_vectors(force, found)[0]
        errors.append(1e3 * float(np.sqrt(np.mean((turn.apply(found) - force) ** 2))))
    return errors[0], errors[1]


def judged(case: Case, diagnoser: Diagnoser) -> Outcome:
    """Diagnose one case and compare."""
    diagnosis = diagnoser(case.data)
    best, noise = diagnosis.best, diagnosis.noise_labels
    said = tuple(sorted(diagnosis.labels))
    claimed = sure(best) and UNEXPLAINED not in best.labels
    match case.truth:
        case ():
            alone = in_class = diagnosis.verdict == "adequate"
        case ("unexplained",):
            alone = diagnosis.verdict == "unexplained" and not noise
            in_class = with_unexplained(best, noise)
        case ("noise_coloured",):
            alone = said == case.truth
            in_class = (
                alone
                or right(best, case.truth)
                or with_unexplained(best, [own for own in noise if own not in case.truth])
            )
        case truth:
            in_class = right(best, truth, noise)
            alone = best.single_name and stated(best, truth, noise)
    listed = case.truth not in ((), UNLISTED, ("noise_coloured",))
    meant = stated(best, case.truth, noise) if listed else in_class
    error, nominal = corrected(case, diagnosis)
    return Outcome(
        case.kind, case.number, case.d, case.plan, case.known, case.with_columns, case.sd * 1e3, case.truth, said,
        best.equivalents, best.probability, diagnosis.verdict, bool(alone), bool(in_class), bool(meant),
        bool(claimed and not meant),
        error, nominal,
    )  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=10, help="of each mechanism")
    parser.add_argument("--nulls", type=int, default=0, help="of nothing hidden, where more are wanted")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", action="append", default=[], help="mechanisms whose name holds this text; repeatable")
    parser.add_argument("--number", type=int, help="a single case of each")
    parser.add_argument("--detail", action="store_true", help="list what is not alone right")
    parser.add_argument("--json", default="", help="file for all outcomes")
    args = parser.parse_args()
    kinds = [kind for kind in KINDS if not args.only or any(text in kind for text in args.only)]
    numbers = {kind: range(max(args.cases, args.nulls) if kind == "nothing" else args.cases) for kind in kinds}
    if args.number is not None:
        numbers = {kind: range(args.number, args.number + 1) for kind in kinds}
    started = time.time()
    cases = [drawn(kind, number, args.seed) for kind in kinds for number in numbers[kind]]
    # One compiled model a plan.
    cases.sort(key=lambda case: (case.plan, case.with_columns))
    diagnoser, outcomes = Diagnoser(nested=False), []
    # Ctrl-C ends the study with what there is.
    with contextlib.suppress(KeyboardInterrupt):
        for case in cases:
            outcomes.append(judged(case, diagnoser))
            if args.detail and not outcomes[-1].alone:
                print(words(outcomes[-1]), flush=True)
    report(outcomes)
    print(f"\n{len(outcomes)} cases in {time.time() - started:.0f} s")
    if args.json:
        Path(args.json).write_text(json.dumps([asdict(own) for own in outcomes], indent=1))


def words(own: Outcome) -> str:
    """One outcome in a line."""
    flag = "WRONG" if own.wrong else "ALARM" if not own.truth else "" if own.in_class else "not in class"
    conditions = (
        f"{own.plan}, {'stated' if own.known else 'unknown'}, {'columns' if own.with_columns else 'no columns'}"
    )
    others = ", ".join("+".join(labels) for labels in own.equivalents[:4]) + (" .." if len(own.equivalents) > 4 else "")
    return (
        f"{flag:12s} {own.kind} --number {own.number} (d {own.d:g}, {own.sd_mg:.2f} mg, {conditions}): "
        f"{'+'.join(own.truth)} -> {own.verdict} {own.probability:.2f} {'+'.join(own.said)} [{others}]"
    )


def report(outcomes: Sequence[Outcome]) -> None:
    """The table, the totals and the stated probabilities."""
    counted = ("detected", "alone", "identified", "in_class", "unexplained", "wrong")
    print(
        "| mechanism | truth | number | "
        + " | ".join(name.replace("in_class", "class") for name in counted)
        + " | error / mg |"
    )
    print("|---" * (len(counted) + 4) + "|")

    def row(name: str, truth: str, own: Sequence[Outcome]) -> None:
        cells = [f"{sum(getattr(one, what) for one in own)}" for what in counted]
        both = [
            (one.error_mg, one.nominal_mg) for one in own if one.error_mg is not None and one.nominal_mg is not None
        ]
        errors = " / ".join(f"{np.median(values):.3f}" for values in zip(*both, strict=True)) or "-"
        print(f"| {name} | {truth} | {len(own)} | {' | '.join(cells)} | {errors} |")

    for kind in dict.fromkeys(one.kind for one in sorted(outcomes, key=lambda one: list(KINDS).index(one.kind))):
        own = [one for one in outcomes if one.kind == kind]
        row(kind, " + ".join(sorted({id.partition(".")[0] for one in own for id in one.truth})) or "adequate", own)
    listed = [one for one in outcomes if one.truth not in ((), UNLISTED, ("noise_coloured",))]
    for size in SIZES:
        for count in (1, 2):
            if own := [one for one in listed if one.d == size and len(one.truth) == count]:
                row(f"all of {count} id{'s' * (count > 1)}, d = {size:g}", "", own)
    for words_of, own in (
        ("truth alone, one id, d = 7", [one.alone for one in listed if one.d == 7 and len(one.truth) == 1]),
        ("truth alone, one id, d = 15", [one.alone for one in listed if one.d == 15 and len(one.truth) == 1]),
        ("truth in the class, listed", [one.in_class for one in listed]),
        ("the same, unlisted", [one.in_class for one in outcomes if one.truth == UNLISTED]),
        ("wrong", [one.wrong for one in outcomes if one.truth]),
        ("false alarms", [one.detected for one in outcomes if not one.truth]),
    ):
        if own:
            low, high = interval(sum(own), len(own))
            print(f"{words_of}: {sum(own)} of {len(own)}, {np.mean(own):.1%} ({low:.1%} to {high:.1%})")
    print_reliability((one.probability, one.stated) for one in outcomes if one.detected)


if __name__ == "__main__":
    main()

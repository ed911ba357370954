"""Are the promises of NEXT kept? Instruments with a hidden cause, the proposed positions measured, diagnosed again.

    python benchmarks/promises_next.py --instruments 160 --seed 3001 --out promises.jsonl

Each instrument (`promises_instrument.py`, two simulators in plain numpy) hides one cause of 5 to 15 sigma, or two: warm-up,
drift, temperature, jumps, hysteresis, vibration at one pitch setting (noise, or an offset), a fixture that moves at one
setting, or an effect of the simulator. Where the diagnosis proposes positions to separate explanations, these are measured in
the proposed order and under the proposed conditions, and old and new positions are diagnosed as one run. A promise is kept if
the truth is then identified; if the plan states that alternatives remain, no others may. `--read FILE` prints the table of a
file again.
"""

import argparse
import json
import time
from itertools import pairwise
from pathlib import Path

import numpy as np

import in_use_instrument as first
import promises_instrument as truth
import second_head as second
import tumblecal
from tumblecal.data import PositionSet
from tumblecal.diagnosis import Diagnoser, Diagnosis
from tumblecal.ground.errors import InputError
from tumblecal.planning import NextPlan, next_plan
from tumblecal.planning.next_plan import SEPARATE
from tumblecal.planning.proposals import SIDES, Proposal, by_pitch


PROMISED = (0.0, 0.5, 0.8, 0.9, 0.95, 1.01)
SURE = 0.9
_MOUNTS = ("1", "2", "turned_y", "turned_z")


def position_set(bench: truth.Bench, plan: first.Schedule, readings: np.ndarray) -> PositionSet:
    """The positions as they are read from files of one run."""
    count = len(readings)
    return PositionSet(
        tuple(f"p{k + 1}" for k in range(count)),
        np.degrees(plan.alpha).round(6),
        np.degrees(plan.beta).round(6),
        readings,
        sd=np.full((count, 3), truth.SIGMA),
        mount=tuple(_MOUNTS[number] for number in plan.mounting) if np.ptp(plan.mounting) else None,
        time_s=plan.time_s,
        temperature_degc=plan.temperature_degc.round(2),
        approach=plan.approach,
    )


def names_truth(diagnosis: Diagnosis, sets: list[frozenset[str]]) -> bool:
    """Whether the explanation that is claimed is the hidden causes, alone or as the same function at 1 g."""
    best = diagnosis.best
    claimed = [best.labels, *best.identical, *best.powers]
    return any(frozenset([*labels, *diagnosis.noise_labels]) in sets for labels in claimed)


def in_class(diagnosis: Diagnosis, sets: list[frozenset[str]]) -> bool:
    """Whether the hidden causes are among those that are stated."""
    listed = [diagnosis.best.labels, *diagnosis.best.stated, *diagnosis.best.powers]
    return any(frozenset([*labels, *diagnosis.noise_labels]) in sets for labels in listed)


def kept(again: Diagnosis, plan: NextPlan, sets: list[frozenset[str]]) -> bool:
    """Whether the truth is among what remains, and nothing else does than the plan does not separate."""
    remaining = {*plan.promise.remaining} if plan.promise is not None else set()
    if not remaining:
        return again.verdict == "identified" and names_truth(again, sets)
    others = {again.best.labels, *again.best.separable} - remaining
    return in_class(again, sets) and len(others) <= 1


def proposed(bench: truth.Bench, plan: NextPlan, rng: np.random.Generator) -> first.Schedule:
    """The schedule with the positions of a plan, in its order and under its conditions."""
    listed = [Proposal(own.turn_deg or (own.alpha_deg,), own.beta_deg, own.mount) for own in plan.together]
    listed = listed if plan.in_reverse else by_pitch(listed)
    last, sides = int(bench.plan.mounting[-1]), [*SIDES]
    cells = [
        (alpha, own.beta_deg, truth.TURNED_Y + sides.index(own.side) if own.side else last)
        for own in listed
        for alpha in own.alpha_deg
    ]
    conditions = plan.conditions
    assert conditions is not None and conditions.time_s is not None and conditions.temperature_degc is not None
    times = conditions.time_s + conditions.step_s * np.arange(len(cells))
    degc = conditions.temperature_degc + 0.05 * rng.normal(size=len(cells))
    return bench.continued(cells, times, degc)


def one(number: int, seed: int, diagnoser: Diagnoser, kinds: list[str]) -> dict:
    """The record of an instrument: what is hidden, found, promised and found again."""
    rng = np.random.default_rng([seed, number])
    shares = np.array([truth.SHARES[kind] for kind in kinds])
    kind = str(rng.choice(kinds, p=shares / shares.sum()))
    simulator = (first, second)[number % 2]
    bench = truth.drawn(kind, simulator, rng)
    sets = [frozenset()]
    for cause, _ in bench.causes:
        sets = [known | names for known in sets for names in cause.names]
    readings = bench.measured(bench.plan, rng)
    record = {"number": number, "seed": seed, "kind": kind, "simulator": simulator.__name__, "plan": bench.plan_name}
    record["truth"] = sorted(sets[0])
    try:
        diagnosis = diagnoser(position_set(bench, bench.plan, readings))
        plan = next_plan(diagnosis)
    except InputError as fault:
        return record | {"refused": str(fault)}
    record |= {"verdict": diagnosis.verdict, "labels": diagnosis.labels, "p": diagnosis.best.probability}
    record |= {"class": [*map(list, diagnosis.best.separable)], "right": names_truth(diagnosis, sets)}
    record["truth_in_class"] = in_class(diagnosis, sets)
    promise = plan.promise
    if promise is None or plan.purpose != SEPARATE:
        return record
    assert plan.conditions is not None
    record |= {
        "promise": promise.probability,
        "made": promise.made,
        "remaining": promise.remaining,
        "excluded": promise.excluded,
        "positions": plan.positions,
        "in_reverse": plan.in_reverse,
        "where": [(own.alpha_deg, own.beta_deg, own.mount) for own in plan.together],
        "after_s": plan.conditions.after_s,
        "degc": (plan.conditions.temperature_degc, plan.conditions.last_temperature_degc),
    }
    more = proposed(bench, plan, rng)
    new = bench.measured(more, rng)[len(readings) :]
    try:
        again = diagnoser(position_set(bench, more, np.concatenate([readings, new])))
    except InputError as fault:
        return record | {"kept": False, "wrong": False, "refused": str(fault)}
    sure = again.best.probability > SURE and again.verdict in ("identified", "ambiguous")
    record |= {"verdict_2": again.verdict, "labels_2": again.labels, "p_2": again.best.probability}
    record |= {"class_2": [*map(list, again.best.separable)], "in_class_2": in_class(again, sets)}
    record["kept"] = kept(again, plan, sets)
    record["wrong"] = sure and not in_class(again, sets)
    return record


def table(records: list[dict]) -> None:
    """Promises by bin: how many were kept; joined diagnoses that are wrong with a probability above 0.9."""
    measured = [record for record in records if "kept" in record]
    verdicts: dict[str, int] = {}
    for record in records:
        name = record.get("verdict", "refused")
        verdicts[name] = verdicts.get(name, 0) + 1
    print(f"{len(records)} instruments; at first {verdicts}; {len(measured)} with positions to separate explanations")
    print("| promised | mean | instruments | kept | joined wrong, p > 0.9 |\n|---|---|---|---|---|")
    for low, high in pairwise(PROMISED):
        own = [record for record in measured if low <= record["promise"] < high]
        if own:
            mean, good = np.mean([record["promise"] for record in own]), sum(record["kept"] for record in own)
            bad = sum(record["wrong"] for record in own)
            print(f"| {low:g} to {min(high, 1):g} | {mean:.3f} | {len(own)} | {good} ({good / len(own):.0%}) | {bad} |")
    for words, own in (("made", [r for r in measured if r["made"]]), ("all", measured)):
        good, bad, count = sum(r["kept"] for r in own), sum(r["wrong"] for r in own), max(len(own), 1)
        print(f"{words}: {len(own)}, kept {good} ({good / count:.1%}), joined wrong {bad} ({bad / count:.1%})")
    for kind in truth.SHARES:
        own = [record for record in measured if record["kind"] == kind]
        made = [record for record in own if record["made"]]
        print(
            f"{kind}: promised {sum(r['kept'] for r in made)}/{len(made)}, all {sum(r['kept'] for r in own)}/{len(own)}"
        )


def main() -> None:
    """Draw, diagnose, continue, diagnose again; print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--instruments", type=int, default=160)
    parser.add_argument("--first", type=int, default=0, help="number of the first instrument")
    parser.add_argument("--seed", type=int, default=3001)
    parser.add_argument("--only", nargs="*", default=[*truth.SHARES], choices=[*truth.SHARES], help="kinds of causes")
    parser.add_argument("--out", type=Path, help="records, a line each, written when each is ready")
    parser.add_argument("--read", type=Path, help="print the table of these records")
    options = parser.parse_args()
    if options.read is not None:
        table([json.loads(line) for line in options.read.read_text().splitlines()])
        return
    tumblecal.enable_float64()
    from tumblecal.cli.start import start

    start()
    diagnoser, records = Diagnoser(nested=False), []
    for number in range(options.first, options.first + options.instruments):
        began = time.perf_counter()
        record = one(number, options.seed, diagnoser, options.only)
        record["seconds"] = round(time.perf_counter() - began, 1)
        records.append(record)
        if options.out is not None:
            with options.out.open("a") as file:
                file.write(json.dumps(record) + "\n")
    table(records)


if __name__ == "__main__":
    main()

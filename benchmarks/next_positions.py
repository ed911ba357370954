"""Do the proposed positions do what is promised? Hidden effects, proposals measured by the blind instrument, diagnosed again.

    python benchmarks/next_positions.py --cases 200

Every instrument hides one random effect, with time and temperature recorded; in every second one the temperature rises in
proportion to the time. Where the diagnosis is ambiguous, the proposed positions are measured under the proposed conditions,
in the proposed order, and old and new positions are diagnosed together as one run: was the question settled as promised? Also
the time that the proposals take.
"""

import argparse
import time
from dataclasses import replace
from typing import NamedTuple

import numpy as np

import blind_instrument as blind
import tumblecal
from blind_noise import position_set
from tumblecal.diagnosis import Diagnoser, Diagnosis
from tumblecal.planning import NextPlan, next_plan
from tumblecal.planning.next_plan import SEPARATE
from tumblecal.planning.proposals import Allowed, Proposal, by_pitch


# Old pitch settings only: then every measurement has one model for each number of positions.
OLD_SETTINGS = Allowed(beta_deg=(0.0, 45.0, 90.0), remount=False)
# Change of temperature over a run in which it rises with the time, degC.
RAMP_DEGC = 3.0


class Outcome(NamedTuple):
    """What became of one ambiguous case: the `verdict` of old and new positions, whether that is `right`."""

    hidden: str
    ramp: bool
    plan: NextPlan
    verdict: str
    right: bool
    labels: tuple[str, ...]


def names_true(diagnosis: Diagnosis, hidden: str) -> bool:
    """Whether the hidden effect is what is named, alone or as the same function at 1 g."""
    return (hidden,) in (diagnosis.best.labels, *diagnosis.best.identical)


def settled(diagnosis: Diagnosis, hidden: str, plan: NextPlan) -> bool:
    """Whether the truth is among what remains, and nothing else does than what the plan does not separate."""
    best = diagnosis.best
    remaining = {*plan.promise.remaining} if plan.promise is not None else set()
    members = {best.labels, *best.separable}
    hit = (hidden,) in {*members, *best.identical}
    if not remaining:
        return hit and diagnosis.verdict == "identified"
    return hit and len(members - remaining) <= 1


def measured(setup: blind.Setup, plan: NextPlan, rng: np.random.Generator) -> blind.Setup:
    """The instrument with the positions of a plan, in its order and under its conditions."""
    listed = by_pitch(Proposal((own.alpha_deg,), own.beta_deg, own.mount) for own in plan.together)
    cells = [(alpha, own.beta_deg) for own in listed for alpha in own.alpha_deg]
    more, conditions = blind.extended(setup, cells, rng), plan.conditions
    assert conditions is not None and conditions.time_s is not None and conditions.temperature_degc is not None
    new = np.arange(len(setup.alpha), len(more.alpha))
    more.time_s[new] = conditions.time_s + conditions.step_s * np.arange(len(cells))
    more.temperature_degc[new] = conditions.temperature_degc + 0.1 * rng.normal(size=len(cells))
    return more


def one_case(diagnoser: Diagnoser, seed: int, least: float, most: float) -> Outcome | str | None:
    """An instrument with a random effect; None if none of it shows, the verdict if that is not ambiguous."""
    rng = np.random.default_rng(seed)
    setup = blind.random_setup(rng, 3, 8)
    ramp = bool(seed % 2)
    if ramp:
        share = (setup.time_s - setup.time_s[0]) / np.ptp(setup.time_s)
        setup = replace(setup, temperature_degc=setup.temperature_degc[0] + RAMP_DEGC * share)
    names = list(blind.COEFFICIENTS)
    if rng.uniform() < 0.5:
        names = [name for name in names if any(word in name for word in ("drift", "temper", "warm"))]
    hidden = str(rng.choice(names))
    sized = blind.sized(setup, blind.unreachable(setup), hidden, rng.uniform(least, most), rng)
    if sized is None:
        return None
    effects = {hidden: sized[0]}
    readings = blind.readings(setup, setup.nominal, effects)
    readings = readings + blind.SIGMA * rng.normal(size=readings.shape)
    diagnosis = diagnoser(position_set(setup, readings, known=True))
    if diagnosis.verdict != "ambiguous":
        right = diagnosis.verdict == "identified" and names_true(diagnosis, hidden)
        return f"{diagnosis.verdict}{'' if right or diagnosis.verdict != 'identified' else ' WRONG'}"
    plan = next_plan(diagnosis, OLD_SETTINGS)
    if plan.purpose != SEPARATE:
        return Outcome(hidden, ramp, plan, "not worth measuring", False, ())
    more = measured(setup, plan, rng)
    new = blind.readings(more, more.nominal, effects)[len(readings) :]
    new = new + blind.SIGMA * rng.normal(size=new.shape)
    again = diagnoser(position_set(more, np.concatenate([readings, new]), known=True))
    return Outcome(hidden, ramp, plan, again.verdict, settled(again, hidden, plan), again.best.labels)


def wrong(outcome: Outcome) -> bool:
    """Whether a cause is identified that is not there."""
    return outcome.verdict == "identified" and not outcome.right


def shares(outcomes: list[Outcome], what: str) -> None:
    """How many were settled, rightly and wrongly."""
    count = max(1, len(outcomes))
    good, bad = sum(own.right for own in outcomes), sum(map(wrong, outcomes))
    expected = np.mean([own.plan.promise.probability for own in outcomes]) if outcomes else np.nan
    print(
        f"{what}: {len(outcomes)}; settled {good} ({good / count:.1%}; expected {expected:.1%}), "
        f"wrongly {bad} ({bad / count:.1%})"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=200, help="instruments whose first diagnosis is ambiguous")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--size", type=float, nargs=2, default=(5.0, 15.0), help="of the hidden effect, sigma")
    options = parser.parse_args()
    tumblecal.enable_float64()
    from tumblecal.cli.start import start

    start()
    diagnoser = Diagnoser(nested=False)
    outcomes: list[Outcome] = []
    verdicts: dict[str, int] = {}
    seed = options.seed
    while len(outcomes) < options.cases:
        case = one_case(diagnoser, seed, *options.size)
        seed += 1
        if isinstance(case, str):
            verdicts[case] = verdicts.get(case, 0) + 1
        if not isinstance(case, Outcome):
            continue
        outcomes.append(case)
        promise, conditions = case.plan.promise, case.plan.conditions
        if promise is None or conditions is None:
            print(f"{seed - 1:4d} {case.hidden:22s} no alternative that predicts anything", flush=True)
            continue
        print(
            f"{seed - 1:4d} {case.hidden:22s} {'ramp' if case.ramp else '    '} {case.plan.positions:2d} positions after "
            f"{conditions.after_s:5.0f} s at {conditions.temperature_degc:5.2f} degC ({conditions.last_degc:5.2f}): "
            f"p = {promise.probability:.2f} odds {promise.odds:8.2g} remaining {len(promise.remaining)}: {case.verdict} "
            f"{'right' if case.right else ' + '.join(case.labels)}",
            flush=True,
        )
    print(f"{seed - options.seed} instruments; at first {verdicts}, ambiguous {len(outcomes)}")
    worth = [own for own in outcomes if own.plan.purpose == SEPARATE]
    shares([own for own in worth if own.plan.promise.made], "promised")
    shares(
        [own for own in worth if own.plan.promise.made and not own.plan.promise.remaining],
        "promised, nothing remaining",
    )
    shares([own for own in worth if not own.plan.promise.made], "not promised, measured all the same")
    print(f"not worth measuring, or no alternative that predicts anything: {len(outcomes) - len(worth)}")
    timing(diagnoser)


def timing(diagnoser: Diagnoser) -> None:
    """Seconds of a diagnosis with and without proposals, compiled before."""
    rng = np.random.default_rng(0)
    setup = blind.random_setup(rng, 3, 8)
    readings = blind.readings(setup, setup.nominal, {})
    data = position_set(setup, readings + blind.SIGMA * rng.normal(size=readings.shape), known=True)
    next_plan(diagnoser(data))
    times = []
    for _ in range(20):
        begin = time.perf_counter()
        diagnosis = diagnoser(data)
        diagnosed = time.perf_counter()
        next_plan(diagnosis)
        times.append((diagnosed - begin, time.perf_counter() - begin))
    without, with_them = np.min(times, axis=0)
    print(f"24 positions: {without:.3f} s without proposals, {with_them:.3f} s with them (best of 20)")


if __name__ == "__main__":
    main()

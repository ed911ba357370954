"""Do the proposed positions do what is promised? Hidden effects, proposals measured by the blind instrument, diagnosed again.

    python benchmarks/next_positions.py --cases 100

Random effects; where the right explanation leads and has rivals that can be separated: how much its log odds against them
were expected to rise, and how much they rose. Also the time that the proposals take.
"""

import argparse
import time

import numpy as np

import blind_instrument as blind
import tumblecal
from tumblecal.data import PositionSet
from tumblecal.diagnosis import Diagnoser, Diagnosis
from tumblecal.planning import next_plan
from tumblecal.planning.next_plan import SEPARATE
from tumblecal.planning.proposals import Allowed


# Old pitch settings only: then every measurement has one model for each number of positions.
OLD_SETTINGS = Allowed(beta_deg=(0.0, 45.0, 90.0), remount=False)
# Effects that need no optional column.
HIDDEN = [
    name for name in blind.COEFFICIENTS if not any(word in name for word in ("drift", "temper", "warm", "backlash"))
]


def data_of(setup: blind.Setup, readings: np.ndarray) -> PositionSet:
    """The readings as a position set without optional columns."""
    sd = np.full(readings.shape, blind.SIGMA)
    return PositionSet(tuple(setup.names), np.degrees(setup.alpha), np.degrees(setup.beta), readings, sd=sd)


def effect_scores(diagnosis: Diagnosis) -> dict[str, float]:
    """Log posterior of each single effect in the screen."""
    ranked, causes = diagnosis.screened.search.ranked(), diagnosis.screened.pool.causes
    scores: dict[str, float] = {}
    for members, value in zip(ranked.members, ranked.log_posterior, strict=True):
        if members[0] >= 0 > members[1] and causes[members[0]].slot.columns:
            scores.setdefault(causes[members[0]].label, float(value))
    return scores


def share(scores: dict[str, float], right: str, rivals: list[str]) -> float:
    """Log odds of the right effect against its rivals together."""
    return -float(np.log(sum(np.exp(scores.get(rival, min(scores.values())) - scores[right]) for rival in rivals)))


def one_case(diagnoser: Diagnoser, seed: int, least: float, most: float):
    """A random effect: said and got; None where the right explanation does not lead or has no rival to be told from."""
    rng = np.random.default_rng(seed)
    setup = blind.random_setup(rng, 3, 8)
    projector = blind.unreachable(setup)
    hidden = str(rng.choice(HIDDEN))
    sized = blind.sized(setup, projector, hidden, rng.uniform(least, most), rng)
    if sized is None:
        return None
    effects = {hidden: sized[0]}
    readings = blind.readings(setup, setup.nominal, effects)
    readings = readings + blind.SIGMA * rng.normal(size=readings.shape)
    diagnosis = diagnoser(data_of(setup, readings))
    proposed = next_plan(diagnosis, OLD_SETTINGS)
    if diagnosis.best.labels != (hidden,) or proposed.purpose != SEPARATE:
        return None
    before = effect_scores(diagnosis)
    hopeless = " ".join(proposed.notes)
    listed = [
        *diagnosis.best.equivalents,
        *(told.labels for told in diagnosis.screened.explanations if told.probability > 0.01),
    ]
    rivals = [
        labels[0]
        for labels in listed
        if len(labels) == 1 and labels[0] in before and labels[0] != hidden and labels[0] not in hopeless
    ]
    if not rivals or hidden in rivals:
        return None
    more = blind.extended(setup, [(position.alpha_deg, position.beta_deg) for position in proposed.together], rng)
    new = blind.readings(more, more.nominal, effects)[len(readings) :]
    again = diagnoser(data_of(more, np.concatenate([readings, new + blind.SIGMA * rng.normal(size=new.shape)])))
    after = effect_scores(again)
    if hidden not in after:
        return None
    got = share(after, hidden, rivals) - share(before, hidden, rivals)
    return hidden, proposed.value, got, share(before, hidden, rivals), len(new)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=100)
    parser.add_argument("--size", type=float, nargs=2, default=(5.0, 10.0), help="of the hidden effect, sigma")
    options = parser.parse_args()
    tumblecal.enable_float64()
    from tumblecal.cli.start import start

    start()
    diagnoser = Diagnoser()
    rows = []
    for seed in range(options.cases):
        row = one_case(diagnoser, seed, *options.size)
        if row is not None:
            rows.append(row)
            name, said, got, before, count = row
            print(
                f"{name:22s} {count:2d} positions: said {said:5.2f} got {got:6.2f}, log odds before {before:5.2f}",
                flush=True,
            )
    said, got = (np.array([row[k] for row in rows]) for k in (1, 2))
    error = got.std() / np.sqrt(len(got))
    print(
        f"{len(rows)} of {options.cases} cases: said {said.mean():.2f}, got {got.mean():.2f} +- {error:.2f} (log Bayes factor)"
    )
    print(f"log odds rose in {np.mean(got > 0):.0%}")
    timing(diagnoser)


def timing(diagnoser: Diagnoser) -> None:
    """Seconds of a diagnosis with and without proposals, compiled before."""
    setup = blind.random_setup(np.random.default_rng(0), 3, 8)
    data = data_of(
        setup, blind.readings(setup, setup.nominal, {}) + 1e-4 * np.random.default_rng(1).normal(size=(24, 3))
    )
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

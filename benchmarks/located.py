"""Is an effect found where it acts: everywhere, at one pitch setting, or in the second half of the measurement?

    python benchmarks/located.py --cases 120 --seed 1

Instruments and effects are those of the blind study, on 24 and 48 positions, the noise stated in half of the cases. An effect
cut to a part is told where it is the first of `located`; of one that acts everywhere none may be told. The effect's size is
the norm of what the nominal model cannot reach of it, in sigma, after the cut.
"""

import argparse
from collections import Counter

import numpy as np

import blind_instrument as blind
import tumblecal


tumblecal.enable_float64()
from blind_noise import PLANS, position_set  # noqa: E402
from tumblecal.diagnosis import Diagnoser, Diagnosis  # noqa: E402


# An effect of which less is left is hidden by the cut.
LEAST_SHARE = 0.2
# These are by setting or by time themselves.
NAMES = [name for name in blind.COEFFICIENTS if name not in ("warm_up", "gravity_value") and "drift" not in name]
PARTS = ("everywhere", "one setting", "second half")


def case(rng: np.random.Generator, plan: str, part: str, d: float) -> tuple[blind.Setup, np.ndarray, str]:
    """Setup, readings and the hidden effect."""
    while True:
        setup = blind.random_setup(rng, *PLANS[plan])
        count, projector = len(setup.alpha), blind.unreachable(setup)
        name = NAMES[rng.integers(len(NAMES))]
        drawn = blind.sized(setup, projector, name, d, rng)
        if drawn is None:
            continue
        here = {
            "everywhere": np.ones(count, bool),
            "one setting": setup.pitch == rng.integers(setup.pitch.max() + 1),
            "second half": np.arange(count) >= count // 2,
        }[part]
        plain = blind.readings(setup, setup.nominal, {})
        signal = (blind.readings(setup, setup.nominal, {name: drawn[0]}) - plain) * here[:, None] / blind.SIGMA
        left = np.linalg.norm(projector @ signal.ravel())
        if left <= LEAST_SHARE * np.linalg.norm(signal):
            continue
        return setup, plain + blind.SIGMA * (signal * d / left + rng.normal(size=signal.shape)), name


def judged(diagnosis: Diagnosis, name: str, part: str) -> str:
    """What became of a case, in a word."""
    told = diagnosis.located[0].effect if diagnosis.located else None
    best, members = diagnosis.best, diagnosis.members
    named = (name,) in (best.labels, *best.equivalents)
    if part == "everywhere":
        return "right" if told is None and named else "not named" if told is None else "wrong part"
    if told is None and diagnosis.verdict == "identified" and best.probability > 0.9 and members:
        return "right effect everywhere" if named else "wrong and sure"
    return (
        "right" if told == name else "among those told" if any(t.effect == name for t in diagnosis.located) else "else"
    )


def main() -> None:
    """All cases, counted by part."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=120)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--size", type=float, default=15.0, help="sigma")
    args = parser.parse_args()
    diagnoser, counted = Diagnoser(nested=False), {part: Counter[str]() for part in PARTS}
    for number in range(args.cases):
        rng, part = np.random.default_rng([args.seed, number]), PARTS[number % 3]
        plan, known = list(PLANS)[number // 3 % 2], bool(number // 6 % 2)
        setup, readings, name = case(rng, plan, part, args.size)
        counted[part][judged(diagnoser(position_set(setup, readings, known)), name, part)] += 1
    for part, counts in counted.items():
        print(f"{part:12s}", ", ".join(f"{what} {count}" for what, count in counts.most_common()))


if __name__ == "__main__":
    main()

"""Every attitude measured twice, with an error that belongs to the attitude: is it taken for noise?

    python benchmarks/blind_repeats.py --cases 18 --what axis

`axis`: an error of one axis, another at each attitude, the same in both readings of it; `two`: two attitudes off on all axes;
`noise`: one axis three times as noisy, which is noise; `null`: nothing. 3 x 8 and 4 x 12 positions in one run and in two, noise
stated and unknown. Errors have a norm of `--d` noise sd in what the nominal model cannot reach.
"""

import argparse
from collections import Counter

import numpy as np

import blind_conditions
import blind_instrument as blind
import blind_noise
import tumblecal


tumblecal.enable_float64()
from tumblecal.data import PositionSet  # noqa: E402
from tumblecal.diagnosis import Diagnoser  # noqa: E402


PLANS = ((3, 8), (4, 12))
WHAT = ("axis", "two", "noise", "null")


def case(rng: np.random.Generator, number: int, what: str, d: float) -> PositionSet:
    """One data set."""
    how, known = ("one run", "two runs")[number % 2], number % 3 > 0
    once = blind.random_setup(rng, *PLANS[number // 6 % 2])
    setup, count = blind_conditions.twice(once, how), len(once.alpha)
    own, sd = np.zeros((count, 3)), np.ones(3)
    if what == "axis":
        own[:, rng.integers(3)] = rng.normal(size=count)
    elif what == "two":
        own[rng.choice(count, 2, replace=False)] = rng.normal(size=(2, 3))
    elif what == "noise":
        sd[rng.integers(3)] = 3.0
    error = np.vstack([own, own])
    shown = np.linalg.norm(blind.unreachable(setup) @ error.ravel())
    error *= d / shown if shown else 0.0
    clean = blind.readings(setup, setup.nominal, {})
    readings = clean + blind.SIGMA * (sd * rng.normal(size=clean.shape) + error)
    runs = tuple("1" * count + "2" * count) if how == "two runs" else None
    return PositionSet(**vars(blind_noise.position_set(setup, readings, known)) | {"run": runs})


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=18)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--what", choices=WHAT, default="axis")
    parser.add_argument("--d", type=float, default=14.0)
    args = parser.parse_args()
    rng, found, diagnoser = np.random.default_rng([args.seed, 9, len(args.what)]), Counter(), Diagnoser(nested=False)
    for number in range(args.cases):
        diagnosis = diagnoser(case(rng, number, args.what, args.d))
        ids = sorted({label.partition(":")[0] for label in diagnosis.labels})
        found[f"{diagnosis.verdict} {' + '.join(ids)}".strip()] += 1
    for words, count in found.most_common():
        print(f"{words}: {count} of {args.cases}")


if __name__ == "__main__":
    main()

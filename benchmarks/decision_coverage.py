"""Do the intervals of the sensor's parameters hold the truth, whatever the diagnosis decided?

    python benchmarks/decision_coverage.py --cases 400

One effect of the blind study's list, of 2 to 10 sigma, or none, on 24 positions; the noise stated in half of the cases. Of
each verdict the share of 95 % intervals of dK, bias and gamma that hold the truth: of the best explanation's own fit, and of
the average over explanations that an ambiguous one writes.
"""

import argparse
from collections import defaultdict

import numpy as np
from scipy import stats

import blind_instrument as blind
import tumblecal


tumblecal.enable_float64()
from blind_study import position_set  # noqa: E402
from tumblecal.diagnosis import Diagnoser  # noqa: E402
from tumblecal.diagnosis.findings.decision import averaged  # noqa: E402
from tumblecal.estimation.fit import Fit  # noqa: E402


def held(fit: Fit, nominal: dict[str, np.ndarray]) -> list[bool]:
    """Which 95 % intervals of the sensor's parameters hold the truth."""
    truth = np.concatenate([nominal["dK"], nominal["bias"], nominal["gamma"]])
    names = (*(f"{leaf}_{axis}" for leaf in ("dK", "bias") for axis in "xyz"), "gamma_21", "gamma_31", "gamma_32")
    here = [fit.names.index(name) for name in names]
    wide = 1.96 if fit.problem.known else stats.t.ppf(0.975, fit.dof)
    return (np.abs(fit.values[here] - truth) < wide * fit.sd[here]).tolist()


def main() -> None:
    """All cases, counted by verdict."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    diagnoser = Diagnoser(nested=False)
    winner, average = defaultdict(list), defaultdict(list)
    names = list(blind.COEFFICIENTS)
    for number in range(args.cases):
        rng = np.random.default_rng([args.seed, number])
        drawn, effects = None, {}
        while drawn is None:
            setup, name = blind.random_setup(rng, 3, 8), names[rng.integers(len(names))]
            drawn = blind.sized(setup, blind.unreachable(setup), name, rng.uniform(2, 10), rng)
        if number % 4:
            effects = {name: drawn[0]}
        clean = blind.readings(setup, setup.nominal, effects)
        data = position_set(setup, clean + blind.SIGMA * rng.normal(size=clean.shape), bool(number % 2))
        diagnosis = diagnoser(data)
        mean = averaged(diagnosis.screened) if diagnosis.verdict == "ambiguous" else None
        winner[diagnosis.verdict] += held(diagnosis.extended, setup.nominal)
        average[diagnosis.verdict] += held(diagnosis.extended if mean is None else mean.as_fit, setup.nominal)
    for verdict in winner:
        own, mixed = winner[verdict], average[verdict]
        print(f"{verdict:12s} {len(own):5d} intervals: best alone {np.mean(own):.1%}, as written {np.mean(mixed):.1%}")


if __name__ == "__main__":
    main()

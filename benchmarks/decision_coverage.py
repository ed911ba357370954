"""Do the intervals of the sensor's parameters hold the truth, whatever the diagnosis decided?

    python benchmarks/decision_coverage.py --cases 400
    python benchmarks/decision_coverage.py --cases 400 --rare --sigma 30 300 --plan 4x6

One effect of the blind study's list (`--rare`: or of those met less often), of 2 to 10 sigma, or none, on 24 positions; the
noise stated in half of the cases. Of each verdict the share of 95 % intervals of dK, bias and gamma that hold the truth: of the
best explanation's own fit, and of the average over explanations that an ambiguous one writes; of what is written, that of the
parameters said to be not determined, and the farthest in half widths.
"""

import argparse
from collections import defaultdict

import numpy as np
from scipy import stats

import blind_instrument as blind
import tumblecal


tumblecal.enable_float64()
from blind_study import position_set  # noqa: E402
from tumblecal.data.sensor_parameters import SENSOR  # noqa: E402
from tumblecal.diagnosis import Diagnoser  # noqa: E402
from tumblecal.diagnosis.findings.decision import averaged  # noqa: E402
from tumblecal.estimation.fit import Fit  # noqa: E402


def off(fit: Fit, nominal: dict[str, np.ndarray]) -> list[float]:
    """How far the sensor's parameters are from the truth, in half widths of their 95 % intervals."""
    truth = np.concatenate([nominal["dK"], nominal["bias"], nominal["gamma"]])
    here = [fit.names.index(name) for name in SENSOR]
    wide = 1.96 if fit.problem.known else stats.t.ppf(0.975, fit.dof)
    return (np.abs(fit.values[here] - truth) / (wide * fit.sd[here])).tolist()


def main() -> None:
    """All cases, counted by verdict."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rare", action="store_true", help="effects met less often as well")
    parser.add_argument("--sigma", type=float, nargs=2, default=(2, 10), help="the smallest and the largest size")
    parser.add_argument("--plan", default="3x8", help="pitch settings x spindle angles")
    args = parser.parse_args()
    plan = tuple(map(int, args.plan.split("x")))
    diagnoser = Diagnoser(nested=False)
    winner, average, left = defaultdict(list), defaultdict(list), defaultdict(list)
    names = [*blind.COEFFICIENTS, *(blind.RARE if args.rare else ())]
    for number in range(args.cases):
        rng = np.random.default_rng([args.seed, number])
        drawn, effects = None, {}
        while drawn is None:
            setup, name = blind.random_setup(rng, *plan), names[rng.integers(len(names))]
            drawn = blind.sized(setup, blind.unreachable(setup), name, rng.uniform(*args.sigma), rng)
        if number % 4:
            effects = {name: drawn[0]}
        clean = blind.readings(setup, setup.nominal, effects)
        data = position_set(setup, clean + blind.SIGMA * rng.normal(size=clean.shape), bool(number % 2))
        diagnosis = diagnoser(data)
        mean = averaged(diagnosis.screened) if diagnosis.verdict == "ambiguous" else None
        written = diagnosis.extended if mean is None else mean.as_fit
        winner[diagnosis.verdict] += off(diagnosis.extended, setup.nominal)
        average[diagnosis.verdict] += off(written, setup.nominal)
        left[diagnosis.verdict] += [name in written.undetermined for name in SENSOR]
    for verdict in winner:
        own, mixed, open_ = (np.array(listed[verdict]) for listed in (winner, average, left))
        shares = f"best alone {np.mean(own < 1):.1%}, as written {np.mean(mixed < 1):.1%}, farthest {np.max(mixed):.1f}"
        said = f"; not determined {np.mean(mixed[open_] < 1):.1%} of {open_.sum()}" if open_.any() else ""
        print(f"{verdict:12s} {len(own):5d} intervals: {shares}{said}")


if __name__ == "__main__":
    main()

"""Do the intervals of the sensor's parameters hold the truth, whatever the diagnosis decided?

    python benchmarks/decision_coverage.py --cases 400
    python benchmarks/decision_coverage.py --cases 400 --rare --sigma 30 300 --plan 4x6

One effect of the blind study's list (`--rare`: or of those met less often), of 2 to 10 sigma, or none, on 24 positions; the
noise stated in half of the cases. Of each verdict the share of 95 % intervals of dK, bias and gamma that hold the truth at the
mean time, temperature (25 degC where a term of it is written) and setting: of the best explanation's own fit, and of what is
written; of the latter that of the parameters said to be not determined, and the farthest in half widths.
"""

import argparse
from collections import defaultdict
from dataclasses import replace

import numpy as np
from scipy import stats

import blind_instrument as blind
import tumblecal


tumblecal.enable_float64()
from blind_noise import position_set  # noqa: E402
from tumblecal.data.sensor_parameters import SENSOR  # noqa: E402
from tumblecal.diagnosis import Diagnoser  # noqa: E402
from tumblecal.diagnosis.findings.model_average import is_thermal  # noqa: E402
from tumblecal.diagnosis.findings.reference import at_reference, moved_to_reference  # noqa: E402
from tumblecal.estimation.fit import Fit  # noqa: E402


def at_the_mean(setup: blind.Setup, effects: dict[str, np.ndarray], thermal: bool) -> dict[str, np.ndarray]:
    """The nominal parameters that describe the instrument at the mean time and setting, and at the mean temperature where no
    term of it is written (`thermal`)."""
    ((name, sizes),) = effects.items() or [("", ())]
    nominal = {key: values.copy() for key, values in setup.nominal.items()}
    kind, _, axis = name.partition(".")
    if kind.endswith("_by_pitch"):
        shares = np.bincount(setup.pitch)[1:] / len(setup.pitch)
        nominal[{"bias": "bias", "scale": "dK"}[kind.split("_")[0]]]["xyz".index(axis)] += shares @ sizes
    elif kind.endswith("_drift") or (kind.endswith("_temperature") and not thermal):
        steady = setup.temperature_degc * 0 + setup.temperature_degc.mean()
        time = setup.time_s.mean() + 1e-6 * np.arange(len(setup.time_s))
        time[0] = setup.time_s[0]
        there = replace(setup, temperature_degc=steady, time_s=time)
        signal = blind.readings(there, nominal, effects) - blind.readings(there, nominal, {})
        # Without the first position, from which the time counts.
        shift = np.linalg.lstsq(blind.nominal_columns(there)[3:], signal[1:].ravel(), rcond=None)[0]
        for key, values in nominal.items():
            nominal[key], shift = values + shift[: len(values)], shift[len(values) :]
    return nominal


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
        thermal, at, written = is_thermal(diagnosis.members), diagnosis.screened.at, diagnosis.in_use.as_fit
        added = moved_to_reference(at, [cause.slot.id for cause in diagnosis.members], thermal=thermal)
        truth = at_the_mean(setup, effects, thermal)
        winner[diagnosis.verdict] += off(at_reference(diagnosis.extended, at, added), truth)
        average[diagnosis.verdict] += off(written, truth)
        left[diagnosis.verdict] += [name in written.undetermined for name in SENSOR]
    for verdict in winner:
        own, mixed, open_ = (np.array(listed[verdict]) for listed in (winner, average, left))
        shares = f"best alone {np.mean(own < 1):.1%}, as written {np.mean(mixed < 1):.1%}, farthest {np.max(mixed):.1f}"
        said = f"; not determined {np.mean(mixed[open_] < 1):.1%} of {open_.sum()}" if open_.any() else ""
        print(f"{verdict:12s} {len(own):5d} intervals: {shares}{said}")


if __name__ == "__main__":
    main()

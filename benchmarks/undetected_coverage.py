"""Do the intervals hold for instruments with several errors at once, most of them too small to be found?

    python benchmarks/undetected_coverage.py --cases 10 --seed 200
    python benchmarks/undetected_coverage.py --cases 10 --seed 200 --plans cube 3x8 --populations mixed

Simulates the instruments of `undetected_instrument` by each plan, diagnoses them and compares the 95 % intervals of
calibration.json with the truth: those of dK, bias and gamma, and those of corrected readings at 20 new attitudes and
temperatures by the covariance of matrix and bias. The other columns are the ablation: covariances without a contribution.
Widths are median ratios of the standard uncertainty to that by the noise alone. The numbers of
`diagnosis.findings.effect_posterior` were set with seeds below 100, and 300; statements are from others.
"""

import argparse
import time
from collections import defaultdict
from dataclasses import replace

import numpy as np
from scipy import stats

import blind_instrument as blind
import tumblecal
from undetected_instrument import PLANS, POPULATIONS, Instrument, instrument, sensor_readings, truth_at_the_mean


tumblecal.enable_float64()
from blind_noise import position_set  # noqa: E402
from tumblecal.data.sensor_parameters import SENSOR  # noqa: E402
from tumblecal.diagnosis import Diagnoser, Diagnosis  # noqa: E402
from tumblecal.diagnosis.findings.model_average import is_thermal  # noqa: E402
from tumblecal.estimation.problem import default_chain  # noqa: E402


ATTITUDES = 20
KINDS = ("noise alone", "with explanations", "with undetected effects", "typical sizes (`unseen`)")


def diagnosed(diagnoser: Diagnoser, own: Instrument, rng: np.random.Generator, known: bool) -> Diagnosis:
    """The diagnosis of one instrument's positions."""
    data = position_set(own.setup, own.clean + blind.SIGMA * rng.normal(size=own.clean.shape), known)
    if own.setup.mounting is not None:
        data = replace(data, mount=tuple("AB"[number] for number in own.setup.mounting))
    chain = default_chain(data).fixed({"dbeta"}) if own.pitch_known else None
    return diagnoser(data, chain=chain, from_rig=False)


def parameters(own: Instrument, diagnosis: Diagnosis) -> tuple[np.ndarray, np.ndarray, float]:
    """Errors of dK, bias and gamma as written, their standard uncertainties of each kind (kinds, 9), and the factor of 95 %."""
    truth = truth_at_the_mean(own, thermal=is_thermal(diagnosis.members))
    used, fit = diagnosis.in_use, diagnosis.extended
    here = [used.names.index(name) for name in SENSOR]
    off = used.values[here] - np.concatenate([truth["dK"], truth["bias"], truth["gamma"]])
    parts = used.parts
    without = (parts["noise"] ** 2 + parts["explanations"] ** 2)[here]
    sizes = [
        fit.sd[[fit.names.index(name) for name in SENSOR]],
        np.sqrt(without),
        used.sd[here],
        [diagnosis.unseen[name].sd_with_unseen for name in SENSOR],
    ]
    return off, np.array(sizes), 1.96 if fit.problem.known else float(stats.t.ppf(0.975, fit.dof))


def corrected(own: Instrument, diagnosis: Diagnosis, rng: np.random.Generator) -> np.ndarray:
    """Errors of corrected readings at new attitudes and temperatures, in standard uncertainties by the file's covariance."""
    calibration = diagnosis.calibration
    force = rng.normal(size=(ATTITUDES, 3))
    force /= np.linalg.norm(force, axis=1, keepdims=True)
    setup = own.setup
    degc = rng.uniform(setup.temperature_degc.min(), setup.temperature_degc.max(), ATTITUDES)
    readings = sensor_readings(own, force, degc)
    off = calibration.corrected(readings, degc, np.full(ATTITUDES, setup.time_s.mean())) - force
    slope = np.zeros((ATTITUDES, 3, 12))
    for axis in range(3):
        slope[:, axis, 3 * axis : 3 * axis + 3] = readings - calibration.bias
    slope[:, :, 9:] = -calibration.matrix
    return off / np.sqrt(np.einsum("rij,jk,rik->ri", slope, calibration.covariance, slope))


def main() -> None:
    """All cases, counted by population and plan."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=10, help="of each population and plan")
    parser.add_argument("--seed", type=int, default=200)
    parser.add_argument("--plans", nargs="+", default=PLANS, choices=PLANS)
    parser.add_argument("--populations", nargs="+", default=POPULATIONS, choices=POPULATIONS)
    args = parser.parse_args()
    diagnoser, within, ratios, spent = Diagnoser(nested=False), defaultdict(list), defaultdict(list), [0.0, 0.0]
    read = defaultdict(list)
    for plan in args.plans:
        for number in range(args.cases):
            for population in args.populations:
                seeds = [args.seed, number, PLANS.index(plan), POPULATIONS.index(population)]
                rng, started = np.random.default_rng(seeds), time.perf_counter()
                own = instrument(rng, population, plan)
                diagnosis = diagnosed(diagnoser, own, rng, bool(number % 2))
                diagnosed_at = time.perf_counter()
                assert diagnosis.in_use is not None
                spent = [spent[0] + time.perf_counter() - started, spent[1] + time.perf_counter() - diagnosed_at]
                off, sizes, factor = parameters(own, diagnosis)
                away = corrected(own, diagnosis, rng) / factor
                for key in (population, f"{population}, {plan}"):
                    within[key].append(np.abs(off) < factor * sizes)
                    ratios[key].append(sizes / sizes[0])
                    read[key].append(np.abs(away) < 1)
    print("| instruments | intervals | " + " | ".join(f"{kind}: coverage, width" for kind in KINDS) + " | readings |")
    print("|---" * (len(KINDS) + 3) + "|")
    for key in sorted(within, key=lambda key: (POPULATIONS.index(key.split(",")[0]), key)):
        share, width = np.mean(within[key], axis=(0, 2)), np.median(np.concatenate(ratios[key], axis=1), axis=1)
        cells = [f"{100 * one:.1f} %, {two:.2f}" for one, two in zip(share, width, strict=True)]
        print(f"| {key} | {9 * len(within[key])} | {' | '.join(cells)} | {100 * np.mean(read[key]):.1f} % |")
    files = len(args.plans) * len(args.populations) * args.cases
    print(
        f"\n{1e3 * spent[0] / files:.0f} ms a file, of which {1e3 * spent[1] / files:.1f} ms for the parameters as written"
    )


if __name__ == "__main__":
    main()

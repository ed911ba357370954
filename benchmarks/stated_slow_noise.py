"""Diagnoses of instruments with slow noise that the rig states: false alarms, and how often a hidden effect is named.

The slow noise is drawn sample by sample in plain numpy. 24 positions (3 pitch settings, 8 spindle angles), one every 75 s.
"""

import argparse
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

import tumblecal
from tumblecal.chain.rig import Rig
from tumblecal.chain.rig_file import rig_of
from tumblecal.diagnosis import Diagnoser
from tumblecal.estimation import where_of
from tumblecal.estimation.visits import with_repeatability
from tumblecal.simulation.coverage import coverage_table
from tumblecal.simulation.experiment import experiment
from tumblecal.simulation.position_means import simulated
from tumblecal.simulation.sums import chunk_sums


ARCMIN = np.radians(1 / 60)
NOISES = {
    "drift 1 mg/h": {"drift": "1 mg/h"},
    "random walk": {"random_walk_g_per_rts": 5e-6},
    "drift, random walk, warm-up": {"drift": "1 mg/h", "random_walk_g_per_rts": 5e-6, "warm_up": "0.5 mg"},
}
HIDDEN = 1e-3  # second-order coefficient of z, g/g^2


def rig_with(noise: dict[str, object]) -> Rig:
    """A head whose pitch settings are set again to 30 arcsec."""
    table = {
        "schema": "tumblecal.rig/1",
        "plan": {"alpha_deg": {"start": 0, "step": 45, "count": 8}, "beta_deg": [0, 45, 90], "interval_s": 75},
        "chain": {"leaves": {"dbeta": {"by": "pitch_visit"}}},
        "noise": {"sd": "0.1 mg"},
        "priors": {"dbeta": "3 arcmin"},
        "head": {"repeatability": {"pitch": "30 arcsec"}, "noise": noise},
    }
    return rig_of(table, Path("rig.toml"))


def slow_noise(rig: Rig, rng: np.random.Generator) -> np.ndarray:
    """Slow noise of the dwells, from samples of one a second, g."""
    assert rig.ability is not None and rig.plan.time_s is not None
    stated, start = rig.ability.slow_noise, np.asarray(rig.plan.time_s)
    seconds = np.arange(int(start[-1]) + 60)
    walk = stated.random_walk_g_per_rts * np.cumsum(rng.standard_normal((len(seconds), 3)), axis=0)
    drift = stated.drift_g_per_h / 3600 * np.outer(seconds, rng.standard_normal(3))
    decay = np.exp(-seconds / stated.warm_up_time_s)
    samples = walk + drift + stated.warm_up_g * np.outer(decay, rng.standard_normal(3))
    return np.stack([samples[int(begin) : int(begin) + 60].mean(axis=0) for begin in start])


def measured(rig: Rig, rng: np.random.Generator, hidden: float) -> tumblecal.PositionSet:
    """Readings of a random instrument."""
    sizes = {"dK": (3e-3, 3), "bias": (3e-3, 3), "gamma": (1e-3, 3), "dtheta": (3e-3, 3)}
    truth = {name: tuple((size * rng.standard_normal(count)).tolist()) for name, (size, count) in sizes.items()}
    pitch = ARCMIN * (3 * rng.standard_normal(3) + 0.5 * rng.standard_normal(3))
    quiet = replace(rig, ability=None, truth=truth | {"dbeta": tuple(pitch.tolist())})
    data = simulated(quiet, 0, 0.0)
    noise = (rig.noise_sd_g or 0.0) * rng.standard_normal(data.readings.shape) + slow_noise(rig, rng)
    return replace(data, readings=data.readings + np.array([0, 0, hidden]) * data.readings**2 + noise)


def diagnoses(runs: int, seed: int) -> None:
    """Print a line for each noise."""
    diagnoser = Diagnoser(nested=False)
    for words, noise in NOISES.items():
        rig = rig_with(noise)
        assert rig.ability is not None
        for hidden, ability in ((0.0, rig.ability), (HIDDEN, rig.ability), (0.0, None)):
            rng, alarms, named, labels = np.random.default_rng(seed), 0, 0, Counter[str]()
            for _ in range(runs):
                data = measured(rig, rng, hidden)
                chain = rig.chain(where_of(data))
                repeated = with_repeatability(rig.priors, rig.ability.repeatability, chain, where_of(data, chain))
                found = diagnoser.begun(data, chain, rig.noise_sd_g, repeated, ability=ability)
                alarms += not found.adequate
                best = found.screened.best
                named += any("second_order.z" in members for members in (best.labels, *best.equivalents))
                labels[" + ".join(found.labels) or "adequate"] += 1
            statement = "stated" if ability else "not stated"
            print(
                f"{words}, {statement}, hidden {1e3 * hidden:g} mg/g^2: {runs} runs, detected {alarms}, named {named}",
                flush=True,
            )
            print(f"  {labels.most_common(3)}", flush=True)


def coverage(trials: int, seed: int) -> None:
    """Print the range of the interval coverage of the parameters for each noise."""
    spread = {"dK": 3e-3, "bias": 3e-3, "gamma": 1e-3, "dtheta": 3e-3, "dbeta": 3 * ARCMIN}
    for words, noise in NOISES.items():
        rig = rig_with(noise)
        assert rig.noise_sd_g is not None
        made = experiment(
            rig.true_chain(rig.where),
            rig.where,
            sd=rig.noise_sd_g,
            spread=spread,
            priors=rig.priors,
            ability=rig.ability,
        )
        covered = coverage_table(made, chunk_sums(made, seed)(0, trials))["covered_95_stated"].to_numpy()
        print(
            f"{words}: coverage of 95 % intervals {covered.min():.4f} to {covered.max():.4f}, {trials} trials",
            flush=True,
        )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", choices=("diagnoses", "coverage"))
    parser.add_argument("--runs", type=int, default=60)
    parser.add_argument("--trials", type=int, default=8192)
    parser.add_argument("--seed", type=int, default=48)
    chosen = parser.parse_args()
    tumblecal.enable_float64()
    if chosen.part == "coverage":
        coverage(chosen.trials, chosen.seed)
    else:
        diagnoses(chosen.runs, chosen.seed)

"""The population `slow`: instruments with slow noise that the rig states.

    python benchmarks/blind slow --runs 60 --seed 48

24 positions (3 pitch settings, 8 spindle angles, one every 75 s) and slow noise that is drawn second by second in plain numpy.
Printed: false alarms, with the noise stated and not, and how often a hidden effect is named.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import tumblecal
from command_line import asked, print_head, print_row
from tumblecal.chain.rig import Rig
from tumblecal.chain.rig_file import rig_of
from tumblecal.diagnosis import Diagnoser
from tumblecal.estimation import where_of
from tumblecal.estimation.visits import with_repeatability
from tumblecal.simulation.position_means import simulated


ARCMIN = np.radians(1 / 60)
NOISES = {
    "drift 1 mg/h": {"drift": "1 mg/h"},
    "random walk": {"random_walk_g_per_rts": 5e-6},
    "drift, random walk, warm-up": {"drift": "1 mg/h", "random_walk_g_per_rts": 5e-6, "warm_up": "0.5 mg"},
}
HIDDEN = 1e-3  # second-order coefficient of z, g/g^2
SPREAD = {"dK": 3e-3, "bias": 3e-3, "gamma": 1e-3, "dtheta": 3e-3}


def rig_with(noise: dict[str, object]) -> Rig:
    """A head whose pitch settings repeat to 30 arcsec."""
    table = {
        "schema": "tumblecal.rig/1",
        "plan": {"alpha_deg": {"start": 0, "step": 45, "count": 8}, "beta_deg": [0, 45, 90], "interval_s": 75},
        "chain": {"leaves": {"dbeta": {"by": "pitch_visit"}}},
        "noise": {"sd": "0.1 mg"},
        "priors": {"dbeta": "3 arcmin"},
        "head": {"repeatability": {"pitch": "30 arcsec"}, "noise": noise},
    }
    return rig_of(table, Path("rig.toml"))


def measured(rig: Rig, rng: np.random.Generator, hidden: float) -> tumblecal.PositionSet:
    """Readings of a random instrument."""
    assert rig.ability is not None and rig.plan.time_s is not None
    truth = {name: tuple((size * rng.standard_normal(3)).tolist()) for name, size in SPREAD.items()}
    pitch = ARCMIN * (3 * rng.standard_normal(3) + 0.5 * rng.standard_normal(3))
    data = simulated(replace(rig, ability=None, truth=truth | {"dbeta": tuple(pitch.tolist())}), 0, 0.0)
    white = (rig.noise_sd_g or 0.0) * rng.standard_normal(data.readings.shape)
    slow, start = rig.ability.slow_noise, np.asarray(rig.plan.time_s)
    seconds = np.arange(int(start[-1]) + 60)
    samples = slow.random_walk_g_per_rts * np.cumsum(rng.standard_normal((len(seconds), 3)), axis=0)
    samples = samples + slow.drift_g_per_h / 3600 * np.outer(seconds, rng.standard_normal(3))
    decay = np.exp(-seconds / slow.warm_up_time_s)
    samples = samples + slow.warm_up_g * np.outer(decay, rng.standard_normal(3))
    means = np.stack([samples[int(begin) : int(begin) + 60].mean(axis=0) for begin in start])
    return replace(data, readings=data.readings + np.array([0, 0, hidden]) * data.readings**2 + white + means)


def diagnoses(runs: int, seed: int) -> None:
    """A row for each noise, whether it is stated, and whether an effect is hidden."""
    diagnoser = Diagnoser(nested=False)
    print_head("slow noise", "stated", "hidden / (mg/g^2)", "runs", "detected", "named")
    for words, noise in NOISES.items():
        rig = rig_with(noise)
        assert rig.ability is not None
        for hidden, ability in ((0.0, rig.ability), (HIDDEN, rig.ability), (0.0, None)):
            rng, alarms, named = np.random.default_rng(seed), 0, 0
            for _ in range(runs):
                data = measured(rig, rng, hidden)
                chain = rig.chain(where_of(data))
                priors = with_repeatability(rig.priors, rig.ability.repeatability, chain, where_of(data, chain))
                found = diagnoser.begun(data, chain, rig.noise_sd_g, priors, ability=ability)
                best = found.screened.best
                alarms += not found.adequate
                named += any("second_order.z" in members for members in (best.labels, *best.equivalents))
            print_row(words, "yes" if ability else "no", f"{1e3 * hidden:g}", runs, alarms, named)


def main(words: Sequence[str]) -> None:
    """Draw and diagnose."""
    given = asked(__doc__, words, runs=60, seed=48)
    tumblecal.enable_float64()
    diagnoses(given.runs, given.seed)

"""Other ways to measure a plan: while a chamber changes its temperature, twice, or in several mountings."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

import blind_instrument as blind
from blind.acting import direction


PLANS = {"3x4": (3, 4), "3x8": (3, 8), "4x12": (4, 12), "5x16": (5, 16)}
# Twelve positions cannot separate three causes, nor a bump from an outlier position.
LARGER = ("3x8", "4x12", "5x16")


def swept(setup: blind.Setup, stops: Sequence[float], rng: np.random.Generator) -> blind.Setup:
    """The plan while a chamber goes evenly from one temperature to the next (degC)."""
    count = len(setup.alpha)
    chamber = np.interp(np.linspace(0, len(stops) - 1, count), np.arange(len(stops)), stops)
    return replace(setup, temperature_degc=chamber + rng.normal(0, 0.3, count))


def twice(setup: blind.Setup, repeat: str) -> blind.Setup:
    """The plan twice, in `one run` or in `two runs` with different pitch errors."""
    levels = len(setup.nominal["dbeta"])
    step = setup.time_s[-1] - setup.time_s[0] + 60.0
    both = {name: np.tile(getattr(setup, name), 2) for name in ("alpha", "beta", "temperature_degc", "approach")}
    runs = repeat == "two runs"
    return replace(
        setup,
        **both,
        time_s=np.concatenate([setup.time_s, setup.time_s + step]),
        pitch=np.concatenate([setup.pitch, setup.pitch + levels * runs]),
        nominal=setup.nominal | {"dbeta": np.tile(setup.nominal["dbeta"], 1 + runs)},
        names=[f"{name}{mark}" for mark in ("", "r") for name in setup.names],
    )


def remounted(
    setup: blind.Setup, turns_deg: Sequence[tuple[float, float, float]], rng: np.random.Generator
) -> blind.Setup:
    """The plan in several mountings, a quarter of an hour between them, each with a mount of at most 1 degree and its own
    pitch errors."""
    count, mountings, levels = len(setup.alpha), len(turns_deg), len(setup.nominal["dbeta"])
    total = count * mountings
    mounts = [np.radians(1.0) * rng.uniform() ** (1 / 3) * direction(rng) for _ in turns_deg]
    both = {name: np.tile(getattr(setup, name), mountings) for name in ("alpha", "beta", "pitch")}
    return replace(
        setup,
        **both,
        time_s=np.cumsum(rng.uniform(50, 70, total)) + np.repeat(900.0 * np.arange(mountings), count),
        temperature_degc=25.0 + np.cumsum(rng.normal(0, 0.15, total)) + rng.normal(0, 0.1, total),
        approach=rng.choice([-1.0, 1.0], total),
        nominal=setup.nominal
        | {"dtheta": np.concatenate(mounts), "dbeta": rng.uniform(-3e-3, 3e-3, levels * mountings)},
        names=[f"{'ABC'[mounting]}{name}" for mounting in range(mountings) for name in setup.names],
        mounting=np.repeat(np.arange(mountings), count),
        turns=Rotation.from_euler("XYZ", -np.radians(turns_deg)).as_matrix(),
    )

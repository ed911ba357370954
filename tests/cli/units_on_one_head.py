"""Files of units measured on one head by the blind instrument (plain numpy)."""

from pathlib import Path

import numpy as np

import blind_instrument as blind
from tumblecal.data import PositionSet, write_positions


def setups_on_one_head(seed: int, count: int, *, plan=(3, 8), pitch=(1.2e-3, -2.1e-3, 0.8e-3)):
    """Units that differ in everything; with `pitch` the errors (rad) of the head's settings are those of all."""
    rng = np.random.default_rng(seed)
    setups = [blind.random_setup(rng, *plan) for _ in range(count)]
    for setup in setups if pitch else ():
        setup.nominal["dbeta"] = np.array(pitch)
    return setups


def write_units(folder: Path, setups, effects, seed: int, *, known: bool = True, columns: bool = True) -> list[Path]:
    """One file for each unit; `effects` of each, base units."""
    rng, files = np.random.default_rng([seed, 1]), []
    folder.mkdir(exist_ok=True)
    for number, (setup, hidden) in enumerate(zip(setups, effects, strict=True)):
        clean = blind.readings(setup, setup.nominal, hidden)
        extra = {"time_s": setup.time_s, "temperature_degc": setup.temperature_degc, "approach": setup.approach}
        data = PositionSet(
            tuple(setup.names),
            np.degrees(setup.alpha),
            np.degrees(setup.beta),
            clean + blind.SIGMA * rng.normal(size=clean.shape),
            sd=np.full(clean.shape, blind.SIGMA) if known else None,
            **(extra if columns else {}),
        )
        files.append(folder / f"unit{number}.csv")
        write_positions(files[-1], data)
    return files

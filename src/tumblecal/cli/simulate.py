"""`tumblecal simulate`: position means of a rig."""

from collections.abc import Sequence
from pathlib import Path


def simulate(
    config: Path, /, *, out: Path, seed: int = 0, noise_sd: str | None = None, effects: Sequence[Path] = ()
) -> None:
    """Simulate the position means of a rig and write them as a position file.

    Parameters
    ----------
    config
        The rig, a TOML file such as configs/paper24.toml.
    out
        The file to write: .csv or .parquet.
    seed
        Seed of the noise; the same seed gives the same data.
    noise_sd
        Standard deviation of a reading with its unit, e.g. 0.1mg; goes before the rig's own.
    effects
        Python files with effects of your own that the rig may name.
    """
    from tumblecal.cli.start import start

    start()
    from tumblecal.chain.units import quantity
    from tumblecal.cli.model import read_rig_with_effects
    from tumblecal.data import write_positions
    from tumblecal.data.atomic import writable_folder
    from tumblecal.simulation.position_means import simulated

    rig = read_rig_with_effects(config, *effects)
    data = simulated(rig, seed, None if noise_sd is None else quantity(noise_sd, "g"))
    writable_folder(out.parent)
    write_positions(out, data)
    print(f"{out}: {len(data)} positions of {rig.title or config}, seed {seed}")

"""`tumblecal simulate`: simulated position means of a rig."""

from dataclasses import replace
from pathlib import Path

from tumblecal.cli.options import EffectFiles, Quiet, Seed
from tumblecal.cli.result_files import table_file
from tumblecal.ground.errors import one_line


def simulate(
    config: Path,
    /,
    *,
    out: Path,
    seed: Seed = 0,
    noise_sd: str | None = None,
    serial_number: str | None = None,
    effects: EffectFiles = (),
    then: Path | None = None,
    quiet: Quiet = False,
) -> None:
    """Simulate the position means of a rig and write them as a position file.

    Parameters
    ----------
    config
        Rig file (TOML), such as configs/paper24.toml.
    out
        Position file to write (.csv or .parquet). Example: --out positions.csv.
    seed
        Seed of the noise; the same seed gives the same data. Example: --seed 7.
    noise_sd
        Standard deviation of a reading, with its unit. Default: that of the rig. Example: --noise-sd 0.1mg.
    serial_number
        Serial number of the simulated unit, for certificates and a history. Default: none. Example: --serial-number A-17.
    then
        Plan of a second measurement with the same instrument, under the conditions of that plan. Only its positions are
        written, as measured after the plan of the rig. Example: --then diagnosis/next_positions.toml.
    """
    from tumblecal.cli.start import start

    start()
    from tumblecal.capture.capture_plan import read_plan
    from tumblecal.data import write_positions
    from tumblecal.effects import catalogue
    from tumblecal.effects.rig_with_effects import read_rig_with_effects
    from tumblecal.ground.option_texts import sd_of_reading
    from tumblecal.simulation.next_measurement import simulated_after
    from tumblecal.simulation.position_means import simulated

    table_file(out, [config, *effects, then])
    rig = read_rig_with_effects(config, catalogue(*effects))
    stated = sd_of_reading("--noise-sd", noise_sd, zero=True)
    data = simulated(rig, seed, stated) if then is None else simulated_after(rig, read_plan(then), then, seed, stated)
    if serial_number:
        data = replace(data, comments=data.comments | {"serial_number": one_line(serial_number)})
    write_positions(out, data)
    after = f" after those of its plan, from {then}" if then else ""
    print(f"{out}: {len(data)} positions of {rig.title or config}{after}, seed {seed}")

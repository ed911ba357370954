"""`tumblecal import`: what is in a recording made elsewhere, and its samples as a table."""

import json
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from tumblecal.capture.recordings.options import RecordingOptions
from tumblecal.cli.output import Output, warn
from tumblecal.ground.counted import counted
from tumblecal.ground.errors import InputError


def import_samples(
    source: Path,
    /,
    *,
    out: Path | None = None,
    options: Annotated[RecordingOptions, Parameter(name="*")] = RecordingOptions(),
    output: Output = Output(),
) -> None:
    """Say what is in a recording (rows, rate, columns and by what evidence, gaps, repeats, damage), and write its samples as a
    table.

    Text of any layout, Parquet, .mat, HDF5, ROS bags, MCAP, PX4 ULog, DataFlash, Xsens .mtb, spreadsheets and byte logs of
    the serial protocols are read. Units stand in the columns' names: ax_ms2, gx_rads, temperature_degc; counts stay counts.
    Then: tumblecal reduce TABLE --static (or --plan).

    Parameters
    ----------
    source
        The recording.
    out
        The table, .parquet or .csv; SOURCE.samples.parquet in this folder where left out.
    """
    from tumblecal.capture.recordings.sample_file import write_samples
    from tumblecal.data.overwriting import inputs_kept
    from tumblecal.report.import_report import import_document, import_lines
    from tumblecal.report.recording_words import left_out_words

    output.begin()

    path = out or Path(f"{source.stem}.samples.parquet")
    if path.suffix not in (".csv", ".parquet"):
        raise InputError(f"{path}: must end in .csv or .parquet")
    inputs_kept([source], out=path)
    contents = write_samples(source, path, options)
    warn(source, contents.damage.lines)
    output.say("\n".join([*import_lines(contents), f"{path}: {counted(contents.rows, 'sample')}"]))
    if output.json:
        print(json.dumps(import_document(source, path, contents)))
    output.warn(str(source), left_out_words(contents))

"""`tumblecal import`: contents of a recording, and its samples as a table."""

from pathlib import Path

from tumblecal.cli.command import Command
from tumblecal.cli.recording_options import Recording
from tumblecal.cli.result_files import table_file
from tumblecal.cli.terminal import warn
from tumblecal.ground.numbers_shown import counted
from tumblecal.recordings.options import RecordingOptions


def import_samples(
    source: Path,
    /,
    *,
    out: Path | None = None,
    options: Recording = RecordingOptions(),
    command: Command = Command(),
) -> None:
    """Describe a recording (rows, rate, columns with their evidence, gaps, repeats, damage), and write its samples as a table.

    The description, FILE.recording.toml, states the columns, units, clock, rate and gravity that were found or given, each with
    its source. reduce, thermal, check and apply accept it in place of the recording and its options.

    Text of any layout, Parquet, .mat, HDF5, ROS bags, MCAP, PX4 ULog, DataFlash, Xsens .mtb, spreadsheets and byte logs of
    the serial protocols are read. Column names include units: ax_ms2, gx_rads, temperature_degc; counts are not converted.
    Next: tumblecal reduce TABLE --static (or --plan).

    Parameters
    ----------
    source
        Recording.
    out
        Table of samples (.parquet or .csv). Default: SOURCE.samples.parquet in the current folder. Example: --out log.csv.
    """
    from tumblecal.recordings.description import SUFFIX, write_description
    from tumblecal.recordings.reading import read_recording
    from tumblecal.recordings.record import import_record
    from tumblecal.show.recordings import import_lines, left_out_lines

    command.begin(computing=False)
    path = table_file(out or Path(f"{source.stem}.samples.parquet"), [source])
    contents = read_recording(source, path, options)
    warn(source, contents.damage.lines)
    description = path.with_name(f"{contents.path.name}{SUFFIX}")
    write_description(contents, description)
    command.say(
        *import_lines(contents),
        f"{path}: {counted(contents.rows, 'sample')}",
        f"{description}: its description, for reduce, thermal, check and apply",
    )
    if command.json:
        print(import_record(source, path, contents).model_dump_json(by_alias=True))
    command.warn(str(source), left_out_lines(contents))

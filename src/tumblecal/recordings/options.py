"""Options of recordings: what a file does not state, positions, and the criterion for intervals at rest."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from pydantic import ConfigDict


@dataclass(frozen=True)
class RecordingOptions:
    """Columns, units, rate and gravity of a recording that does not state them, or states them wrongly.

    Parameters
    ----------
    columns
        Column of each quantity, by its name or its number from 1. Default: recognised by names. Example:
        --columns ax=AccX,ay=AccY,az=AccZ,gx=GyrX,time=t,temperature=T,position=part.
    rows
        Rows of one sensor, by the value of a column. Default: all rows. Example: --rows sensor=1.
    unit
        Unit of the accelerations: g, mg, m/s2, or counts for one g. Default: as the file states it, otherwise guessed from
        their size, and reported. Example: --unit 16384/g.
    gyro_unit
        Unit of the angular rates: dps, rad/s, or counts for one dps. Default: as the file names it. Example: --gyro-unit
        131/dps.
    time_unit
        Unit of the times: s, ms, us, ns, 100us, min or h. Default: as the file states it, or as its sample rate gives it.
        Example: --time-unit us.
    scale
        Factor of the readings after subtraction of --offset, one for all axes or one for each. Default: 1. Example:
        --scale ax=0.061,ay=0.060,az=0.061.
    offset
        Offset in the unit of the file, subtracted from the readings, one for all axes or one for each. Default: 0. Example:
        --offset 32768.
    signed
        Bits of the numbers, if negative ones are written as unsigned ones. Default: none. Example: --signed 16.
    decimal
        Decimal mark of a text, point or comma. Default: a comma if the cells are separated by semicolons or tabs and have
        commas, otherwise a point. Example: --decimal comma.
    rate
        Sample rate in Hz, for a recording without times. Default: as the file states it. Example: --rate 100.
    topic
        Name of the table, if the recording has several: a topic, a sheet or a variable. Default: the recognised one.
        Example: --topic /imu/data.
    protocol
        Protocol of a byte log. Default: recognised by its frames. Example: --protocol stim300.
    gravity
        Local gravity at the place of measurement (for apply: of use): m/s^2, such as 9.8123, or the site with its latitude in
        degrees and height in metres. It replaces a value in the recording. reduce divides readings in m/s^2 by it; import
        writes it with the samples. Readings in g, mg or counts do not change. Default: the value in the recording, otherwise
        9.80665. Example: --gravity lat=48.14,height=520.
    range_g
        Full scale in g of the device of a byte log, if the stream does not state it. Default: none. Example: --range-g 10.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    columns: str = ""
    rows: str = ""
    unit: str = ""
    gyro_unit: str = ""
    time_unit: str = ""
    scale: str = ""
    offset: str = ""
    signed: int | None = None
    decimal: str = ""
    rate: float | None = None
    topic: str = ""
    protocol: str | None = None
    range_g: float | None = None
    gravity: str = ""


@dataclass(frozen=True)
class Criterion:
    """Criterion for an interval at rest.

    Parameters
    ----------
    false_alarm
        Probability that one second at rest is classified as moving, for each axis. Example: --false-alarm 1e-4.
    least_s
        Shortest accepted interval, s. Example: --least-s 10.
    guard_s
        Time excluded at both ends of an interval, s. Example: --guard-s 2.
    """

    false_alarm: float = 1e-6
    least_s: float = 1.5
    guard_s: float = 0.2


@dataclass(frozen=True)
class KnownContext:
    """Positions, run and mounting of a recording.

    Parameters
    ----------
    static
        Search for intervals at rest with unknown attitudes (a hand-held set); intervals.svg shows them. Example: --static.
    plan
        Plan (TOML, as for tumblecal capture) whose positions are the intervals at rest, in its order or in any order.
        Default: none. Example: --plan plan.toml.
    table
        Table (CSV) of the files of one recording, with the columns file, position (or name), alpha_deg, beta_deg; run and
        mount are optional. With --plan, the columns file and position are enough. Default: none. Example: --table files.csv.
    by
        Column of the recording with the position of each sample. Default: none. Example: --by part.
    means
        One row of the table for each position, already a mean. Example: --means.
    run
        Label of the run for the column run of positions.csv. Default: none. Example: --run 2.
    mount
        Label of the mounting for the column mount of positions.csv. Default: none. Example: --mount B.
    """

    static: bool = False
    plan: Path | None = None
    table: Path | None = None
    by: str = ""
    means: bool = False
    run: str = ""
    mount: str = ""

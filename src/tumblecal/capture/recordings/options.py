"""Options of recordings: columns and units, positions, and the criterion for intervals at rest."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class RecordingOptions:
    """Columns, units, rate and gravity of a recording that does not state them, or states them wrongly.

    Parameters
    ----------
    columns
        Column of each quantity, by its name or its number from 1, for example
        ax=AccX,ay=AccY,az=AccZ,gx=GyrX,time=t,temperature=T,position=part.
    unit
        Unit of the accelerations: g, mg, m/s2, or counts such as 16384/g. By default it is guessed from their
        size, and the guess is reported.
    gyro_unit
        Unit of the angular rates: dps, rad/s, or counts such as 131/dps.
    time_unit
        Unit of the times: s, ms, us or ns. By default it is guessed from the sample rate.
    scale
        Factor of the readings after the offset is subtracted: 0.061, or one for each axis: ax=0.061,ay=0.060.
    offset
        Offset, subtracted from the readings in the unit of the file: 32768, or one for each axis: ax=32768,ay=32760.
    rate
        Sample rate in Hz, for a recording without times.
    topic
        Table to read if there are several: a topic, a sheet or a variable.
    protocol
        Protocol of a byte log. By default it is guessed.
    gravity
        Local gravity at the place of measurement: m/s^2, such as 9.8123, or the site, such as lat=48.14,height=520 (degrees,
        metres). It replaces the value that the recording states. reduce divides readings in m/s^2 by it (by 9.80665 if none is
        stated); import writes it with the samples. Readings in g, mg or counts do not change. For apply: gravity at the place
        where the device is used.
    range_g
        Full scale in g of the device of a byte log, if the stream does not state it.
    """

    columns: str = ""
    unit: str = ""
    gyro_unit: str = ""
    time_unit: str = ""
    scale: str = ""
    offset: str = ""
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
        Probability that one second at rest is classified as moving, for each axis.
    least_s
        Shortest accepted interval, s.
    guard_s
        Time excluded at both ends of an interval, s.
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
        Find the intervals at rest, with unknown attitudes (a hand-held set). intervals.svg shows them over the signal.
    plan
        Find the intervals at rest of this plan (TOML, as for tumblecal capture), in the order of the plan or in any order.
    table
        Table (CSV) of the files of one recording, with the columns file, position (or name), alpha_deg, beta_deg; run and
        mount are optional. With --plan, the columns file and position are enough.
    by
        Column of the recording with the position of each sample.
    means
        Each row of the table is the mean of a position.
    run
        Label of the run for the column run of positions.csv.
    mount
        Label of the mounting for the column mount of positions.csv.
    """

    static: bool = False
    plan: Path | None = None
    table: Path | None = None
    by: str = ""
    means: bool = False
    run: str = ""
    mount: str = ""

"""What a user says of a recording: its columns and units, what is known of its positions, when an interval is still."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class RecordingOptions:
    """What a user says of a recording that it does not tell, or tells wrongly.

    Parameters
    ----------
    columns
        Which column is what, e.g. ax=AccX,ay=AccY,az=AccZ,gx=...,time=t,temperature=T,position=part;
        a number counts columns from 1.
    unit
        Unit of the accelerations: g, mg, m/s2, or counts such as 16384/g; guessed from their size, and said, where left out.
    gyro_unit
        Unit of the angular rates: dps, rad/s, or counts such as 131/dps.
    time_unit
        Unit of the times: s, ms, us or ns; guessed from the rate where left out.
    scale
        What readings are multiplied by, less their offset: 0.061, or for each axis ax=0.061,ay=...
    offset
        What is subtracted from readings before, in their own unit: 32768, or ax=32768,...
    rate
        Sample rate in Hz, where the recording has no times.
    topic
        Which of several tables: a topic, a sheet, a variable.
    protocol
        For byte logs: the protocol; guessed where left out.
    gravity
        Gravity where it was measured: m/s^2, such as 9.8123, or the site, such as lat=48.14,height=520 (degrees, metres). It
        counts where readings are in m/s^2: reduce divides them by it, import writes it beside them. Of readings in g, mg or
        counts it changes no number; it is kept with them. Goes before the recording's own; where nobody states one, m/s^2 are
        divided by 9.80665. Of apply it is gravity where the device is used.
    range_g
        For byte logs: full scale in g, where the stream does not tell it.
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
    """When an interval counts as still.

    Parameters
    ----------
    false_alarm
        Probability that a still second is taken for a moving one, on one axis.
    least_s
        Shortest interval, s.
    guard_s
        Left out at both ends of an interval, s.
    """

    false_alarm: float = 1e-6
    least_s: float = 1.5
    guard_s: float = 0.2


@dataclass(frozen=True)
class KnownContext:
    """What is known of a recording besides its samples.

    Parameters
    ----------
    static
        Find the still intervals; their attitudes are unknown (a hand-held set). intervals.svg shows them over the signal.
    plan
        Find the still intervals of this plan (TOML, as of tumblecal capture), in its order or in any.
    table
        Table (CSV) of the files of one recording: column file, and position (or name), alpha_deg and beta_deg; optional run,
        mount. With --plan, position alone is enough.
    by
        Column of the recording that names the position of each sample.
    means
        Each row is the mean of a position already.
    run
        Label of the run, a column of positions.csv.
    mount
        Label of the mounting.
    """

    static: bool = False
    plan: Path | None = None
    table: Path | None = None
    by: str = ""
    means: bool = False
    run: str = ""
    mount: str = ""

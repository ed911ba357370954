"""Recordings over temperature from files: attitudes, several files, position files, gaps, restarts, and faults."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from tumblecal.data.files import write_positions
from tumblecal.data.positions import PositionSet
from tumblecal.ground.errors import InputError
from tumblecal.recordings.options import KnownContext, RecordingOptions
from tumblecal.recordings.thermal.read_thermal import thermal_reading
from tumblecal.recordings.thermal.thermal_table import ThermalTable


RATE = 20.0
UP, RIGHT = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])


def read_thermal(*given, **options) -> ThermalTable:
    return thermal_reading(*given, **options).table


def bias(degc: np.ndarray) -> np.ndarray:
    """Of the three axes, g."""
    x = (degc - 20) / 40
    return np.stack([4e-3 * x, -3e-3 * x**2, 5e-3 * x**3], axis=1)


def ramp(low: float, high: float, minutes: float) -> np.ndarray:
    return np.linspace(low, high, int(60 * RATE * minutes))


def recording(
    degc: np.ndarray, gravity: np.ndarray, seed: int = 1, begin_s: float = 0.0, sd: float = 5e-4
) -> pl.DataFrame:
    """Samples at temperatures (rows) under gravity (rows, 3) or (3)."""
    rng = np.random.default_rng(seed)
    force = gravity + bias(degc) + sd * rng.standard_normal((len(degc), 3))
    time = begin_s + np.arange(len(degc)) / RATE
    read = np.round((degc + 0.02 * rng.standard_normal(len(degc))) * 16) / 16
    columns = {"time_s": time} | {f"a{axis}_g": force[:, k] for k, axis in enumerate("xyz")}
    return pl.DataFrame(columns | {"temperature_degc": read})


def written(folder: Path, frame: pl.DataFrame, name: str = "ramp.csv") -> Path:
    path = folder / name
    frame.write_csv(path, float_precision=6)
    return path


def scores(table, gravity: np.ndarray) -> np.ndarray:
    """Errors of the means in standard deviations; the temperature of a bin is in error by less than 0.02 degC."""
    error = table.readings - gravity - bias(table.temperature_degc)
    return error / np.hypot(table.sd, 2e-6)


def test_one_attitude_up_and_down(tmp_path: Path):
    degc = np.concatenate([ramp(-10, 50, 6), ramp(50, -10, 6)])
    reading = thermal_reading([written(tmp_path, recording(degc, UP))])
    table = reading.table
    assert table.attitudes == ("a1",)
    assert set(table.branch) == {"ramp:1 up", "ramp:2 down"}
    assert 76 <= len(table) <= 84
    assert np.sqrt(np.mean(scores(table, UP) ** 2)) < 1.25
    np.testing.assert_allclose(np.abs(table.rate_degc_per_s[5:-5]).mean(), 60 / 360, rtol=0.05)
    assert table.frame["n"].sum() > 0.98 * len(degc)
    assert any("bins of 1.5 degC" in line for line in reading.lines)


def turned(first: np.ndarray, second: np.ndarray, rows: int) -> np.ndarray:
    """A turn from one direction of gravity to the other."""
    share = np.linspace(0, np.pi / 2, rows)[:, None]
    return np.cos(share) * first + np.sin(share) * second


def test_attitudes_in_one_file_by_the_direction_of_gravity(tmp_path: Path):
    # Up, right, up again, while the temperature rises.
    stay, turn = int(100 * RATE), int(2 * RATE)
    gravity = np.concatenate(
        [
            np.tile(UP, (stay, 1)),
            turned(UP, RIGHT, turn),
            np.tile(RIGHT, (stay, 1)),
            turned(RIGHT, UP, turn),
            np.tile(UP, (stay, 1)),
        ]
    )
    degc = np.linspace(0, 40, len(gravity))
    table = read_thermal([written(tmp_path, recording(degc, gravity))])
    assert table.attitudes == ("a1", "a2")
    first = np.array([one == "a1" for one in table.attitude])
    assert np.sqrt(np.mean(scores(table.rows(first), UP) ** 2)) < 1.3
    assert np.sqrt(np.mean(scores(table.rows(~first), RIGHT) ** 2)) < 1.3
    assert (np.diff(table.time_s) > 0).all()


@pytest.mark.parametrize("by", ["columns", "a plan", "a table of files"])
def test_attitudes_and_angles_are_stated_by(tmp_path: Path, by: str):
    stay = int(30 * RATE)
    gravity = np.concatenate([np.tile(UP, (stay, 1)), turned(UP, RIGHT, 40), np.tile(RIGHT, (stay, 1))])
    if by == "a plan":
        gravity = np.concatenate([gravity, turned(RIGHT, UP, 40), gravity])
    frame, context = recording(np.linspace(0, 40, len(gravity)), gravity), KnownContext()
    files = [tmp_path / "one.csv", tmp_path / "two.csv"]
    if by == "a table of files":
        (tmp_path / "files.csv").write_text("file,position,alpha_deg,beta_deg\none.csv,up,0,0\ntwo.csv,right,90,0\n")
        context = KnownContext(table=tmp_path / "files.csv")
        written(tmp_path, frame[:stay], "one.csv")
        written(tmp_path, frame[-stay:], "two.csv")
    elif by == "a plan":
        (tmp_path / "plan.toml").write_text("[positions]\nalpha_deg = [0, 90]\nbeta_deg = [0]\n")
        files, context = [written(tmp_path, frame)], KnownContext(plan=tmp_path / "plan.toml")
    else:
        right = np.arange(len(gravity)) >= stay + 20
        frame = frame.with_columns(position=pl.Series(np.where(right, "right", "up")), alpha_deg=90.0 * right)
        files = [written(tmp_path, frame.with_columns(beta_deg=0.0))]
    table = read_thermal(files, context)
    assert len(table.attitudes) == 2 and (by == "a plan" or table.attitudes == ("up", "right"))
    np.testing.assert_array_equal(table.alpha_deg, np.where(np.abs(table.readings[:, 2]) > 0.5, 0.0, 90.0))


def test_restart_of_the_clock_gives_two_clocks_and_a_gap_one(tmp_path: Path):
    first, second = recording(ramp(0, 20, 2), UP, begin_s=100.0), recording(ramp(20, 40, 2), UP, seed=2, begin_s=20.0)
    table = read_thermal([written(tmp_path, pl.concat([first, second]))])
    assert set(table.clock) == {"ramp", "ramp (clock 2)"}
    assert set(table.branch) == {"ramp:1 up", "ramp (clock 2):1 up"}
    gap = pl.concat([first, second.with_columns(pl.col("time_s") + 400)])
    table = read_thermal([written(tmp_path, gap)])
    assert set(table.clock) == {"ramp"}
    assert set(table.branch) == {"ramp:1 up"}


@pytest.mark.parametrize("jump_degc", [0.0, 8.0])
def test_a_step_of_the_readings_is_named_and_divides_the_recording(tmp_path: Path, jump_degc: float):
    """A jump of 20 mg on y in the middle of a ramp; on both sides the bias follows the temperature."""
    degc = ramp(0, 20, 3)
    after = np.arange(len(degc)) >= len(degc) // 2
    step = np.array([0.0, 20e-3, 0.0])
    path = written(tmp_path, recording(degc + jump_degc * after, UP + np.outer(after, step)))
    reading = thermal_reading([path])
    ((_, (line,)),) = reading.warnings
    assert "step at 90.00 s" in line and "the unit was moved, or two recordings are joined" in line
    x, y, z = (float(text) for text in line.partition("jump by ")[2].partition(" mg")[0].split(","))
    change = 1e3 * np.diff(bias(np.array([10.0, 10.0 + jump_degc])), axis=0)[0] + [0, 20, 0]
    # 64 samples of 0.5 mg on both sides.
    np.testing.assert_allclose([x, y, z], change, atol=4 * 0.5 * np.sqrt(2 / 64))
    table = reading.table
    assert table.attitudes == ("a1", "a1 after 90 s") and set(table.clock) == {"ramp", "ramp (clock 2)"}
    second = np.array([label != "a1" for label in table.attitude])
    assert np.sqrt(np.mean(scores(table, UP + np.outer(second, step)) ** 2)) < 1.3


def test_a_knock_is_not_averaged(tmp_path: Path):
    degc = ramp(0, 40, 4)
    frame = recording(degc, UP)
    knock = np.zeros(len(degc))
    knock[2400:2403] = 0.8
    table = read_thermal([written(tmp_path, frame.with_columns(pl.col("ax_g") + knock))])
    assert np.abs(scores(table, UP)).max() < 5


def positions(degc: list[float]) -> PositionSet:
    """Six positions at each temperature, a minute apart, and two hours between soaks."""
    alpha, beta = np.array([0, 90, 180, 270, 0, 0.0]), np.array([0, 0, 0, 0, 90, -90.0])
    a, b = np.radians(alpha), np.radians(beta)
    gravity = np.stack([-np.sin(b), np.cos(b) * np.sin(a), np.cos(b) * np.cos(a)], axis=1)
    warmth = np.repeat(degc, 6) + np.tile(0.02 * np.arange(6), len(degc))
    count = 6 * len(degc)
    return PositionSet(
        names=tuple(f"p{k}" for k in range(count)),
        alpha_deg=np.tile(alpha, len(degc)),
        beta_deg=np.tile(beta, len(degc)),
        readings=np.tile(gravity, (len(degc), 1)) + bias(warmth),
        sd=np.full((count, 3), 1e-5),
        time_s=np.concatenate([7200.0 * k + 60 * np.arange(6) for k in range(len(degc))]),
        temperature_degc=warmth,
        n=np.full(count, 500.0),
        source="positions.csv",
    )


def test_position_file_is_a_table_of_soaks(tmp_path: Path):
    path = tmp_path / "positions.csv"
    write_positions(path, positions([0, 20, 40, 20, 0]))
    table = read_thermal([path])
    assert len(table) == 30
    assert table.soak.all()
    assert len(table.attitudes) == 6
    assert table.reached_by.tolist() == [0] * 6 + [1] * 12 + [-1] * 12
    assert table.branch[:18] == ("positions:1 up",) * 18
    assert table.branch[18:] == ("positions:2 down",) * 12
    np.testing.assert_array_equal(table.sd, 1e-5)


_RAMP = recording(ramp(0, 40, 1), UP)
_NONE = "no temperature in degC among the columns .*not in kelvin or Fahrenheit, .*--columns temperature=NAME"


@pytest.mark.parametrize(
    ("frame", "options", "fault"),
    [
        (_RAMP.drop("temperature_degc"), {}, _NONE),
        (_RAMP.with_columns(temperature_degc=np.nan), {}, _NONE),
        (_RAMP.rename({"temperature_degc": "TempF"}), {}, _NONE),
        (_RAMP.rename({"temperature_degc": "TempF"}), {"columns": "temperature=TempF"}, _NONE),
        (_RAMP.drop("time_s"), {}, r"the sample rate is not known; give --rate 100 \(Hz\)"),
        (recording(np.full(2400, 25.0), UP), {}, "show no change of the temperature: the thermometer is stuck or"),
        (_RAMP.with_columns(pl.col("temperature_degc") + 273.15), {}, "are in kelvin; write degC"),
        (_RAMP.with_columns(pl.col("temperature_degc") * 340), {}, "not a possible temperature of a triad"),
        (recording(ramp(0, 40, 1), UP, sd=0.3), {}, "no interval at rest"),
        (_RAMP.head(20), {}, "too few to find intervals"),
    ],
)
def test_bad_recordings_have_one_clear_line(tmp_path: Path, frame: pl.DataFrame, options: dict, fault: str):
    with pytest.raises(InputError, match=fault) as raised:
        read_thermal([written(tmp_path, frame)], options=RecordingOptions(**options))
    assert len(raised.value.faults) == 1
    assert raised.value.faults[0].startswith(str(tmp_path))


def slow(gravity: np.ndarray, sd: float = 3e-3) -> pl.DataFrame:
    """A log at 0.25 Hz with the temperature up and down."""
    degc = np.concatenate([np.linspace(20, 60, len(gravity) // 2), np.linspace(60, 20, len(gravity) // 2)])
    return recording(degc, gravity, sd=sd).with_columns(pl.col("time_s") * 4 * RATE)


def test_a_slow_log_of_several_attitudes_needs_the_statement_that_it_was_still(tmp_path: Path):
    path = written(tmp_path, slow(np.concatenate([np.tile(UP, (200, 1)), np.tile(RIGHT, (200, 1))])))
    with pytest.raises(InputError, match="2 attitudes") as raised:
        read_thermal([path])
    advice = raised.value.faults[0].partition("add --means --noise-sd ")[2]
    sd_mg = float(advice.partition("mg")[0])
    np.testing.assert_allclose(sd_mg, 3.0, rtol=0.1)
    table = read_thermal([path], KnownContext(means=True), noise_sd=1e-3 * sd_mg)
    assert len(table.attitudes) == 2 and len(table) == 400


STUCK = [(0.1, 16, False, False), (0.1, 16, True, True), (0.0, 1, True, False)]


@pytest.mark.parametrize(("noise", "step", "stays", "stuck"), STUCK)
def test_a_stuck_thermometer_is_reported_only_if_its_noise_stops(tmp_path: Path, noise, step, stays, stuck):
    """Not in a soak of a coarse thermometer without noise. Readings at rest without a temperature are counted."""
    degc = ramp(0, 40, 6)
    degc[6000:] = degc[6000] if stays else degc[6000:]
    read = np.round((degc + noise * np.random.default_rng(7).standard_normal(len(degc))) * step) / step
    read[6000:] = read[6000] if stays else read[6000:]
    read[2000:4000] = np.nan
    reading = thermal_reading([written(tmp_path, recording(degc, UP).with_columns(temperature_degc=read))])
    lines = [*reading.lines, *(line for _, lines in reading.warnings for line in lines)]
    assert any("100 s at rest have no temperature and are not used" in line for line in lines)
    found = [line for line in lines if "the thermometer shows exactly" in line]
    assert len(found) == stuck and all("from 300 s to 360 s" in line for line in found), found
    assert reading.table.frame["n"].sum() <= len(degc) - 2000

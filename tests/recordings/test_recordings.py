"""One session in a dozen formats gives one set of positions; what is missing, torn or odd is a line each."""

from datetime import datetime

import numpy as np
import polars as pl
import pytest
from recordings_made import ATTITUDES, G, hdf5, imu_columns, made, ros1_bag, ros2_bag, text, ulog

import tumblecal.recordings.table as formats
from tumblecal.capture.decoding.samples import Settings, blank
from tumblecal.capture.protocols import protocol
from tumblecal.data import read_positions
from tumblecal.data.calibration import Calibration
from tumblecal.ground.errors import InputError
from tumblecal.recordings.correction.correction import write_corrected
from tumblecal.recordings.correction.uncorrected import uncorrected
from tumblecal.recordings.options import KnownContext, RecordingOptions
from tumblecal.recordings.reduce import reduced


@pytest.fixture(scope="module")
def s():
    return made()


@pytest.fixture(scope="module")
def expected(s, tmp_path_factory):
    """The positions of the session as a plain table."""
    path = tmp_path_factory.mktemp("plain") / "plain.parquet"
    names = ["time_s", *(f"a{axis}_ms2" for axis in "xyz"), *(f"g{axis}_rads" for axis in "xyz"), "temperature_degc"]
    pl.DataFrame(dict(zip(names, imu_columns(s).values(), strict=True))).write_parquet(path)
    data = reduced([path], KnownContext(static=True)).data
    assert len(data) == len(ATTITUDES)
    return data


def _mat(path, s):
    from scipy.io import savemat

    columns = imu_columns(s)
    savemat(path, {"log": {"time": columns["time"], "acc": G * s.force, "gyr": np.radians(s.rate), "temp": s.warmth}})
    return path


def _dated(path, s):
    frame = pl.DataFrame(imu_columns(s)).with_columns(
        (pl.lit("2024-05-01 10:00:00").str.to_datetime(time_unit="us") + pl.duration(microseconds=pl.col("time") * 1e6))
        .dt.to_string("%Y-%m-%d %H:%M:%S%.6f").alias("time")
    )  # fmt: skip
    frame.write_csv(path)
    return path


def _counts(s):
    """Counts about 32768, 4096 a g, at milliseconds, with a column that nobody needs."""
    columns = {"n": np.arange(len(s.time_s)), "ms": 1000 * s.time_s}
    columns |= {f"raw{k}": 32768 + 4096 * s.force[:, k] for k in range(3)}
    return columns | {f"w{axis}": 16.4 * s.rate[:, k] for k, axis in enumerate("xyz")}


MADE = {
    "commas.csv": (lambda p, s: text(p, s, ",", imu_columns(s)), {}),
    "semicolons.csv": (lambda p, s: text(p, s, ";", imu_columns(s), comma=True), {}),
    "tabs.txt": (lambda p, s: text(p, s, "\t", imu_columns(s), before="# gravity_ms2: 9.80665\nFs\t100\n"), {}),
    "spaces.log": (
        lambda p, s: text(p, s, "  ", imu_columns(s), header=False),
        {"columns": "time=1,ax=2,ay=3,az=4,gx=5,gy=6,gz=7,temperature=8", "gyro_unit": "rad/s"},
    ),
    "padded.txt": (lambda p, s: text(p, s, " ,  ", imu_columns(s), before="a log\nof a flight\n"), {}),
    "dated.csv": (lambda p, s: _dated(p, s), {}),
    "counts.csv": (
        lambda p, s: text(p, s, ",", _counts(s)),
        {"columns": "time=ms,ax=raw0,ay=raw1,az=raw2,gx=wx,gy=wy,gz=wz", "unit": "4096/g", "offset": "32768"}
        | {"gyro_unit": "16.4/dps"},
    ),
    "log.mat": (_mat, {"gyro_unit": "rad/s"}),
    "log73.mat": (lambda p, s: hdf5(p, imu_columns(s), matlab=True), {}),
    "log.h5": (lambda p, s: hdf5(p, imu_columns(s)), {}),
    "one.bag": (ros1_bag, {}),
    "two": (lambda p, s: ros2_bag(p, s, mcap=False), {}),
    "three": (lambda p, s: next(ros2_bag(p, s, mcap=True).glob("*.mcap")), {}),
    "log.ulg": (ulog, {}),
    "log.xlsx": (lambda p, s: _sheet(p, s), {}),
}


def _sheet(path, s):
    pytest.importorskip("xlsxwriter")
    pl.DataFrame(imu_columns(s)).write_excel(path, worksheet="samples")
    return path


def _applied(recording, options, s, out):
    """What `apply` makes of a recording is the formula on its samples."""
    matrix, bias = np.array([[1.001, 2e-3, 0], [0, 0.998, -1e-3], [3e-3, 0, 1.002]]), np.array([0.01, -0.02, 0.03])
    calibration = Calibration(matrix, bias, np.zeros((12, 12)))
    checks, *_ = write_corrected(out, uncorrected(recording, options), calibration, recording)
    corrected = pl.read_parquet(out)
    unit = next(column.rpartition("_")[2] for column in corrected.columns if column.startswith("ax_"))
    force = corrected.select(f"a{axis}_{unit}" for axis in "xyz").to_numpy() / (G if unit == "ms2" else 1.0)
    assert checks.rows == len(s.force)
    np.testing.assert_allclose(force, (s.force - bias) @ matrix.T, atol=2e-6)


@pytest.mark.parametrize("name", MADE)
def test_every_format_gives_the_same_positions(tmp_path, s, expected, name):
    write, options = MADE[name]
    recording = write(tmp_path / name, s)
    _applied(recording, RecordingOptions(**options), s, tmp_path / "corrected.parquet")
    data = reduced([recording], KnownContext(static=True), RecordingOptions(**options)).data
    assert data.names == expected.names
    np.testing.assert_allclose(data.readings, expected.readings, atol=2e-7)
    np.testing.assert_allclose(data.time_s, expected.time_s, atol=2e-6)
    if name in ("one.bag", "two", "three"):
        # Messages are stamped with s since 1970: the pause to another bag is known.
        zero = datetime.fromisoformat(data.comments["time_zero"]).timestamp()
        assert zero == pytest.approx(1_700_000_000 + s.time_s[0], abs=1e-3) and "time_began_s" not in data.comments
    np.testing.assert_array_equal(data.n, expected.n)
    assert data.sd is not None and expected.sd is not None
    np.testing.assert_allclose(data.sd, expected.sd, rtol=1e-2)
    if "temp" in str(options) or name not in ("counts.csv", "one.bag", "log.ulg"):
        assert data.temperature_degc is not None
        np.testing.assert_allclose(data.temperature_degc, expected.temperature_degc, atol=2e-3)


def test_torn_lines_are_left_out_and_told(tmp_path, s, expected):
    path = text(tmp_path / "torn.csv", s, ",", imu_columns(s))
    lines = path.read_text().splitlines()
    lines[501] = lines[501][:20]
    lines[902] += ",7"
    lines[700] = "sensor restarted"
    lines[800:800] = ["", "# a comment"]
    lines[1303] = lines[1303].replace(",", ",x", 1)
    path.write_text("\n".join(lines))
    reduction = reduced([path], KnownContext(static=True))
    assert reduction.dwells.read[0].unread.rows == 4
    assert reduction.dwells.read[0].unread.first == [502, 701, 905, 1304]
    np.testing.assert_allclose(reduction.data.readings, expected.readings, atol=1e-4)


@pytest.mark.parametrize(
    ("name", "package"), [("one.bag", "rosbags"), ("log.ulg", "pyulog"), ("log.h5", "h5py"), ("log.xlsx", "fastexcel")]
)
def test_a_library_that_is_not_installed_is_a_line(tmp_path, s, monkeypatch, name, package):
    path = MADE[name][0](tmp_path / name, s)

    def absent(module):
        raise ImportError(module)

    monkeypatch.setattr(formats, "import_module", absent)
    with pytest.raises(InputError, match=f"the package {package}; install it with: pip install 'tumblecal"):
        reduced([path], KnownContext(static=True))


@pytest.mark.parametrize("name", ["mip", "vectornav"])
def test_a_byte_log_of_a_protocol_gives_the_same_positions(tmp_path, s, expected, name):
    samples = blank(len(s.time_s))
    samples.force[:], samples.rate[:], samples.temperature[:] = s.force, s.rate, s.warmth
    samples.counter[:] = np.arange(len(s.time_s))
    path = tmp_path / "port.bin"
    path.write_bytes(protocol(name).encode(samples, Settings(rate_hz=100.0)))
    reduction = reduced([path], KnownContext(static=True), RecordingOptions(rate=100.0))
    assert reduction.dwells.read[0].reader.title.startswith("byte log")
    np.testing.assert_allclose(reduction.data.readings, expected.readings, atol=3e-4)


def test_import_says_what_is_in_a_recording_and_writes_what_reduce_reads(tmp_path, s, expected, tumblecal):
    bag, table = ros2_bag(tmp_path / "bag", s, mcap=True), tmp_path / "samples.parquet"
    result = tumblecal("import", bag, "--out", table)
    assert result.code == 0, result.lines
    for words in (
        "/chatter (std_msgs/msg/String), 1 message\n",
        "table /imu/data",
        "linear_acceleration.x  m/s^2  format; unit:",
        "rate ",
        "100 Hz",
        "degC",
    ):
        assert words in result.out
    assert tumblecal("reduce", table, "--static", "--out", tmp_path / "out").code == 0
    data = read_positions(tmp_path / "out" / "positions.csv")
    np.testing.assert_allclose(data.readings, expected.readings, atol=1e-9)
    assert data.hand_held


def test_sniff_says_something_of_any_bytes(tmp_path, s, tumblecal):
    assert "tumblecal import" in tumblecal("sniff", ulog(tmp_path / "log.ulg", s)).out
    rng = np.random.default_rng(2)
    (tmp_path / "noise.bin").write_bytes(rng.integers(0, 256, 20000, dtype=np.uint8).tobytes())
    (line,) = tumblecal("sniff", tmp_path / "noise.bin").lines
    assert "compressed data, or a wrong baud rate" in line


def test_the_folder_of_a_capture_is_no_recording(tmp_path, tumblecal):
    (tmp_path / "journal.log").write_bytes(b"x")
    outcome = tumblecal("import", tmp_path, "--out", tmp_path / "out.csv")
    assert outcome.code == 2 and "this is the folder of a capture. For its samples, give" in outcome.lines[0]

"""Which columns are the accelerations: by the headers that loggers write, by values where names say nothing, or asked."""

import json

import numpy as np
import pytest

from recording_headers import HEADERS, columns_of, motion, renamed, shuffled
from tumblecal.capture.columns.roles import ColumnLayout, layout_of
from tumblecal.capture.columns.still_size import ellipsoid
from tumblecal.capture.recordings.options import RecordingOptions
from tumblecal.capture.recordings.table import of_arrays
from tumblecal.capture.rows.sample_file import write_samples
from tumblecal.ground.errors import InputError


G = 9.80665


def chosen(columns: dict[str, np.ndarray], **options) -> ColumnLayout:
    """The layout of a table of these columns."""
    return layout_of(of_arrays("", columns), RecordingOptions(**options), "log")


def numbers(cells: list[str]) -> np.ndarray:
    """Cells as numbers where all are."""
    try:
        return np.array(cells, float)
    except ValueError:
        return np.array(cells)


@pytest.mark.parametrize("header", HEADERS, ids=lambda header: header.source)
def test_headers_of_loggers(header):
    """Columns and axes in any order, with another prefix or case, offsets to 0.6 g: the right columns, or a question."""
    rng = np.random.default_rng(len(header.source))
    cells, _ = columns_of(header, rng, 20.0, 8)
    names, order = renamed(header, rng), shuffled(header, rng)
    table = {names[k]: numbers(cells[k]) for k in order}
    codes = dict(zip(names, header.codes, strict=True))
    if header.asks:
        with pytest.raises(InputError, match=r"--columns '?ax=[^,]+,ay=[^,]+,az="):
            chosen(table, rate=20.0)
        return
    layout = chosen(table, rate=20.0)
    assert [codes[layout.columns[f"a{axis}"].name] for axis in "xyz"] == ["ax", "ay", "az"]
    if "gx" in layout.columns:
        assert [codes[layout.columns[f"g{axis}"].name] for axis in "xyz"] == ["gx", "gy", "gz"]
    if any(code[0] == "t" for code in header.codes):
        assert codes[layout.columns["time"].name][0] == "t"


@pytest.fixture(scope="module")
def moved():
    """Accelerations in counts with offsets of 0.1, 0.5 and 0.6 g, rates, and a magnetic field, as `motion` goes."""
    rng = np.random.default_rng(3)
    own = motion(rng, 25.0, 14)
    force = np.round(2048 * (own["up"] + [0.1, 0.5, 0.6] + 1e-3 * rng.normal(size=own["up"].shape)))
    rate = own["rate"] + [0.4, -0.2, 0.1] + 0.05 * rng.normal(size=force.shape)
    field = 160 * own["north"] + [40.0, -30.0, 20.0] + rng.normal(size=force.shape)
    return force, rate, field


def numbered(*parts: np.ndarray) -> dict[str, np.ndarray]:
    """Columns as of a file without a header."""
    data = np.column_stack(parts)
    return {str(k + 1): data[:, k] for k in range(data.shape[1])}


def test_without_names_the_triple_on_one_ellipsoid_of_gravity(moved):
    force, rate, field = moved
    layout = chosen(numbered(np.arange(len(force)) / 25, force, rate, field))
    assert [column.name for column in layout.columns.values()] == ["2", "3", "4", "5", "6", "7", "1"]
    assert layout.per_g == 2048 and layout.size == pytest.approx(2048, rel=0.01)
    assert layout.why["ax"].startswith("values") and any("--columns ax=" in line for line in layout.guesses)


@pytest.mark.parametrize("case", ["one attitude", "a second triad", "a field before", "flat", "no gravity"])
def test_without_names_and_without_evidence_the_user_is_asked(moved, case):
    force, rate, field = moved
    data = {
        "one attitude": lambda: (force[:40], rate[:40]),
        "a second triad": lambda: (force, rate, force[:, ::-1] / 2048 + 1e-4),
        "a field before": lambda: (field, rate, force),
        "flat": lambda: (np.tile([0, 0, 1.0], (200, 1)) + 1e-3 * rate[:200], rate[:200] / 100),
        "no gravity": lambda: (rate, field),
    }[case]()
    with pytest.raises(InputError, match=r"--columns ax=\d,ay=\d,az=\d"):
        chosen(numbered(*data))


def test_of_raw_and_smoothed_the_raw_ones_and_of_two_sensors_a_question(moved):
    force, _, _ = moved
    axes = lambda name: {f"{name}[{k}]": force[:, k] for k in range(3)}  # noqa: E731
    layout = chosen(axes("accSmooth") | axes("acc"))
    assert layout.columns["ay"].name == "acc[1]"
    assert "not accSmooth[0], accSmooth[1], accSmooth[2]; to override: --columns 'ax=" in layout.guesses[0] or (
        "--columns ax=accSmooth[0]" in layout.guesses[0]
    )
    with pytest.raises(InputError, match=r"2 accelerometers; choose one: --columns .* or --columns "):
        chosen(axes("imu1_acc") | axes("imu2_acc"))
    # Few attitudes and a large offset make no sensor less of one.
    shifted = {f"imu1_acc[{k}]": force[:120, k] + [1200, -1200, 900][k] for k in range(3)}
    with pytest.raises(InputError, match="2 accelerometers"):
        chosen(shifted | {f"imu2_acc[{k}]": force[:120, k] for k in range(3)})


def test_the_ellipsoid_has_the_bias_and_the_size_of_gravity():
    """Exact points of a known ellipsoid; three points of a plane show none."""
    rng = np.random.default_rng(1)
    unit = rng.normal(size=(20, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    scales, bias = np.array([1.02, 0.97, 1.01]), np.array([0.3, -0.6, 0.1])
    fit = ellipsoid(G * (unit * scales + bias))
    assert fit is not None and fit.fits and fit.usual
    assert fit.dispersion < 1e-6
    assert fit.size == pytest.approx(G * scales.prod() ** (1 / 3), rel=1e-6)
    np.testing.assert_allclose(fit.bias, bias, atol=0.02)
    assert ellipsoid(G * unit * [1, 1, 0]) is None


def test_import_prints_a_table_of_columns_with_the_evidence_and_the_same_as_json(tmp_path, moved, tumblecal):
    """Rows, rate, gaps and columns are those that were written into the file."""
    force, rate, _ = moved
    path, out = tmp_path / "log.csv", tmp_path / "out.parquet"
    times = np.arange(len(force)) / 25 + 2.0 * (np.arange(len(force)) >= 200)
    header = "millis,gyroX,gyroY,gyroZ,z [mg],y [mg],x [mg]"
    data = np.column_stack([1000 * times, rate, force[:, ::-1] / 2.048])
    np.savetxt(path, data, delimiter=",", header=header, comments="", fmt="%.4f")
    lines = tumblecal("import", path, "--out", out).out.splitlines()
    rows = {line.split()[0]: line.split() for line in lines}
    assert rows["rows"][1] == str(len(force)) and rows["rate"][1] == "25"
    assert rows["ax"][1:] == ["x", "[mg]", "mg", "name;", "unit:", "by", "name"]
    assert rows["gy"][1] == "gyroY" and rows["gaps"][1:3] == ["1", "gap,"] and rows["damage"][1:] == ["none"]
    result = json.loads(tumblecal("import", path, "--out", out, "--json").out)
    assert result["schema"] == "tumblecal.import/1" and result["rows"] == len(force)
    assert result["columns"]["az"] == {"column": "z [mg]", "unit": "mg", "why": "name; unit: by name"}
    assert result["gaps"]["count"] == 1 and result["gaps"]["total_s"] == pytest.approx(2.04)
    assert result["rate_hz"] == pytest.approx(25) and result["damage"] == []


_TIMES = 3 + np.arange(300) / 50 + 1e-5 * np.random.default_rng(4).normal(size=300)
_AT = np.datetime64("2024-01-01T10:00:00", "us") + np.round(1e6 * _TIMES).astype("timedelta64[us]")


@pytest.mark.parametrize(
    ("clock", "column"),
    [
        (
            {
                "header.stamp.sec": np.floor(1.7e9 + _TIMES),
                "header.stamp.nanosec": np.round(1e9 * ((1.7e9 + _TIMES) % 1)),
            },
            1,
        ),
        ({"msecs": np.floor(1e5 * (_TIMES % 1)) / 100, "secs": np.floor(_TIMES)}, 0),
        ({"seq": np.arange(300), "created_at": _AT.astype(str)}, 1),
        ({"date": _AT.astype(str), "fw": np.full(300, "1.2")}, 0),
        ({"czas": _TIMES}, 0),
        ({"tus": np.round(1e6 * _TIMES)}, 0),
        # A count with a gap, and in equal whole steps; steps of time; unequal sums.
        ({"nr": np.arange(300) + 5.0 * (np.arange(300) > 90)}, None),
        ({"pos_byte": 32.0 * np.arange(300), "dt": np.full(300, 20)}, None),
        ({"sum": np.cumsum(np.random.default_rng(5).exponential(size=300))}, None),
    ],
    ids=lambda own: "+".join(own) if isinstance(own, dict) else "",
)
def test_the_clock_by_names_in_two_columns_or_by_values(tmp_path, moved, clock, column):
    """50 Hz from the times that were written."""
    columns = {**clock, **dict(zip(("ax", "ay", "az"), moved[0][:300].T, strict=True))}
    path = tmp_path / "log.csv"
    lines = [",".join(columns), *(",".join(map(str, row)) for row in zip(*columns.values(), strict=True))]
    path.write_text("\n".join(lines) + "\n")
    contents = write_samples(path, tmp_path / "out.parquet", RecordingOptions(unit="2048/g"))
    own = contents.layout.columns.get("time")
    assert (own and own.name) == (None if column is None else list(clock)[column])
    assert contents.rate_hz == (None if column is None else pytest.approx(50, rel=1e-3))


def test_three_columns_alone_at_rest_are_accelerations_of_one_g():
    """As a file of one face; not with a fourth column, beyond one g, or moving."""
    rng = np.random.default_rng(2)
    face = G * np.array([0.6, 0.0, 0.8]) + 0.02 * rng.normal(size=(200, 3))
    for columns in (numbered(np.arange(200) / 50, face), dict(zip("xyz", face.T, strict=True))):
        layout = chosen(columns)
        assert [layout.columns[f"a{axis}"].name[-1] for axis in "xyz"] in (["2", "3", "4"], ["x", "y", "z"])
    moving = face + 4 * np.cumsum(rng.normal(size=face.shape), axis=0)
    for data in (np.column_stack([face, face[:, 0]]), 1.5 * face, moving):
        with pytest.raises(InputError, match=r"--columns ax=\d,ay=\d,az=\d"):
            chosen(numbered(data))


def test_axes_alone_are_taken_only_with_the_size_of_gravity(moved):
    force, rate, field = moved
    named = lambda values, stem="": dict(zip((f"{stem}z", f"{stem}y", f"{stem}x"), values.T, strict=True))  # noqa: E731
    layout = chosen(named(force))
    assert [layout.columns[f"a{axis}"].name for axis in "xyz"] == ["x", "y", "z"]
    for values in (rate, field, force[:40]):
        with pytest.raises(InputError, match="--columns ax=x,ay=y,az=z"):
            chosen(named(values))
    layout = chosen(named(rate, "s1_") | named(force, "s2_") | named(field, "s3_"))
    assert layout.columns["ax"].name == "s2_x" and "gx" not in layout.columns

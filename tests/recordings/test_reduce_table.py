"""`tumblecal reduce TABLE`: means of raw samples in any table, as honest as those of a capture's folder."""

import json
import sys
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from tumblecal.data import read_positions
from tumblecal.ground.errors import InputError
from tumblecal.recordings.dwells.by_columns import read_position_samples
from tumblecal.recordings.options import KnownContext
from tumblecal.recordings.reduce import reduced


sys.path.insert(0, str(Path(__file__).parents[1] / "cli"))
from capture_folder import write_capture


ALPHA, BETA = np.tile(45.0 * np.arange(8), 3), np.repeat([0.0, 45.0, 90.0], 8)
COUNT, RATE_HZ, SIGMA_G = 1500, 100.0, 1e-3


def forces():
    alpha, beta = np.radians(ALPHA), np.radians(BETA)
    return np.stack([-np.sin(beta), np.cos(beta) * np.sin(alpha), np.cos(beta) * np.cos(alpha)], axis=-1)


def columns(samples, time_s, **more):
    """A row a sample of samples (positions, n, 3)."""
    each = samples.shape[1]
    names = [f"{k // 8}-{k % 8 + 1}" for k in range(len(samples))]
    told = {"position": np.repeat(names, each), "alpha_deg": np.repeat(ALPHA, each), "beta_deg": np.repeat(BETA, each)}
    told |= {"time_s": time_s.ravel()} | {name: np.repeat(values, each) for name, values in more.items()}
    return told | {f"a{axis}_g": values for axis, values in zip("xyz", samples.reshape(-1, 3).T, strict=True)}


@pytest.fixture
def white():
    """White samples (24, COUNT, 3), and their times."""
    rng = np.random.default_rng(11)
    samples = forces()[:, None] + SIGMA_G * rng.normal(size=(24, COUNT, 3))
    return samples, 60.0 * np.arange(24)[:, None] + np.arange(COUNT) / RATE_HZ


def written(path, told, comment=""):
    frame = pl.DataFrame(told)
    if path.suffix == ".parquet":
        frame.write_parquet(path)
    else:
        path.write_text(comment + frame.write_csv())
    return path


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_means_of_white_samples(tmp_path, white, suffix):
    samples, times = white
    warmth = np.linspace(20.0, 23.0, 24)
    told = columns(samples, times, temperature_degc=warmth, run=np.repeat([1, 2, 3], 8))
    reduction = reduced([written(tmp_path / f"log{suffix}", told)])
    data = reduction.data
    np.testing.assert_allclose(data.readings, samples.mean(1), atol=1e-12)
    # What is slower than a dwell cannot be excluded: a little more than sd / sqrt(n), never less.
    ratio = data.sd / (SIGMA_G / np.sqrt(COUNT))
    assert np.min(ratio) > 0.95 and np.max(ratio) < 1.6
    np.testing.assert_allclose(data.time_s, times.mean(1), atol=1e-9)
    np.testing.assert_allclose(data.temperature_degc, warmth, atol=1e-9)
    np.testing.assert_array_equal(data.alpha_deg, ALPHA)
    assert data.names[:2] == ("0-1", "0-2") and data.run == ("1",) * 8 + ("2",) * 8 + ("3",) * 8
    assert reduction.dwells.rate_hz == pytest.approx(RATE_HZ) and set(data.n) == {COUNT}


def test_a_table_of_a_capture_s_samples_is_reduced_as_the_capture(tmp_path):
    """Slow noise (a wander of 100 s) makes the means worse than sd / sqrt(n); table and folder say so alike."""
    capture = write_capture(tmp_path / "capture", forces(), 1e-4, 5e-5, 100.0)
    folder = reduced([capture.folder], KnownContext(run="2")).data
    assert folder.run == ("2",) * 24
    table = reduced([written(tmp_path / "log.csv", columns(capture.samples, capture.times_s))]).data
    np.testing.assert_allclose(table.readings, folder.readings, atol=2e-6)  # the frames are quantised
    np.testing.assert_allclose(table.sd, folder.sd, rtol=0.1)
    assert np.min(table.sd) > 2 * 1e-4 / np.sqrt(capture.samples.shape[1])


def test_a_position_that_comes_again_is_a_dwell_of_its_own(tmp_path, white):
    samples, times = white
    told = columns(samples, times)
    first = {name: values[: 2 * COUNT] for name, values in told.items()}
    again = {name: np.concatenate([values, values[:COUNT]]) for name, values in first.items()}
    again["time_s"] = np.concatenate([first["time_s"], first["time_s"][:COUNT] + 500.0])
    data = reduced([written(tmp_path / "log.csv", again)]).data
    assert data.names == ("0-1", "0-2", "0-1 (2)")
    del again["position"]
    assert reduced([written(tmp_path / "log.csv", again)]).data.names == ("p1", "p2", "p3")


def without(name):
    return lambda told: told.pop(name)


@pytest.mark.parametrize(
    ("change", "comment", "words"),
    [
        (without("alpha_deg"), "", "column alpha_deg is missing; write the angles"),
        (without("position"), "# attitudes: unknown\n", "column position is missing; write the name"),
        (without("time_s"), "", "the sample rate is not known; add a column time_s or a comment"),
        (without("time_s"), "# rate_hz: fast\n", "or a comment `# rate_hz: 100` instead of 'fast'"),
        (lambda told: told.update(time_s=told["time_s"] * 0), "", "column time_s must increase"),
        (lambda told: told.update(position=np.arange(480)), "", r"too few samples at position 0 \(1\), 1 \(1\)"),
        (
            lambda told: told.update(position=[""] * 9 + ["a"] * 471),
            "",
            "column position: 9 empty cells; write the position",
        ),
        (lambda told: [told.update({name: values[:0]}) for name, values in told.items()], "", "no rows; write a row"),
    ],
)
def test_what_is_no_table_of_samples(tmp_path, white, change, comment, words):
    """For `reduce` and for `diagnose --samples`, which needs no angles."""
    told = {name: values[::75] for name, values in columns(*white).items()}
    change(told)
    path = written(tmp_path / "log.csv", told, comment)
    with pytest.raises(InputError, match=words):
        reduced([path])
    if "alpha_deg" not in words:
        with pytest.raises(InputError, match=words):
            read_position_samples(path)


@pytest.mark.long
def test_the_command_writes_what_calibrate_takes(tumblecal, tmp_path, monkeypatch, white):
    """`calibrate` of raw samples says what to do; done, it fits."""
    path = written(tmp_path / "log.csv", columns(*white))
    refused = tumblecal("calibrate", path, "--out", tmp_path / "none")
    assert refused.code == 2 and len(refused.lines) == 1 and not (tmp_path / "none").exists()
    assert (
        f"raw samples. Reduce them first, then give reduced/positions.csv: tumblecal reduce {path} --out reduced"
        in refused.lines[0]
    )
    monkeypatch.setenv("COLUMNS", "60")
    outcome = tumblecal("reduce", path, "--out", tmp_path / "reduced")
    assert outcome.code == 0 and "24 positions of 36000 samples" in " ".join(outcome.out.split())
    assert "…" not in outcome.out and "-707.1" in outcome.out
    positions = tmp_path / "reduced" / "positions.csv"
    content = json.loads((tmp_path / "reduced" / "reduction.json").read_text())
    assert content["schema"] == "tumblecal.reduction/1" and len(content["positions"]) == 24
    assert read_positions(positions).recorded_noise is not None
    assert tumblecal("calibrate", positions, "--no-figures", "--out", tmp_path / "fit").code == 0

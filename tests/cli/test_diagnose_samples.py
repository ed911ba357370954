"""`tumblecal diagnose --samples` on a capture's folder and on tables, and `--fix`: what is printed, written, refused."""

import json

import numpy as np
import polars as pl
import pytest
from capture_folder import means_of, wandering


pytestmark = pytest.mark.usefixtures("few_effects")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A quadratic error of y in noise whose slow part is seven times the white noise of a mean."""
    return wandering(tmp_path_factory.mktemp("lab") / "run", {"second_order.y": [0.5e-3]})


@pytest.fixture(scope="module")
def means(recorded):
    return means_of(recorded)


@pytest.fixture(scope="module")
def table(recorded):
    """The same samples as a table, positions as whole numbers."""
    places, count, _ = recorded.samples.shape
    columns = {f"a{axis}_g": recorded.samples[:, :, k].ravel() for k, axis in enumerate("xyz")}
    names = np.repeat(np.arange(1, places + 1), count)
    return pl.DataFrame({"position": names, "time_s": recorded.times_s.ravel(), **columns})


def test_samples_of_a_capture(tumblecal, tmp_path, recorded, means):
    """The slow noise is seen in the samples and counted; the cause is found through it."""
    outcome = tumblecal("diagnose", means, "--samples", recorded.folder, "--out", tmp_path / "out")
    assert outcome.code == 0 and not outcome.lines
    said = " ".join(outcome.out.split())
    assert f"Raw samples of {recorded.folder} (24 positions of 30 s): x white 42." in said
    assert "noise of the raw samples" in said and "Under the assumption of white noise (sd / sqrt(n))" in said
    found = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    samples, white = found["samples"], 3e-4 / np.sqrt(30 * 50)
    assert samples["source"] == str(recorded.folder) and samples["slow_noise"] in ("walk", "markov", "flicker", "apart")
    assert samples["white_sd_of_mean_g"] == pytest.approx([white] * 3, rel=0.03)
    # Two means of 30 s, 60 s apart, in a Gauss-Markov wander of 80 ug and 60 s have sds of 55 ug against each other; by a
    # walk of the same steps, which 30 s do not tell from it, 73 ug. Over many recordings: tests/noise/test_dwell_fit.py.
    sd = np.array(samples["sd_of_mean_g"])
    assert np.all((sd > 0.65 * 55e-6) & (sd < 1.25 * 73e-6))
    named = [set(found["explanations"][0]["effects"]), *map(set, found["explanations"][0]["equivalents"])]
    assert {"second_order.y"} in named and found["detection"]["p_value"] < 1e-4
    page = (tmp_path / "out" / "diagnosis.html").read_text()
    assert "noise of the raw samples" in page and "stated noise" not in page


BAD = {
    "nothing in it": (lambda t: t.head(0), "no rows; write a row for each sample"),
    "one position lacks samples": (
        lambda t: t.filter(pl.col("position") != 5),
        "no samples of position 5 of {means}; it has 1, 2, 3, 4 and 19 more",
    ),
    "of other positions": (
        lambda t: t.with_columns(pl.col("position") % 24 + 1),
        "position 1: the samples' mean of axis z is",
    ),
    "no noise to be seen": (
        lambda t: t.with_columns(pl.col("az_g").mean().over("position")),
        "axis z: most positions' samples are equal",
    ),
}


@pytest.mark.parametrize(("change", "words"), BAD.values(), ids=BAD)
def test_bad_tables(tumblecal, tmp_path, means, table, change, words):
    change(table).write_parquet(tmp_path / "raw.parquet")
    outcome = tumblecal("diagnose", means, "--samples", tmp_path / "raw.parquet", "--out", tmp_path / "out")
    assert outcome.code == 2 and len(outcome.lines) == 1
    assert outcome.lines[0].startswith(f"tumblecal: {tmp_path / 'raw.parquet'}: ")
    assert words.format(means=means) in outcome.lines[0]
    assert [path.name for path in tmp_path.iterdir()] == ["raw.parquet"]

"""Headers of loggers that the rules for names were not made from: the right columns or a question, never wrong ones."""

import numpy as np
import polars as pl
import pytest
from recording_headers import columns_of, headers_of, renamed, shuffled

from tumblecal import InputError
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.reading import read_recording


HEADERS = headers_of("more_headers.toml")


@pytest.mark.parametrize("header", HEADERS, ids=[header.source for header in HEADERS])
def test_the_accelerations_of_the_sensor_or_a_question(tmp_path, header):
    rng = np.random.default_rng(len(header.source))
    cells, force = columns_of(header, rng, 50.0, 8)
    names = header.names if header.separator == " " else renamed(header, rng)
    order = shuffled(header, rng)
    rows = zip(*(cells[k] for k in order), strict=True)
    lines = [header.separator.join(names[k] for k in order), *(header.separator.join(row) for row in rows)]
    path, out = tmp_path / "log.csv", tmp_path / "samples.parquet"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    try:
        read_recording(path, out, RecordingOptions())
    except InputError as question:
        assert "--" in str(question) and not out.exists()
        return
    assert not header.asks
    read = pl.read_parquet(out).select(pl.col("^a[xyz]_.*$")).to_numpy()
    np.testing.assert_allclose(read, force, rtol=1e-3, atol=header.per_g * 1e-4 + (header.per_g >= 256))


@pytest.mark.long
def test_few_of_them_are_questions_without_need(tmp_path):
    """At 50 Hz without a rate: a unit of the times that is not stated, an axis that is not named."""
    asked = 0
    for header in HEADERS:
        cells, _ = columns_of(header, np.random.default_rng(1), 47.0, 8)
        rows = (header.separator.join(row) for row in zip(*cells, strict=True))
        (tmp_path / "log.csv").write_text("\n".join([header.separator.join(header.names), *rows, ""]), encoding="utf-8")
        try:
            read_recording(tmp_path / "log.csv", tmp_path / "samples.parquet")
        except InputError:
            asked += not header.asks
    assert asked <= 0.08 * len(HEADERS)

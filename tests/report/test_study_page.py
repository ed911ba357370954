"""The page and the table of a study: what was found, in words that follow from the numbers, and what the files hold."""

import numpy as np
import polars as pl
import pytest
from reading_html import Cells, words_of

from tumblecal.show.figures.drawing import draw_each
from tumblecal.show.figures.study import FIGURES
from tumblecal.show.page import write_page
from tumblecal.show.study import answer_of


CASES, PATHS, SETS = ("mount", "all"), ("harmonic", "small angle"), (1, 100)
GIVEN = {"title": "<b>Plan</b>", "study": {"seed": 1, "data_sets": [1, 100]}, "rig": {"title": "head"}}


def linearization() -> tuple[dict, dict]:
    sizes, names = np.geomspace(1e-3, 1e-1, 5), ("dK_x", "bias_z")
    biases = [
        (case, path, size, name, 0.0, 10 * size**2 * (k + 1), 0.0)
        for case in CASES for path in PATHS for size in sizes for k, name in enumerate(names)
    ]  # fmt: skip
    crossings = [
        (case, path, sets, name, None if case == "mount" else 5e-3 / (k + 1) / np.sqrt(sets))
        for case in CASES for path in PATHS for sets in SETS for k, name in enumerate(names)
    ]  # fmt: skip
    frames = {
        "biases": pl.DataFrame(
            biases, ["case", "path", "size", "parameter", "mean_bias", "rms_bias", "largest_bias"], orient="row"
        ),
        "crossings": pl.DataFrame(crossings, ["case", "path", "data_sets", "parameter", "size"], orient="row"),
    }
    return GIVEN | {"instruments": 7, "failed": 0, "predicted_sd": {"dK_x": 1e-4, "bias_z": 1e-4}}, frames


def coverage(covered: float) -> tuple[dict, dict]:
    levels = {f"covered_{level}_{kind}": covered for level in (68, 95, 99) for kind in ("stated", "estimated")}
    row = {"parameter": "dK_x", "unit": "1", "bias": 1e-6, "bias_se": 1e-6, "sd": 1e-3, "predicted_sd": 1e-3}
    content = GIVEN | {"path": "harmonic", "trials": 10_000, "failed": 0, "levels": [0.68, 0.95, 0.99]}
    content |= {"chi2_mean": 57.0, "dof": 57, "nees_mean": 15.0, "nees_expected": 15, "chi2_histogram": [0.05] * 20}
    return content, {"parameters": pl.DataFrame([row | {"sd_over_predicted": 1.0} | levels])}


def test_linearization_is_a_table_and_a_page(tmp_path):
    content, frames = linearization()
    answer = answer_of("linearization", content, frames)
    assert list(answer.table.rows) == [
        ["mount", "1", "> 100", "", "> 100", ""],
        ["mount", "100", "> 100", "", "> 100", ""],
        ["all", "1", "2.5", "bias_z", "2.5", "bias_z"],
        ["all", "100", "< 1", "bias_z", "< 1", "bias_z"],
    ]
    assert "up to 2.5 mrad" in answer.words.verdict.headline
    page = tmp_path / "linearization.html"
    figures = draw_each(tmp_path, FIGURES["linearization"], content, frames)
    assert write_page(page, answer.words, figures, tables={"results": answer.table}) == [page.name]
    words = words_of(page)
    assert words.index(answer.words.verdict.headline) < words.index("Results") < words.index("Settings")
    cells = Cells()
    cells.feed(page.read_text(encoding="utf-8"))
    files = {row[0] for row in cells.rows}
    assert {"linearization.json", "linearization_biases.parquet"} <= files and "seed = " in page.read_text(
        encoding="utf-8"
    )
    assert "<b>Plan" not in page.read_text(encoding="utf-8")


@pytest.mark.parametrize(("covered", "tone"), [(0.951, "good"), (0.80, "bad")])
def test_the_headline_follows_the_coverage(covered, tone):
    answer = answer_of("coverage", *coverage(covered))
    assert answer.tone == tone and ("Do not trust" in answer.words.verdict.headline) == (tone == "bad")


def test_convergence_draws_the_errors_and_the_data_sets_needed(tmp_path):
    methods, sets = ("exact", "kalman"), [1, 10, 100, 1000]
    names = [f"{leaf}_{k}" for leaf in ("dK", "bias", "dtheta", "gamma", "dbeta") for k in (1, 2)]
    errors = [(m, p, n, 1e-4 / np.sqrt(n)) for m in methods for p in names for n in sets]
    needed = [
        (m, p, limit, 10.0, 20.0 * (k + 1), 40.0 * (k + 1))
        for m in methods for k, p in enumerate(names) for limit in (1e-4, 1e-5)
    ]  # fmt: skip
    frames = {
        "errors": pl.DataFrame(errors, ["method", "parameter", "data_sets", "rms"], orient="row"),
        "consistency": pl.DataFrame(
            [(m, n, 15.0) for m in methods for n in sets], ["method", "data_sets", "nees"], orient="row"
        ),
        "needed": pl.DataFrame(needed, ["method", "parameter", "threshold", "p10", "median", "p90"], orient="row"),
    }
    content = GIVEN | {"methods": list(methods), "nees_expected": 15, "data_sets": 1000}
    drawn = draw_each(tmp_path, FIGURES["convergence"], content, frames)
    assert list(drawn) == ["convergence.svg", "data_sets_needed.svg"]
    assert drawn["data_sets_needed.svg"].count("below ") >= 2 and "kalman" in drawn["convergence.svg"]

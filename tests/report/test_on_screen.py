"""What Python and a notebook show of a result: one screen, a table of its numbers, and a figure."""

from dataclasses import replace
from html import escape
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest
from matplotlib.figure import Figure

import tumblecal
from tumblecal.estimation import problem_of
from tumblecal.estimation.methods import all_methods
from tumblecal.ground.showing import Screen, brief
from tumblecal.show.figures.calibration import FIGURES


@pytest.fixture(scope="module")
def results(table1, diagnosis):
    calibrated = all_methods(problem_of(table1, noise_sd=1e-4))
    rig = tumblecal.read_rig("hidden_effect")
    own = {"rig": rig, "positions": table1, "chain": calibrated.exact.chain, "calibrated": calibrated}
    return own | {"exact": calibrated.exact, "diagnosis": diagnosis, "calibration": diagnosis.calibration}


@pytest.mark.parametrize("name", ["rig", "positions", "chain", "calibrated", "exact", "diagnosis", "calibration"])
def test_each_result_is_one_screen_in_a_terminal_and_in_a_notebook(results, name):
    text, html = repr(results[name]), results[name]._repr_html_()
    assert len(text) < 4000 and text.count("\n") < 40 and len(html) < 250_000
    assert escape(text.splitlines()[0]) in html
    assert ("<svg" in html) == hasattr(results[name], "plot_residuals")


def test_tables_are_the_numbers_of_the_fit(results):
    fit, table = results["exact"], results["calibrated"].table()
    row = table.row(by_predicate=pl.col("parameter") == "bias_x", named=True)
    assert row["unit"] == "mg" and row["value"] == pytest.approx(1e3 * fit.value("bias_x"))
    assert row["sd"] == pytest.approx(1e3 * fit.sd[fit.names.index("bias_x")])
    assert row["harmonic"] == pytest.approx(1e3 * results["calibrated"].fits["harmonic"].value("bias_x"))
    assert fit.table().equals(table.select("parameter", "value", "sd", "unit"))
    assert results["positions"].table()["ax_g"].to_list() == results["positions"].readings[:, 0].tolist()
    assert dict(fit.chain.table().select("parameter", "value").iter_rows())["bias_x"] == pytest.approx(row["value"])
    explanations = results["diagnosis"].table()
    assert explanations["probability"][0] == results["diagnosis"].screened.explanations[0].probability


@pytest.mark.parametrize("name", ["residuals", "columns", "harmonics", "explanations", "predictive", "limits"])
def test_figures_of_a_diagnosis_are_matplotlib_s(results, name):
    assert isinstance(getattr(results["diagnosis"], f"plot_{name}")(), Figure)


def test_methods_are_drawn_with_the_exact_fit_alone(results):
    alone = replace(results["calibrated"], fits={"exact": results["exact"]})
    assert isinstance(alone.plot_methods(), Figure) and isinstance(results["calibrated"].plot_methods(), Figure)
    assert FIGURES["methods.svg"](alone) is None  # a page has it if there is something to compare


def test_a_long_table_ends_after_24_rows_and_columns_are_aligned():
    screen = Screen("27 <rows>", ("name", "value"), [(f"row {k}", str(10**k)) for k in range(27)], ["a & b"])
    headline, header, *rows, more, note = screen.text().splitlines()
    assert headline == "27 <rows>" and len(rows) == 24 and note == "a & b"
    assert more == "... and 3 more rows: .table() has all"
    assert {len(line) for line in (header, *rows)} == {len("row 23  ") + 24}
    html = screen.html("<svg>drawn</svg>")
    assert html.count("<tr>") == 25 and "27 &lt;rows&gt;" in html and "a &amp; b" in html and more in html
    assert html.endswith("<svg>drawn</svg></div></div>") and Screen("nothing").text() == "nothing"


def test_objects_of_large_arrays_are_one_line():
    long = SimpleNamespace(__dataclass_fields__={}, a=0)
    long.__dataclass_fields__ = dict.fromkeys(("array", "many", "few", "made", "text"))
    long.array, long.many, long.few, long.made, long.text = np.zeros((3, 2)), [1] * 9, (1, 2), len, "x" * 300
    assert brief(long) == "SimpleNamespace(array: float64[3, 2], many: 9 items, few: (1, 2), made: function, text: str)"

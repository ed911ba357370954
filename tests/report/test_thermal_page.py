"""`tumblecal thermal` on the example of docs/thermal.md, run as the page states it: output, files, page, rejected options."""

import hashlib
import re
from pathlib import Path

import numpy as np
import pytest

from pages import ROOT, blocks, run_example
from tumblecal.data.calibration import read_calibration


BIAS = np.array([[0.1e-3, 0, 1e-7], [-0.05e-3, 0, -6e-8], [0.2e-3, 0, 8e-8]])  # of the page: g/degC, g/degC^2, g/degC^3


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("thermal")


@pytest.fixture
def example(folder, tumblecal, monkeypatch):
    """The folder in which the program and the first command of the page ran, once."""
    monkeypatch.chdir(folder)
    if not Path("printed").exists():
        Path("configs").symlink_to(ROOT / "configs")
        Path("printed").write_text(run_example("thermal", tumblecal), encoding="utf-8")
    return folder


@pytest.mark.long
def test_the_page_s_example_prints_its_lines_and_finds_the_bias(example):
    printed = (example / "printed").read_text(encoding="utf-8")
    (text,) = blocks("thermal", "text")
    assert text in printed
    # Equal layouts and equal findings are printed once.
    assert printed.count("columns: ax=ax_g") == 1 and printed.count("0 soaks") == 1
    calibration = read_calibration(example / "unit17" / "calibration.json")
    curves, digests = calibration.temperature, calibration.provenance["files"]
    assert curves is not None
    assert len(digests) == 6
    assert digests["x_up.csv"] == hashlib.sha256((example / "x_up.csv").read_bytes()).hexdigest()
    assert calibration.provenance["method"] == "thermal" and "tumblecal" in calibration.provenance
    degc = np.linspace(*curves.range_degc, 9)
    powers = np.stack([(degc - 25) ** k for k in (1, 2, 3)])
    assert np.max(np.abs(curves.at(degc)[:, 3:6].T - BIAS @ powers)) < 0.15e-3
    table = (example / "unit17" / "parameters.csv").read_text(encoding="utf-8").splitlines()
    assert table[0].startswith("temperature_degc,dK_x,u_dK_x") and len(table) > 50


@pytest.mark.long
def test_the_page_is_complete_in_a_browser(example, chromium):
    page = example / "unit17" / "thermal.html"
    for width in (1280, 500):
        document = chromium.whole(page, 5, width)
    first = document[: document.index("<nav>")]
    for words in ("USABLE", "on held-out rows", "rising and falling temperature", "non-orthogonality"):
        assert words in first, words
    text = re.sub(r"<(svg|style|script).*?</\1>", "", document, flags=re.S)
    assert not re.search(r"\bnan\b|\binf\b|None|\{\{", text)

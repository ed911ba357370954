"""The page of a calibration: whether to trust it comes first, and what it shows is what was fitted."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from decimal import Decimal
from html import unescape

import numpy as np
import pytest

from tumblecal.data import write_positions
from tumblecal.estimation import exact, problem_of
from tumblecal.estimation.methods import all_methods
from tumblecal.lab.record import calibration_of
from tumblecal.show.fit import fit_words


SIGMA_G = 0.087e-3


@pytest.fixture(scope="module")
def calibrated(table1):
    return all_methods(problem_of(table1, noise_sd=SIGMA_G))


def words_of(page):
    text = re.sub(r"<(style|svg)\b.*?</\1>", " ", page.read_text(encoding="utf-8"), flags=re.S)
    return " ".join(re.sub(r"<[^>]+>", " ", text).replace("&#39;", "'").split())


def test_what_the_residuals_say_decides_the_headline(table1, calibrated):
    (judged,) = calibrated.judgements
    assert (judged.tone, judged.headline) == ("good", "Usable: the residuals are consistent with the stated noise.")
    too_small = all_methods(problem_of(table1, noise_sd=SIGMA_G / 5))
    assert too_small.use.refused and not too_small.use.expanded_words
    (too_small,) = too_small.judgements
    assert too_small.tone == "bad" and too_small.headline.startswith("Do not use it: the data contradict the model (p ")
    assert "the residuals exceed the stated noise, chi2/dof 31.6" in too_small.headline
    assert too_small.advice.startswith("Run: tumblecal diagnose ")
    (unknown,) = all_methods(problem_of(table1)).judgements
    assert unknown.tone == "good" and "no noise is stated" in unknown.headline
    far = replace(table1, readings=table1.readings + np.array([0.8, 0.0, 0.0]))
    assert (
        all_methods(problem_of(far, noise_sd=SIGMA_G))
        .judgements[0]
        .headline.startswith("Do not use it: the fit requires parameter values")
    )
    # Residuals of twice the noise contradict the model as well.
    assert all_methods(problem_of(table1, noise_sd=SIGMA_G / 2)).use.refused


@pytest.mark.long
def test_no_degree_of_freedom_judges_nothing_and_says_why(tumblecal, tmp_path, table1):
    """Five positions at three pitch settings: 15 readings for 15 parameters. It was a traceback, or sd nan."""
    data = table1.chosen([0, 2, 9, 11, 19])
    write_positions(tmp_path / "five.csv", data)
    why = "15 readings for 15 parameters leave no degree of freedom"
    refused = tumblecal("calibrate", tmp_path / "five.csv", "--out", tmp_path / "out")
    assert refused.code == 2 and len(refused.lines) == 1 and why in refused.lines[0]
    assert "state the noise (--noise-sd)" in refused.lines[0] and not (tmp_path / "out").exists()
    fit = exact.fit(problem_of(data))
    untested = "goodness of fit cannot be tested without a degree of freedom."
    assert fit_words(fit).text("noise") == f"Noise: not known; {untested}" and "nan" not in repr(fit).split()
    stated = all_methods(problem_of(data, noise_sd=SIGMA_G))
    (judged,) = stated.judgements
    assert judged.tone == "open" and judged.headline.startswith(f"Not tested: {why}") and judged.refused
    assert stated.use.answer == "not tested" and stated.use.words.startswith(f"not tested: {why}")
    assert fit_words(stated.exact).text("noise") == f"Noise: stated; {untested}"


def test_sd_columns_are_a_lower_bound(tumblecal, tmp_path, table1):
    """The scatter beside them is measured and counted; it was a chi-square 31 times too large, and an sd 5 times too small."""
    stated = replace(table1, sd=np.full(table1.readings.shape, SIGMA_G / 5))
    write_positions(tmp_path / "small.csv", stated)
    outcome = tumblecal("calibrate", tmp_path / "small.csv", "--out", tmp_path / "out")
    assert outcome.code == 0
    page = words_of(tmp_path / "out/calibration.html")
    assert "(intervals by Student's t)" in page
    assert "error of the model (a diagnosis separates them)" in page and "cause, run: tumblecal diagnose " in page
    assert "The positions scatter about the model by 0.09" in " ".join(outcome.out.split())
    content = json.loads((tmp_path / "out/result.json").read_text(encoding="utf-8"))
    assert content["noise"]["kind"] == "estimated"
    assert content["noise"]["floor_g"] == pytest.approx(np.sqrt(31.6 - 1) * SIGMA_G / 5, rel=0.02)
    calibrated = all_methods(problem_of(stated), by_columns=True)
    (judged,) = calibrated.judgements
    assert judged.tone == "open" and "repeat" in judged.advice and calibrated.use.answer == "yes"


def test_the_page_holds_the_numbers_and_the_way_to_apply_them(tumblecal, tmp_path, table1, table1_file, calibrated):
    out = tmp_path / "out"
    outcome = tumblecal("calibrate", table1_file, "--noise-sd", f"{SIGMA_G * 1e3}mg", "--out", out)
    assert outcome.code == 0 and "calibration.html" in outcome.out
    words = words_of(out / "calibration.html")
    first = "USABLE The residuals are consistent with the stated noise. Use calibration.json: yes, U = "
    assert words.index(first) < words.index("bias_x = 1.27 mg, U = 0.36 mg") < words.index("Parameters")
    exact, half = calibrated.exact, 1.959964 * calibrated.exact.sd
    for name in ("dK_x", "bias_y"):
        k = exact.names.index(name)
        u = Decimal(f"{exact.sd[k] * 1e3:#.2g}")
        value = Decimal(float(exact.values[k] * 1e3)).quantize(u)
        assert f"{name} {value} {u} {Decimal(float(half[k] * 1e3)).quantize(u)}" in words
    assert "dK_x + 0.93 bias_x + 0.94 dbeta_0; uncertainty 10 times the median" in words
    assert "do not rely on these" not in words
    assert tumblecal("calibrate", table1_file, "--noise-sd", "0.01mg", "--out", tmp_path / "small").code == 3
    small = words_of(tmp_path / "small" / "calibration.html")
    assert "The residuals contradict the stated noise (sd 0.01 mg" in small
    assert f" {exact.sd[k] * exact.sigma / SIGMA_G * 1e3:#.2g} " in small
    (code,) = re.findall("<pre>(import tumblecal.*?)</pre>", (out / "calibration.html").read_text(), re.S)
    script = f"import numpy as np\nreadings = np.eye(3)\n{unescape(code)}"
    ran = subprocess.run(
        [sys.executable, "-c", f"{script}\nprint(force.tolist())"], cwd=out, capture_output=True, text=True, check=True
    )
    np.testing.assert_allclose(json.loads(ran.stdout), calibration_of(exact).corrected(np.eye(3)), atol=1e-7)

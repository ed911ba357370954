"""The page of a diagnosis: complete, one file, right in a real browser, for every kind of verdict."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from reading_html import Cells, words_of

from tumblecal.ground.units import shown
from tumblecal.lab import diagnosed
from tumblecal.planning import NextPlan, next_plan
from tumblecal.show.diagnosis import verdict_of_diagnosis, write_diagnosis


FIGURES = {
    "residuals_by_angle.svg",
    "residuals_by_column.svg",
    "residual_harmonics.svg",
    "finding_1.svg",
    "finding_2.svg",
    "predictive.svg",
    "limits.svg",
}


@pytest.fixture(scope="module")
def folder(diagnosis, tmp_path_factory):
    folder = tmp_path_factory.mktemp("diagnosis")
    names = write_diagnosis(folder, diagnosis, next_plan(diagnosis), figures=True)
    assert sorted(names) == sorted(path.name for path in folder.iterdir())
    return folder


@pytest.fixture(scope="module")
def page(folder):
    return folder / "diagnosis.html"


def rows(page) -> list[list[str]]:
    cells = Cells()
    cells.feed(page.read_text(encoding="utf-8"))
    return cells.rows


def test_one_calibration_and_one_verdict_for_all_files_and_words(diagnosis, tmp_path, monkeypatch):
    made, compute = [], diagnosed.extended_calibration
    monkeypatch.setattr(diagnosed, "extended_calibration", lambda given: made.append(1) or compute(given))
    fresh = replace(diagnosis)  # nothing computed yet
    verdict = replace(verdict_of_diagnosis(fresh), headline="As given.")
    write_diagnosis(tmp_path, fresh, NextPlan(), figures=False, verdict=verdict)
    assert verdict.use == fresh.calibration.use.words and len(made) == 1
    assert (tmp_path / "verdict.txt").read_text().startswith(f"{fresh.verdict.upper():<12}As given.")


@pytest.mark.parametrize("width", [1000, 500])
def test_browser_shows_all_of_it_and_fetches_nothing(chromium, page, width):
    assert chromium.whole(page, len(FIGURES), width).count("<h2>") == 6


def test_page_stands_alone(page):
    text = page.read_text(encoding="utf-8")
    assert "<?xml" not in text and "<script" not in text
    assert not re.findall(r"""(?:src|href)\s*=\s*["'](?:\w+:)?//""", text)
    assert not re.search(r"url\((?!#)", text) and "@import" not in text
    assert not re.search(r"\bnan\b|\binf\b|None|\{\{|Candidate\(", re.sub(r"<svg.*?</svg>", "", text, flags=re.S))


def test_tables_hold_the_numbers_of_the_json(page, folder, diagnosis):
    record = json.loads((folder / "diagnosis.json").read_text(encoding="utf-8"))
    cells = rows(page)
    gain = record["gain"]
    for name, kind in (("residuals, rms", "rms"), ("expected of a repeat measurement", "fresh_rms")):
        before, after = gain[f"{kind}_before_g"] * 1e3, gain[f"{kind}_after_g"] * 1e3
        row = next(row for row in cells if row and row[0] == name)
        assert [float(cell) for cell in row[1:3]] == pytest.approx([before, after], rel=1e-2)
        assert float(row[3].split("±")[0]) == pytest.approx(before - after, abs=2e-3)
    assert any(row[0].startswith("delta BIC") and row[3] == f"{gain['delta_bic']:.1f}" for row in cells if row)
    written = json.loads((folder / "calibration.json").read_text(encoding="utf-8"))["parameters"]
    assert record["parameters"].keys() == record["shifts"].keys()
    for name, own in record["parameters"].items():
        row = next(row for row in cells if row and row[0] == name and len(row) == 9)
        of_unit, parts = shown(own["unit"])[1], [own[key] for key in ("noise", "explanations", "undetected_effects")]
        assert [float(cell) / of_unit for cell in row[3:8]] == pytest.approx(
            [own["value"], own["u"], *parts], abs=0.051 * own["u"]
        )
        # GUM 7.2.6: the uncertainty with two significant digits, everything else to the same decimal.
        assert len(row[4].replace(".", "").lstrip("0")) == 2
        assert len({len(cell.partition(".")[2]) for cell in row[2:8]}) == 1
        nominal = diagnosis.nominal.value(name)
        assert float(row[8]) == pytest.approx((own["value"] - nominal) / own["u"], abs=0.06)
        assert own["u"] == pytest.approx(np.linalg.norm(parts), rel=1e-9) and own["undetected_effects"] > 0
        if name in written["names"]:
            k = written["names"].index(name)
            assert own["value"] == written["values"][k] and own["u"] ** 2 == pytest.approx(written["covariance"][k][k])
    file = json.loads((folder / "calibration.json").read_text(encoding="utf-8"))
    whole = file["covariance_with_terms"]
    np.testing.assert_allclose(np.array(whole["covariance"])[:12, :12], file["covariance"])
    assert whole["order"][:12] == file["covariance_order"] and len(whole["order"]) == 12 + len(file["terms"])
    for place, term in enumerate(file["terms"], start=12):
        # The coefficient is known worse than by the noise alone, and not by much where it was identified.
        k = diagnosis.extended.names.index(whole["order"][place])
        assert 1.0 < whole["covariance"][place][place] ** 0.5 / diagnosis.extended.sd[k] < 3.0, term
    unit, scale = shown(diagnosis.model.nominal_chain.units[0])
    row = next(row for row in cells if row and row[0] == "dK_x" and len(row) == 9)
    places = len(row[2].partition(".")[2])
    assert row[1] == unit and float(row[2]) == pytest.approx(
        diagnosis.nominal.vector[0] * scale, abs=0.51 * 10**-places
    )


@pytest.mark.parametrize("kind", ["adequate", "mixed_up", "by_hand"])
def test_page_of_other_verdicts(kind, request, chromium, tmp_path):
    diagnosis = request.getfixturevalue(kind)
    names = write_diagnosis(tmp_path, diagnosis, next_plan(diagnosis), figures=True)
    drawn = [name for name in names if name.endswith(".svg")]
    chromium.whole(tmp_path / "diagnosis.html", len(drawn))
    words = words_of(tmp_path / "diagnosis.html")
    told = {
        "adequate": "ADEQUATE No error found that 24 positions with 0.1 mg noise can show",
        "mixed_up": "All readings are in m/s²; corrected in this diagnosis unit_error",
        "by_hand": "no pitch setting has four or more spindle angles",
    }
    assert told[kind] in words
    assert ("residual_harmonics.svg" in drawn) == (kind != "by_hand")
    assert ("expected of a repeat measurement" in words) == (diagnosis.extended is not diagnosis.nominal)

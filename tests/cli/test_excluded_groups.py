"""A pitch setting, mounting or run all of whose positions the outlier search or an option excludes, through all outputs."""

import json

import numpy as np
import pytest

from tumblecal.data import PositionSet, write_positions
from tumblecal.ground.frames import gravity_in_head


pytestmark = pytest.mark.usefixtures("few_effects")


NOISE = 1e-4
# 24 positions, and a group of two.
ALPHA = np.append(np.tile(np.arange(0.0, 360.0, 45.0), 3), [30.0, 200.0])
BETA = np.repeat([0.0, 45.0, 90.0, 45.0], [8, 8, 8, 2])
FAULTS = np.array([[6e-3, -6e-3, 3e-3], [-4e-3, 2e-3, 6e-3]])
PRIORS = ("--noise-sd", "0.1mg", "--prior", "dbeta=1 arcmin", "--prior", "dtheta=1 arcmin")
FIGURES = {"diagnosis.html", "predictive.svg", "limits.svg", "residuals_by_angle.svg", "residual_harmonics.svg"}


def measured(column: str, count: int, seed: int = 3) -> PositionSet:
    """Positions of which the last `count`, alone in their group, are disturbed."""
    rows = 24 + count
    beta = np.where(np.arange(rows) >= 24, -60.0, BETA[:rows]) if column == "pitch" else BETA[:rows]
    force = np.asarray(gravity_in_head(np.radians(ALPHA[:rows]), np.radians(beta)))
    readings = force * [1.002, 0.999, 1.001] + [1e-3, -2e-3, 3e-3]
    readings += NOISE * np.random.default_rng(seed).normal(size=readings.shape)
    readings[24:] += FAULTS[:count]
    labels = ("A",) * 24 + ("B",) * count
    groups = {name: labels for name in ("mount", "run") if name == column}
    names = tuple(f"p{k}" for k in range(rows))
    return PositionSet(names, ALPHA[:rows], beta, readings, time_s=60.0 * np.arange(rows), **groups)


def checked(outcome, folder, excluded):
    assert outcome.code == 0 and not outcome.lines, outcome
    content = json.loads((folder / "diagnosis.json").read_text())
    assert {f"outlier_position:{name}" for name in excluded} <= {*content["causes"]}
    assert np.all(np.isfinite([content["gain"][f"cv_rms_{name}_g"] for name in ("before", "after")]))
    assert {path.name for path in folder.iterdir()} >= FIGURES
    return content


@pytest.mark.long
@pytest.mark.parametrize(
    ("column", "count"),
    [
        ("pitch", 2),
        pytest.param("mount", 1, marks=pytest.mark.long),
        pytest.param("pitch", 1, marks=pytest.mark.long),
        pytest.param("run", 2, marks=pytest.mark.long),
    ],
)
def test_a_group_without_positions_in_the_fit(tumblecal, tmp_path, column, count):
    data, file, out = measured(column, count), tmp_path / "data.csv", tmp_path / "out"
    write_positions(file, data)
    excluded = data.names[24:]
    content = checked(tumblecal("diagnose", file, *PRIORS, "--out", out), out, excluded)
    assert "leave one position out" in content["gain"]["cv_kind"]
    # Held out as well: nothing of the group has a prediction, so each other position is held out in turn.
    held_out = f"position={excluded[0]}" if column == "pitch" else f"{column}=B"
    content = checked(
        tumblecal("diagnose", file, *PRIORS, "--holdout", held_out, "--out", tmp_path / "held"),
        tmp_path / "held",
        excluded,
    )
    assert content["gain"]["cv_kind"].startswith("leave one position out, because the held-out positions are excluded")
    export = tumblecal("export", out / "calibration.json", "--to", "c-header", "--out", tmp_path / "c.h")
    assert export.code == 0, export
    assert tumblecal("calibrate", file, *PRIORS, "--out", tmp_path / "calibrated").code in (0, 3)


def test_a_parameter_of_excluded_positions_alone_is_not_determined(tumblecal, tmp_path):
    """The pitch error of the setting in the second run has no value. It costs neither the calibration nor its page."""
    data, file, out = measured("run", 1), tmp_path / "data.csv", tmp_path / "out"
    write_positions(file, data)
    content = checked(tumblecal("diagnose", file, "--out", out), out, data.names[24:])
    undetermined = [name for name, stated in content["parameters"].items() if stated["u"] is None]
    assert (
        undetermined
        == ["dbeta_1@run=B"]
        == [name for name, each in content["shifts"].items() if not each["determined"]]
    )
    assert '<td class="">not determined</td>' in (out / "diagnosis.html").read_text(encoding="utf-8")
    bias = json.loads((out / "calibration.json").read_text())["bias"]
    assert np.allclose(bias, [1e-3, -2e-3, 3e-3], atol=5e-4)

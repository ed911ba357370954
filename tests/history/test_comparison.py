"""Two calibrations compared: changes and their possible causes."""

import re
from dataclasses import replace

import numpy as np
import pytest
from test_history import RNG, covariance

from history_changes import NAMES
from tumblecal.data.calibration import Calibration, read_calibration, write_calibration
from tumblecal.data.sensor_parameters import SensorParameters, triad_of
from tumblecal.history.comparison import compare


def test_compare_tells_reference_from_triad_from_mounting():
    own = covariance()
    old = SensorParameters(NAMES, RNG.normal(size=12) * 1e-3, own)

    def moved(change):
        joint = compare(old, replace(old, values=old.values + np.array(change))).joint
        return {test.what for test in joint if test.moved}

    far = 1e-3
    assert moved(np.zeros(12)) == set()
    assert {"sensor as a whole", "common scale"} <= moved([far] * 3 + [0] * 9)
    assert "scale differences" not in moved([far] * 3 + [0] * 9)
    assert {"sensor as a whole", "scale differences"} <= moved([far, -far] + [0] * 10)
    assert moved([0] * 9 + [far] * 3) == {"mount"}
    assert {"sensor as a whole", "biases"} == moved([0] * 3 + [far] * 3 + [0] * 6)


def test_compare_s_tests_are_as_sure_as_they_say():
    own, root = covariance(), None
    root = np.linalg.cholesky(own)
    tails = []
    for _ in range(200):
        pair = [SensorParameters(NAMES, root @ RNG.normal(size=12), own) for _ in range(2)]
        tails.append([test.p_value for test in compare(*pair).joint])
    assert np.all(np.abs(np.mean(np.array(tails) < 0.1, axis=0) - 0.1) < 0.07)


@pytest.mark.parametrize(
    ("name", "lacks"), [("kalibr", "bias"), ("px4", "gamma"), ("ardupilot", "gamma"), ("csv", None)]
)
def test_compare_leaves_out_what_a_format_does_not_carry(tumblecal, tmp_path, name, lacks):
    """The file is of the same calibration: nothing has moved, whatever the format has no place for."""
    values = np.array([1e-3, -2e-3, 3e-3, 0.02, -0.03, 0.04, 5e-3, 6e-3, -7e-3])
    own = Calibration(np.linalg.inv(triad_of(values)), values[3:6], 1e-12 * np.eye(12))
    write_calibration(path := tmp_path / "own.json", own)
    tumblecal("export", path, "--to", name, "--out", tmp_path / "file")
    for pair in ([f"{name}:{tmp_path / 'file'}", path], [path, f"{name}:{tmp_path / 'file'}"]):
        outcome = tumblecal("compare", *pair)
        assert outcome.code == 0 and " yes " not in outcome.out, outcome.out
        rows = {line.split("_")[0] for line in outcome.out.splitlines() if re.match(r"(dK|bias|gamma)_", line)}
        assert rows == {"dK", "bias", "gamma"} - {lacks}
        tests = {"bias": "biases", "gamma": "non-orthogonality"}
        assert all((words in outcome.out) == (leaf != lacks) for leaf, words in tests.items())
        assert ("sensor as a whole" in outcome.out) == (lacks is None)
        assert outcome.out.count("not in table and tests") == (lacks is not None)


def test_another_gravity_is_told_by_what_it_moves(tumblecal, tmp_path, table1):
    """Of one place with two values scale factors of readings in m/s^2 move by as much as is said; of two places they do not."""
    for name, place, value in (("old", 9.80, 9.80), ("restated", 9.80, 9.81), ("elsewhere", 9.81, 9.81)):
        rows = zip(table1.names, table1.alpha_deg, table1.beta_deg, table1.readings * place, strict=True)
        lines = [f"{row},{alpha:g},{beta:g},{','.join(map(repr, own.tolist()))}" for row, alpha, beta, own in rows]
        header = f"# gravity_ms2: {value}\nposition,alpha_deg,beta_deg,ax_ms2,ay_ms2,az_ms2\n"
        (tmp_path / f"{name}.csv").write_text(header + "\n".join(lines) + "\n")
        tumblecal("calibrate", tmp_path / f"{name}.csv", "--no-figures", "-q", "--out", tmp_path / name)
    for name, change in (("restated", -0.00102), ("elsewhere", 0.0)):
        files = [tmp_path / own / "calibration.json" for own in ("old", name)]
        said = " ".join(tumblecal("compare", *files).lines)
        assert "If the site is the same, the new value changes all scale factors of readings in m/s^2 by -0.001" in said
        old, new = (read_calibration(file).sensor.of(["dK_x", "dK_y", "dK_z"]).values for file in files)
        np.testing.assert_allclose(new - old, change, atol=2e-6)

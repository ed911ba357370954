"""Every target by its own formula (tests/device_formulas.py) gives apply's numbers but for what was said to be lost."""

import json
import re
import shutil
import subprocess
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from device_formulas import FORMULAS, applied, numbers
from tumblecal.cli.commands.export import Format
from tumblecal.data.calibration import Calibration, write_calibration
from tumblecal.devices import TARGETS, Export, losses
from tumblecal.ground.gravity import Gravity


G = 9.8123
RNG = np.random.default_rng(8)
TERMS = [
    {"axis": "x", "coefficient": 1.2e-3, "powers": [2, 0, 0]},
    {"axis": "y", "coefficient": -0.7e-3, "powers": [1, 0, 1]},
    {"axis": "z", "coefficient": 0.4e-3, "powers": [0, 0, 3], "kind": "abs"},
    {"axis": "z", "coefficient": 0.1e-3, "powers": [0, 1, 0], "kind": "sign"},
    {"axis": "x", "coefficient": 2e-5, "powers": [0, 0, 0], "per_degc": True, "reference_degc": 20.0},
]
THERMAL = TERMS[-1:]


def unit(terms=(), *, dK=3e-3, bias=4e-3):
    lower = np.eye(3) + np.diag(RNG.uniform(-1, 1, 3) * dK) + np.tril(RNG.uniform(-1, 1, (3, 3)) * 2e-3, -1)
    return Calibration(
        matrix=np.linalg.inv(lower),
        bias=np.array([bias, -bias / 2, bias / 4]),
        covariance=np.eye(12) * 1e-12,
        gravity=Gravity(G, "stated"),
        serial_number="A-17",
        extra={"terms": list(terms)} if terms else {},
    )


def exported(name, calibration, span=None, **more):
    target = TARGETS[name]
    export = Export(target.carried(calibration, span, more.get("at_degc")), G, ("about",), span, **more)
    text = target.write(export)
    return text, losses(target, export, calibration, text)


def attitudes(count=500):
    f = RNG.normal(size=(count, 3))
    return f / np.linalg.norm(f, axis=1)[:, None]


@pytest.mark.parametrize("terms", [(), TERMS], ids=["linear", "extended"])
@pytest.mark.parametrize("name", [name for name in FORMULAS if name != "c-header" or shutil.which("cc")])
def test_the_target_s_formula_is_apply_s_but_for_what_was_said(name, terms):
    own = unit(terms)
    readings = attitudes() @ np.linalg.inv(own.matrix).T + own.bias
    degc = np.full(len(readings), 20.0)
    text, lost = exported(name, own)
    apart = np.max(np.abs(applied(name, text, readings, degc, G) - own.corrected(readings, degc))) * 1e3
    said = max((loss.mg for loss in lost if not loss.per), default=0.0)
    assert apart <= said * 1.02 + 2e-4, (apart, [str(loss) for loss in lost])
    assert apart >= said * 0.9 - 2e-4  # what is said is what happens, not a bound from far above
    carried = "terms" in TARGETS[name].carries
    assert (bool(terms) and not carried) == any("nonlinear" in loss.what for loss in lost)


@pytest.mark.parametrize("name", [name for name in FORMULAS if name != "c-header" or shutil.which("cc")])
def test_a_drift_is_a_loss_over_the_run_time(name):
    """Such calibrations were rejected. After 8 h the true force differs by the drift that the device does not know."""
    hourly = {"per_hour": True, "reference_s": 1800.0}
    drift = [
        {"axis": "x", "coefficient": 0.5e-3, "powers": [0, 0, 0], "effect": "d"} | hourly,
        {"axis": "y", "coefficient": 0.3e-3, "powers": [0, 1, 0], "effect": "k"} | hourly,
    ]
    plain = unit()
    own = replace(plain, extra={"terms": drift})
    force = np.concatenate([attitudes(2000), np.eye(3), -np.eye(3)])
    lower = np.linalg.inv(plain.matrix)
    inputs = force @ (lower / np.diag(lower)[:, None]).T
    readings = force @ lower.T + plain.bias + 8.0 * np.array([0.5e-3, 0.3e-3, 0]) * np.column_stack(
        [np.ones(len(force)), inputs[:, 1], np.zeros(len(force))]
    )  # fmt: skip
    text, lost = exported(name, own, run_s=8 * 3600.0)
    said = {loss.what: loss for loss in lost}
    assert said["drift (d), over 8 h"].mg == pytest.approx(4.0, rel=0.03) and not said["drift (d), over 8 h"].per
    error = 1e3 * np.max(np.abs(applied(name, text, readings, np.full(len(readings), 20.0), G) - force))
    assert 0.9 * max(loss.mg for loss in lost) < error < 1.03 * max(loss.mg for loss in lost)
    _, lost = exported(name, own)
    each = next(loss for loss in lost if loss.what == "drift (k)")
    assert each.mg == pytest.approx(0.3, rel=0.03) and str(each).endswith(" mg per h")


MAIN = """
#include <stdio.h>
#include "calibration.h"
int main(void) {
    double in[4]; TUMBLECAL_REAL a[3], f[3]; double out[3]; int i;
    while (fread(in, sizeof in, 1, stdin) == 1) {
        for (i = 0; i < 3; ++i) a[i] = (TUMBLECAL_REAL)in[i];
        tumblecal_apply(a, THERMAL f);
        for (i = 0; i < 3; ++i) out[i] = (double)f[i];
        fwrite(out, sizeof out, 1, stdout);
    }
    return 0;
}
"""


def run_in_c(folder, header, real, readings, degc=None):
    """What a header makes of readings and temperatures; it is compiled by strict rules, without a warning."""
    (folder / "calibration.h").write_text(header)
    (folder / "main.c").write_text(MAIN.replace("THERMAL", "" if degc is None else "(TUMBLECAL_REAL)in[3],"))
    strict = ["gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2", f"-DTUMBLECAL_REAL={real}"]
    subprocess.run([*strict, "main.c", "-o", "main"], cwd=folder, check=True)
    given = np.column_stack([readings, np.zeros(len(readings)) if degc is None else degc]).tobytes()
    return np.frombuffer(
        subprocess.run([folder / "main"], input=given, capture_output=True, check=True).stdout
    ).reshape(-1, 3)


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc to compile with")
@pytest.mark.parametrize(("real", "tolerance"), [("float", 4e-7), ("double", 2e-15)])
@pytest.mark.parametrize("terms", [(), TERMS], ids=["linear", "extended"])
def test_the_c_header_compiles_strictly_and_agrees_to_rounding(tmp_path, real, tolerance, terms):
    """A million samples of the linear one, up to 2 g; the extended one agrees where a sign does not turn by rounding."""
    own = unit(terms)
    count = 100_000 if terms else 1_000_000
    readings = RNG.uniform(-1.4, 1.4, (count, 3)).astype(np.float32).astype(float)
    degc = RNG.uniform(0, 50, count).astype(np.float32).astype(float)
    out = run_in_c(tmp_path, exported("c-header", own)[0], real, readings, degc if terms else None)
    expected = own.corrected(readings, degc)
    clear = np.abs(expected[:, 1]) > 0.01
    np.testing.assert_allclose(out[clear], expected[clear], rtol=0, atol=tolerance)


def test_export_on_the_command_line(tumblecal, tmp_path):
    own, path = unit(TERMS), tmp_path / "calibration.json"
    write_calibration(path, own)
    outcome = tumblecal("export", path, "--to", "px4", "--out", tmp_path / "unit.params")
    assert outcome.code == 0 and not outcome.lines
    assert re.search(r"lost: temperature: up to 0\.0(2|199)\d* mg per degC", outcome.out)
    assert set(get_args(Format)) == set(TARGETS)
    assert "lost: nonlinear terms: up to" in (tmp_path / "unit.params").read_text()
    comment = json.loads(tumblecal("export", path, "--to", "imucal").out)["comment"]
    assert "R^-1 K^-1 (A - b), m/s^2; lost: " in comment
    outcome = tumblecal("export", path, "--to", "imu_tk")
    assert len(outcome.out.split()) == 21 and any("lost: nonlinear" in line for line in outcome.lines)


def test_export_states_what_the_calibration_itself_lacks(tumblecal, tmp_path):
    """A term that is not determined alone, an effect without a term, and a range beyond that of the data."""
    bend = {"axis": "z", "coefficient": 3e-6, "powers": [0, 0, 0], "degc_power": 2, "reference_degc": 20.0}
    square = {
        "axis": "x",
        "coefficient": 1e-3,
        "powers": [0, 2, 0],
        "effect": "cross_axis_square.x",
        "determined": False,
    }
    loss = {"effect": "memory.y", "reason": "it depends on the position before", "largest_mg": 0.4, "rms_mg": 0.1}
    stated = {"temperature_range_degc": [-10.0, 50.0], "not_applied": ["memory.y"], "losses": [loss]}
    write_calibration(tmp_path / "calibration.json", replace(unit([bend, square]), provenance=stated))
    outcome = tumblecal("export", tmp_path / "calibration.json", "--to", "ardupilot", "--temperatures", "-20:50")
    said = "\n".join(outcome.lines)
    assert "not in this calibration: memory.y (up to 0.4 mg, 0.1 mg rms, it depends on the position before)" in said
    assert "not determined separately, so the correction is valid near 1 g: cross_axis_sq" in said
    assert (
        "the data cover -10 to 50 degC: in the rest of -20 to 50 degC the dependence on temperature is extrapolated"
        in said
    )
    assert re.search(r"lost: nonlinear terms \(cross_axis_square.x\): up to (0\.99\d*|1|1\.0\d*) mg", said)
    assert "lost: temperature" not in said  # the bend is in ACC2
    outcome = tumblecal("export", tmp_path / "calibration.json", "--to", "ros")
    assert re.search(
        r"lost: temperature, from -10 to 50 degC: up to 2\.(69|7)\d* mg\n", "\n".join(outcome.lines)
    )  # 3e-6 g 30^2


def test_kalibr_s_noise_is_that_of_the_noisiest_axis(tumblecal, tmp_path):
    path, reduction = tmp_path / "calibration.json", tmp_path / "reduction.json"
    write_calibration(path, unit())
    axes = {axis: {"noise": {"white_g_per_rthz": k * 1e-5, "walk_g_per_rts": 0.0}} for k, axis in enumerate("xyz", 1)}
    reduction.write_text(json.dumps({"axes": axes}))
    outcome = tumblecal("export", path, "--to", "kalibr", "--noise", reduction)
    assert numbers(outcome.out, "accelerometer_noise_density:", 1)[0] == pytest.approx(3e-5 * G)
    assert "not found in the recording" in outcome.out
    axes["y"]["noise"]["walk_g_per_rts"] = 2e-7
    reduction.write_text(json.dumps({"axes": axes}))
    outcome = tumblecal("export", path, "--to", "kalibr", "--noise", reduction)
    assert numbers(outcome.out, "accelerometer_random_walk:", 1)[0] == pytest.approx(2e-7 * G)

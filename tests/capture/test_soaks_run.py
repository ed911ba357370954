"""Whole runs over temperature: emulator, capture, a chamber on a pseudo-terminal, reduction."""

from pathlib import Path

import numpy as np
import pytest
from bench import CaptureProcess, Emulator

from tumblecal.capture.journal import read_journal, replayed
from tumblecal.data import read_positions
from tumblecal.estimation import default_chain
from tumblecal.recordings.reduce import reduced
from tumblecal.recordings.reduction import write_reduction


PLAN = """
[port]
url = "imu"
speed = 20.0
[positions]
beta_deg = [0]
alpha_deg = [0, 180]
temperature_degc = [25, 40, 25]
[dwell]
seconds = 3.0
settle_s = 1.0
[soak]
stable_min = 0.1
rate_degc_per_min = 4.0
tolerance_degc = 1.5
timeout_min = 5.0
[chamber]
url = "oven"
set_query = "SOUR:TEMP:SPO?"
"""
EMULATOR = f"""
rig = "{(Path(__file__).parents[2] / "configs" / "paper24.toml").resolve()}"
[effects]
"bias_temperature_cubic.x" = [0.1, 0.0, 2e-4]
"bias_temperature_quadratic.z" = [0.0, 0.01]
"scale_temperature.z" = [0.05]
[head]
turn_s = 1.0
reaction_s = 0.2
[chamber]
ramp_degc_per_min = 300.0
highest_degc = HIGHEST
[temperature]
die_lag_s = 4.0
thermometer_lag_s = 1.0
"""


@pytest.mark.long
def test_a_run_over_soaks_is_interrupted_resumed_and_reduced(tmp_path: Path) -> None:
    """The chamber does not accept 40 degC: two positions are stored, and the run goes on with a chamber that does."""
    (tmp_path / "plan.toml").write_text(PLAN)
    run, words = tmp_path / "run", ("--plain",)
    with Emulator(tmp_path, EMULATOR.replace("HIGHEST", "35.0"), follow="run", chamber="oven"):
        capture = CaptureProcess(tmp_path, "plan.toml", "--out", "run", *words)
        assert capture.close() == 2, capture.seen[-20:]
    fault = next(line for line in capture.seen if line.startswith("FAULT"))
    assert "chamber oven: the set point is 35 degC after 'SOUR:TEMP:SPO 40.0': correct its limits" in fault
    assert any("stable if, for 0.1 min, the sensor's temperature is within 1.5 degC" in line for line in capture.seen)
    before = replayed(read_journal(run))
    assert sorted(before.accepted) == [0, 1] and read_journal(run)[-1]["entry"] == "stopped"
    with Emulator(tmp_path, EMULATOR.replace("HIGHEST", "80.0"), follow="run", chamber="oven"):
        capture = CaptureProcess(tmp_path, "--resume", "run", "--yes", "--soak-minutes", "0.2", *words)
        assert capture.close() == 0, capture.seen[-20:]
    entries = read_journal(run)
    after = replayed(entries)
    assert entries[-1]["entry"] == "finished"
    assert all(after.accepted[k] == before.accepted[k] for k in before.accepted)
    soaks = [(e["requested_degc"], e["criterion"]["stable_min"]) for e in entries if e["entry"] == "soak"]
    assert soaks == [(25, 0.1), (40, 0.1), (40, 0.2), (25, 0.2)]
    write_reduction(reduced([run]), run)
    data = read_positions(run / "positions.csv")
    # One run, one clock, one pitch setting, and the order of the plan.
    assert data.run is None and data.clock is None and default_chain(data).names.count("dbeta_0") == 1
    assert data.time_s is not None and (np.diff(data.time_s) > 0).all() and data.temperature_degc is not None
    np.testing.assert_allclose(data.temperature_degc, np.repeat([25, 40, 25], 2), atol=1.6)
    # The effects of the temperature of the die, which the thermometer follows closely, against the last soak.
    d, up = data.temperature_degc - 25, np.array([1, -1] * 3)
    changes = np.stack([1e-3 * (0.1 * d + 2e-4 * d**3), up * 5e-5 * d + 1e-5 * d**2], axis=1)
    seen = data.readings[:, [0, 2]] - np.tile(data.readings[4:, [0, 2]], (3, 1))
    np.testing.assert_allclose(seen, changes - np.tile(changes[4:], (3, 1)), atol=1.5e-4)

"""Calibrations to be certified, and what a laboratory states."""

from dataclasses import replace
from pathlib import Path

import pytest

from tumblecal.data import write_positions


@pytest.fixture
def admin(tmp_path, configs):
    path = tmp_path / "admin.toml"
    text = (configs / "certificate_lab.toml").read_text()
    path.write_text(
        text.replace('model = "M-3"', 'model = "M-3"\nserial_number = "A-17"').replace("Sons", '<Sons> & \\"Co\\"')
    )
    return path


@pytest.fixture
def calibrated_as(tumblecal, tmp_path, table1):
    """Table 1 with its readings changed, calibrated with these options; whether it must not be used does not matter."""

    def made(added=0.0, *options) -> Path:
        comments = {"serial_number": "A-17", "gravity_ms2": "9.8123", "gravity_source": "gravimeter"}
        data = tmp_path / "positions.csv"
        write_positions(data, replace(table1, comments=comments, readings=table1.readings + added))
        assert tumblecal("calibrate", data, "--no-figures", "--out", tmp_path / "c", *options).code in (0, 3)
        return tmp_path / "c"

    return made


@pytest.fixture
def calibrated(calibrated_as):
    return calibrated_as(0.0, "--noise-sd", "0.1mg")

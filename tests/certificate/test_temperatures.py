"""Certificates of a calibration whose parameters follow temperature: values and uncertainties at stated temperatures."""

import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import numpy as np
import pytest
from dcc_schema import schema_of_dcc
from scipy.stats import t as student
from test_certificate import SPACES

from tumblecal.data.calibration import Calibration, write_calibration
from tumblecal.data.sensor_parameters import SENSOR, SensorParameters
from tumblecal.data.temperature_curves import Curve, Hysteresis, TemperatureCurves, order_of_covariance
from tumblecal.ground.gravity import Gravity
from tumblecal.ground.temperature_functions import TemperatureFunctions


G_MS2, DOF, HALF = 9.8123, 8, 3e-4
# bias_x = 1 mg + 0.1 mg/degC h - 2 ug/degC^2 h^2, h = T - 25 degC; sd of the three coefficients, g.
BIAS, SD = (1e-3, 1e-4, -2e-6), (2e-5, 1e-6, 3e-8)


@pytest.fixture
def folder(tmp_path):
    curve = Curve("bias_x", TemperatureFunctions(2, 25.0, (-10.0, 60.0)), np.array(BIAS[1:]))
    covariance = np.diag([*[1e-10] * 3, SD[0] ** 2, *[1e-10] * 5, SD[1] ** 2, SD[2] ** 2])
    curves = TemperatureCurves((curve,), covariance, order_of_covariance([curve]), (Hysteresis("bias_y", HALF, "g"),))
    values = np.zeros(9)
    values[3] = BIAS[0]
    calibration = Calibration(
        np.eye(3), values[3:6], np.zeros((12, 12)), serial_number="A-17", gravity=Gravity(G_MS2, "gravimeter"),
        parameters=SensorParameters(SENSOR, values, covariance[:9, :9]), temperature=curves, provenance={"dof": DOF},
    )  # fmt: skip
    write_calibration(tmp_path / "calibration.json", calibration)
    (tmp_path / "flat").mkdir()
    write_calibration(tmp_path / "flat" / "calibration.json", replace(calibration, temperature=None))
    return tmp_path


def truth(degc):
    """Value and expanded uncertainty of bias_x, g."""
    h = degc - 25.0
    sd = np.sqrt(SD[0] ** 2 + (SD[1] * h) ** 2 + (SD[2] * h**2) ** 2)
    return BIAS[0] + BIAS[1] * h + BIAS[2] * h**2, student.ppf(0.975, DOF) * sd


def test_values_are_stated_at_stated_temperatures(tumblecal, folder, admin, configs):
    limits = ["--limits", configs / "certificate_limits.toml"]
    outcome = tumblecal("certificate", folder, "--admin", admin, "--temperatures", "60,0,25", *limits)
    assert outcome.code == 0 and "values at 0, 25, 60 degC\n" in outcome.out
    results = ElementTree.parse(folder / "dcc.xml").getroot().findall(".//dcc:results/dcc:result", SPACES)
    page = (folder / "certificate.html").read_text()
    assert len(results) == 3
    for degc, result in zip((0.0, 25.0, 60.0), results, strict=True):
        temperature, quantity = result.findall("dcc:data/dcc:quantity", SPACES)
        assert temperature.findtext("si:real/si:value", namespaces=SPACES) == repr(degc)
        reals = quantity.findall("si:list/si:realList/si:real", SPACES)
        value, expanded = truth(degc)
        real = reals[SENSOR.index("bias_x")]
        assert float(real.findtext("si:value", namespaces=SPACES)) == pytest.approx(value * G_MS2, rel=1e-12)
        stated = float(real.findtext("si:expandedUnc/si:uncertainty", namespaces=SPACES))
        assert stated == pytest.approx(expanded * G_MS2, rel=1e-6)
        # Noise of 10 ug with 8 degrees of freedom and a uniform half-width of 300 ug: Welch and Satterthwaite.
        u = np.hypot(1e-5, HALF / np.sqrt(3))
        k = student.ppf(0.975, DOF * (u / 1e-5) ** 4)
        stated = float(reals[SENSOR.index("bias_y")].findtext("si:expandedUnc/si:uncertainty", namespaces=SPACES))
        assert stated == pytest.approx(k * u * G_MS2, rel=1e-6)
        assert f"<h2>Values at {degc:g} degC</h2>" in page and f"{1e3 * value:.6f}</td>" in page
    assert "are valid at 0, 25 and 60 degC: bias_x changes with temperature, measured from -10 to 60 degC." in page
    assert "half of the difference between rising and falling temperature, as a uniform distribution" in page
    if (schema := schema_of_dcc()) is not None:
        schema.validate(str(folder / "dcc.xml"))


@pytest.mark.parametrize(
    ("of", "text", "words"),
    [
        (".", "25,61", "--temperatures: 61 degC is outside the measured -10 to 60 degC of "),
        (".", "25;30", "write numbers, such as 0,25,60"),
        ("flat", "25", "flat/calibration.json: its parameters do not follow temperature; remove --temperatures"),
    ],
)
def test_temperatures_that_cannot_be_certified(tumblecal, folder, admin, of, text, words):
    outcome = tumblecal("certificate", folder / of, "--admin", admin, "--temperatures", text)
    assert outcome.code == 2 and len(outcome.lines) == 1 and words in outcome.lines[0]
    assert not (folder / of / "dcc.xml").exists()

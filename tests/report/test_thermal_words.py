"""Words and the loops of hysteresis of a calibration over temperature, from records made by hand."""

from pathlib import Path
from types import SimpleNamespace as Record

import numpy as np
import polars as pl

from tumblecal.data.calibration_use import Use
from tumblecal.data.sensor_parameters import SENSOR, SensorParameters
from tumblecal.ground.temperature_functions import TemperatureFunctions
from tumblecal.recordings.thermal.thermal_table import ThermalTable
from tumblecal.show.figures import thermal
from tumblecal.show.thermal import words_of_thermal
from tumblecal.thermal.result import FoundSignal


DEGC = np.repeat([0.0, 20.0, 40.0, 60.0], 4)
FUNCTIONS = {
    "bias": TemperatureFunctions(3, 25.0, (0.0, 60.0)),
    "dK": TemperatureFunctions(3, 25.0, (0.0, 60.0), (20.0, 40.0)),
}


def table(directions=(1, -1), attitudes=6, branches=("1", "2")):
    """Soaks of 0 to 60 degC, in these directions."""
    rows = len(DEGC)
    columns = {"position": np.resize([f"a{k}" for k in range(attitudes)], rows), "branch": np.resize(branches, rows)}
    columns |= {"run": ["1"] * rows, "temperature_degc": DEGC, "time_s": 60.0 * np.arange(rows)}
    columns |= {"direction": np.zeros(rows, int), "reached_by": np.resize(directions, rows)}
    return ThermalTable(pl.DataFrame(columns), "bench/x.csv and 1 more")


SENSORS = SensorParameters(SENSOR, np.zeros(len(SENSOR)), np.zeros((len(SENSOR),) * 2))


def part(label, before=2.1, after=0.21, noise=0.1):
    return Record(label=label, rows=8, before_mg=before, after_mg=after, noise_mg=noise)


def signal(name, unit="g", coefficients=(1e-4, 2e-4, 3e-4)):
    names = "xyz" if len(coefficients) == 3 else [""]
    sizes = dict(zip(names, coefficients, strict=True))
    sd = {component: size / 10 for component, size in sizes.items()}
    return FoundSignal(name, unit, sizes, sd, np.array([6.7e-4, 4.7e-4, 3.3e-4]), ())


def choice(**more):
    own = {"orders": {"bias": 3, "dK": 3}, "highest": {"bias": 3, "dK": 3, "gamma": 3}, "forced": {}, "dropped": ()}
    own |= {
        "of_temperature": (),
        "unseparated": (),
        "inseparable": (),
        "constant_criterion": 30.0,
        "criterion": 10.0,
        "model": Record(functions=FUNCTIONS, signals=(), fixed={}, free=("dK", "bias", "gamma")),
    }
    return Record(**(own | more))


def result(**more):
    own = {
        "calibration": Record(
            use=Use("within", "", (0.0, 60.0), expanded_g=4e-4), serial_number="A-17", sensor=SENSORS
        ),
        "undetermined": (),
        "reference_degc": 25.0,
        "table": table(),
        "curves": (1,),
        "held_out": (),
        "between": (),
        "choice": choice(),
        "signals": (),
        "combinations": (),
        "coefficients": {},
        "noise_factor": 1.0,
    }
    return Record(**(own | more))


def test_each_finding_is_in_a_text(snapshot):
    """Lines of earlier cases are not repeated."""
    directions = (part("rising temperature", 2.0, 0.3), part("falling temperature", 1.8, 0.2))
    history = ("hysteresis", "temperature_lag", "temperature_rate")
    cases = {
        "held-out parts": result(held_out=(part("a"), part("b", 1.0, 0.1)), between=(part("file 2"),), noise_factor=1.5),
        "directions with signals": result(
            held_out=directions, signals=(signal("hysteresis"), signal("temperature_lag", "s", (310.0,)), signal("drift"))
        ),
        "nothing found": result(curves=None, held_out=(part("a", 0.2, 0.2),), choice=choice(orders={}, forced={"dK": 0})),
        "no rows held out": result(choice=choice(dropped=("gamma",), highest={"bias": 2, "dK": 1}, forced={"bias": 3})),
        "one direction": result(
            table=table((1,), branches=("1",)), choice=choice(of_temperature=history, unseparated=history)
        ),
        "no direction": result(table=table((0,)), choice=choice(of_temperature=history[:1])),
        "one rate": result(choice=choice(unseparated=history)),
        "one attitude": result(
            table=table(attitudes=1), choice=choice(inseparable=("dK", "gamma", "dtheta")),
            combinations=("bias_x - 0.98 dtheta_y",), undetermined=("gamma",),
        ),
        "refused": result(calibration=Record(use=Use("no", "systematic residuals"), serial_number="", sensor=SENSORS)),
    }  # fmt: skip
    texts, seen = dict[str, str](), set[str]()
    for title, own in cases.items():
        words = words_of_thermal(own, Path("unit17"))
        tables = [" | ".join(cells) for name in ("title", "lead", "orders") for cells in words.blocks[name]]
        lines = [*words.verdict.words().splitlines(), *tables]
        texts[title] = "\n".join(line for line in lines if line not in seen)
        seen |= {*lines}
    snapshot("thermal", texts)


def test_the_loop_of_hysteresis_has_the_means_of_each_direction_and_the_fitted_branches(monkeypatch):
    """Half of 1.2 mg on x: rows of rising temperature are above those of falling."""
    own = result(table=table((1, -1)))
    half = np.array([0.6e-3, 0.0, -0.3e-3])
    shape = own.table.reached_by[:, None] * np.ones(3)
    given = Record(up_to=lambda order: np.array([shape * axis for axis in np.eye(3)]))
    own.choice.model.signals = ((given, 1),)
    own.signals = (FoundSignal("hysteresis", "g", dict(zip("xyz", half, strict=True)), {}, np.abs(half), ()),)
    noise = 1e-5 * np.random.default_rng(2).normal(size=shape.shape)
    monkeypatch.setattr(thermal, "after_correction", lambda _: shape * half + noise)
    figure = thermal.hysteresis_figure(own)
    assert [panel.get_title() for panel in figure.axes] == ["x", "y", "z"]
    for panel, size in zip(figure.axes, (0.6, 0.0, -0.3), strict=True):
        lines = [line for line in panel.lines if len(line.get_xdata()) == 4]
        rising, falling = (np.asarray(line.get_ydata()) for line in lines[:2])
        np.testing.assert_allclose([rising, falling], [[size] * 4, [-size] * 4], atol=1e-9)
        np.testing.assert_array_equal(lines[0].get_xdata(), [0, 20, 40, 60])

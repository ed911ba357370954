"""Calibration over temperature from bins of an independent simulator (numpy, not the chain)."""

import numpy as np
import pytest

from thermal_instrument import Programme, attitudes, history, instrument, means, memory_of, truth
from tumblecal.capture.thermal.thermal_table import table_of
from tumblecal.data.calibration import Calibration
from tumblecal.data.sensor_parameters import SENSOR, SensorParameters
from tumblecal.ground.errors import InputError
from tumblecal.thermal.choice import Stated, chosen_model
from tumblecal.thermal.held_out import between_recordings
from tumblecal.thermal.hysteresis import forms_of
from tumblecal.thermal.orders import Search, chains_of
from tumblecal.thermal.result import thermal_calibration


CYCLE = Programme(-10.0, ((60.0, 1.0), (-10.0, 1.0)))


def table(seed, count, programme=CYCLE, *, unit=None, more=None, **orders):
    rng = np.random.default_rng(seed)
    unit = instrument(rng, **orders) if unit is None else unit
    forces = attitudes(rng, count)
    return unit, forces, table_of(**means(rng, unit, forces, programme, **({"bins": 24} | (more or {}))))


@pytest.mark.parametrize(("seed", "bias", "scale"), [(1, 3, 1), (2, 2, 0), (3, 5, 2)])
def test_six_attitudes_give_orders_curves_and_the_improvement(seed, bias, scale):
    unit, _, data = table(seed, 6, bias_order=bias, scale_order=scale)
    result = thermal_calibration(data)
    assert result.choice.orders == {"bias": bias, **({"dK": scale} if scale else {})}
    assert result.undetermined == ("gamma",)
    assert result.calibration.use.answer == "only"
    degc = np.linspace(*data.range_degc, 9)
    changes = truth(unit, degc) - truth(unit, [25.0])
    sd = np.sqrt(result.curves.sd(degc) ** 2 + 1e-14)
    assert np.max(np.abs(result.curves.at(degc) - changes)[:, 3:6] / 1e-3) < 0.05  # mg
    assert np.all(
        np.abs(result.calibration.sensor.of(SENSOR).values + result.curves.at(degc) - truth(unit, degc)) < 5 * sd
    )
    for part in result.held_out:
        assert part.after_mg < 1.15 * part.noise_mg < part.before_mg


def test_ten_attitudes_determine_all_parameters_and_a_corrected_reading_is_exact():
    unit, forces, data = table(4, 10, bias_order=2, scale_order=2, cross_order=1)
    result = thermal_calibration(data)
    assert result.choice.orders == {"bias": 2, "dK": 2, "gamma": 1}
    assert result.calibration.use.answer == "yes"
    corrected = result.calibration.corrected(data.readings, data.temperature_degc)
    size = np.linalg.norm(corrected, axis=1)
    assert np.sqrt(np.mean((size - 1) ** 2)) < 1.15 * 0.03e-3
    del unit, forces


def test_one_attitude_determines_changes_only_and_names_their_combination():
    unit, _, data = table(5, 1, bias_order=3, scale_order=0)
    result = thermal_calibration(data)
    assert result.calibration.use.answer == "no"
    assert "--calibration" in result.calibration.use.reason
    assert result.combinations[2].startswith("bias_z + 1.00 dK_z")
    degc = np.linspace(*data.range_degc, 7)
    change = (truth(unit, degc) - truth(unit, [25.0]))[:, 3:6]
    assert np.max(np.abs(result.curves.at(degc)[:, 3:6] - change)) < 0.04e-3
    known = SensorParameters(SENSOR, truth(unit, [25.0])[0], np.diag(np.full(9, 1e-10)))
    base = Calibration(np.eye(3), np.zeros(3), np.zeros((12, 12)), parameters=known)
    complete = thermal_calibration(data, Stated(base=base))
    assert complete.calibration.use.answer == "only"
    assert "included in that of the bias" in complete.calibration.use.reason
    assert np.allclose(complete.calibration.sensor.of(SENSOR).values, known.values)
    assert np.all(complete.curves.sd(np.array([25.0]))[0] >= 0.99e-5)


def test_hysteresis_is_found_stated_and_part_of_the_uncertainty():
    unit, _, data = table(6, 6, bias_order=1, hysteresis_mg=0.6)
    result = thermal_calibration(data)
    (found,) = [signal for signal in result.signals if signal.name == "hysteresis"]
    assert np.allclose(found.half_width, np.abs(unit.hysteresis), rtol=0.25)
    stated = {part.parameter: part.half_width for part in result.curves.hysteresis}
    assert stated == {f"bias_{axis}": pytest.approx(size) for axis, size in zip("xyz", found.half_width, strict=True)}


EIGHT_SOAKS = Programme(-10.0, tuple((degc, 2.0) for degc in [*range(0, 61, 10), *range(50, -11, -10)]), soak_min=20.0)


@pytest.mark.parametrize(("width", "programme"), [(20.0, CYCLE), (0.0, EIGHT_SOAKS)], ids=["play", "ellipse"])
def test_a_loop_of_hysteresis_is_no_evidence_for_an_order(width, programme):
    _, _, data = table(21, 12, programme, bias_order=2, scale_order=0, hysteresis_mg=0.3, more={"width": width})
    choice = chosen_model(data, Stated())
    assert choice.orders["bias"] == 2
    assert "hysteresis" in choice.orders and "dK" not in choice.orders


def test_the_memory_of_a_loop_follows_the_history_of_the_temperature():
    _, _, data = table(22, 1, more={"noise_mg": 1e-9, "bins": 40})
    _, degc, _ = history(CYCLE, 10.0)
    rising = np.arange(len(degc)) <= np.argmax(degc)
    width = np.ptp(data.temperature_degc) / 4
    state = memory_of(degc, width)
    shape = forms_of(data)["hysteresis_memory"][0]
    for sign, part in ((1, rising), (-1, ~rising)):
        rows = np.asarray(data.reached_by) == sign
        order = np.argsort(degc[part])
        exact = np.interp(data.temperature_degc[rows], degc[part][order], state[part][order])
        # The place of the reversal is known within half of a bin.
        assert np.max(np.abs(shape[rows] - exact)) < 70 / 40 / width


def test_a_lag_of_the_thermometer_is_fitted_in_seconds():
    rates = Programme(-10.0, ((60.0, 2.0), (-10.0, 0.5), (60.0, 1.0)))
    _, _, data = table(7, 6, rates, bias_order=2, scale_order=1, more={"lag_s": 40.0, "noise_mg": 0.01})
    result = thermal_calibration(data)
    (found,) = result.signals
    assert found.name == "lag"
    assert found.coefficients[0] == pytest.approx(40.0, abs=4 * found.sd[0] + 0.5)
    assert result.choice.orders["bias"] == 2


def test_one_cycle_at_one_rate_cannot_separate_hysteresis_from_rate():
    _, _, data = table(8, 6, bias_order=1, more={"rate_effect": 0.02})
    choice = chosen_model(data, Stated())
    (name,) = choice.not_separated
    assert {name, *choice.not_separated[name]} >= {"hysteresis", "rate"}


def test_soaks_limit_the_order():
    soaks = Programme(0.0, ((25.0, 2.0), (50.0, 2.0)), soak_min=20.0)
    _, _, data = table(9, 9, soaks, bias_order=1, low=0.0, high=50.0)
    assert thermal_calibration(data).choice.highest["bias"] == 2
    with pytest.raises(
        InputError, match="3 different temperatures cannot determine order 3 of bias; the highest order is 2"
    ):
        thermal_calibration(data, Stated(orders={"bias": 3}))


def test_orders_and_knots_that_are_stated_are_used():
    _, _, data = table(10, 6, bias_order=1)
    result = thermal_calibration(
        data, Stated(orders={"bias": 2, "dK": 0}, knots_degc={"gamma": (20.0,)}, reference_degc=20.0)
    )
    functions = result.choice.model.functions
    assert functions["bias"].order == 2
    assert functions["gamma"].knots_degc == (20.0,)
    assert "dK" not in functions and result.choice.inseparable == ()
    assert result.calibration.temperature_degc == 20.0


def test_one_temperature_is_rejected():
    columns = means(
        np.random.default_rng(1), instrument(np.random.default_rng(1)), attitudes(np.random.default_rng(1), 6), CYCLE
    )
    columns["temperature_degc"] = 20.0 + 1e-3 * columns["temperature_degc"]
    with pytest.raises(InputError, match="which is one temperature; record a ramp"):
        thermal_calibration(table_of(**columns))


def test_two_attitudes_at_one_temperature_each_determine_no_change():
    """As of a cold and a hot recording with a movement between them: the slope was that of the movement."""
    rng = np.random.default_rng(3)
    cold, hot = 10 + np.linspace(0, 0.3, 8), 50 + np.linspace(0, 0.3, 8)
    force = np.repeat([[0, 0, 1.0], [0, 0.6, 0.8]], 8, axis=0)
    names, degc = ["cold"] * 8 + ["hot"] * 8, np.concatenate([cold, hot])
    rows = table_of(names, force + 1e-4 * rng.normal(size=force.shape), 1e-4, degc, clock=names)
    with pytest.raises(InputError, match=r"each attitude has one temperature \(cold 10\.[12] degC, hot 50\.1 degC\)"):
        chosen_model(rows, Stated())


def test_a_cold_recording_predicts_a_hot_one_by_its_extrapolation():
    """A linear bias: the prediction is as good as its slope; without it, the error is the change of the bias."""
    rng = np.random.default_rng(5)
    degc = np.linspace(0.0, 60.0, 40)
    names = np.where(degc < 35, "cold", "hot")
    readings = [0, 0, 1] + np.outer(degc, [1e-4, 0, 0]) + 2e-5 * rng.normal(size=(40, 3))
    rows = table_of(["a1"] * 40, readings, 2e-5, degc, clock=names.tolist(), direction=1)
    parts = between_recordings(chosen_model(rows, Stated()))
    hot = next(part for part in parts if part.label.startswith("hot, 35"))
    assert "from the other recordings, 0.0 to 33.8 degC" in hot.label and hot.rows == 17
    assert hot.after_mg < 0.1 < 1.0 < hot.before_mg


def test_the_calibration_file_has_the_curves(tmp_path):
    from tumblecal.data.calibration import read_calibration, write_calibration

    _, _, data = table(11, 6, bias_order=2)
    made = thermal_calibration(data).calibration
    assert isinstance(made, Calibration)
    write_calibration(tmp_path / "calibration.json", made)
    read = read_calibration(tmp_path / "calibration.json")
    assert np.array_equal(
        read.corrected(data.readings, data.temperature_degc), made.corrected(data.readings, data.temperature_degc)
    )


def test_a_difference_between_branches_is_not_chosen_if_there_is_one_branch():
    _, _, data = table(12, 6, bias_order=2, hysteresis_mg=0.3)
    choice = chosen_model(data, Stated())
    rising = np.asarray(data.reached_by) > 0
    search = Search(choice.design.part(rising), chains_of(data.rows(rising)))
    assert np.isinf(search.criterion({"hysteresis": 1}))
    assert np.isfinite(Search(choice.design, chains_of(data)).criterion({"hysteresis": 1}))

"""Calibration over temperature from bins of an independent simulator (numpy, not the chain)."""

from dataclasses import replace

import numpy as np
import pytest

from thermal_bench import table_of
from thermal_instrument import Programme, Unit, attitudes, instrument, means, readings, soak_means, truth
from tumblecal.data.calibration import Calibration
from tumblecal.data.sensor_parameters import SENSOR, SensorParameters
from tumblecal.ground.errors import InputError
from tumblecal.thermal.choice import chosen_model
from tumblecal.thermal.held_out import between_recordings
from tumblecal.thermal.result import thermal_calibration
from tumblecal.thermal.stated import Stated


CYCLE = Programme(-10.0, ((60.0, 1.0), (-10.0, 1.0)))


def table(seed, count, programme=CYCLE, *, unit=None, more=None, **orders):
    rng = np.random.default_rng(seed)
    unit = instrument(rng, **orders) if unit is None else unit
    forces = attitudes(rng, count)
    return unit, forces, table_of(**means(rng, unit, forces, programme, **({"bins": 24} | (more or {}))))


@pytest.mark.parametrize(
    ("seed", "bias", "scale"),
    [(1, 3, 1), *(pytest.param(*own, marks=pytest.mark.long) for own in ((2, 2, 0), (3, 5, 2)))],
)
def test_six_attitudes_give_orders_curves_and_the_improvement(seed, bias, scale):
    unit, _, data = table(seed, 6, bias_order=bias, scale_order=scale)
    result = thermal_calibration(data)
    assert result.choice.orders == {"bias": bias, **({"dK": scale} if scale else {})}
    assert result.undetermined == ("gamma",)
    use = result.calibration.use
    assert (
        use.answer == "within" and use.expanded_g > 2 * 5e-3 and "the non-orthogonality at the reference" in use.reason
    )
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
    _, _, data = table(4, 10, bias_order=2, scale_order=2, cross_order=1)
    result = thermal_calibration(data)
    assert result.choice.orders == {"bias": 2, "dK": 2, "gamma": 1}
    assert result.calibration.use.answer == "within" and result.calibration.use.reason == ""
    assert 0.02e-3 < result.calibration.use.expanded_g < 0.3e-3
    corrected = result.calibration.corrected(data.readings, data.temperature_degc)
    size = np.linalg.norm(corrected, axis=1)
    assert np.sqrt(np.mean((size - 1) ** 2)) < 1.15 * 0.03e-3


@pytest.mark.long
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
    use = complete.calibration.use
    assert use.answer == "within" and "the change of the scale factor" in use.reason
    # 1e-4 / degC over a half of the range.
    assert 2 * 1e-4 * 35 < use.expanded_g < 7 * 1e-4 * 35
    assert np.allclose(complete.calibration.sensor.of(SENSOR).values, known.values)
    assert np.all(complete.curves.sd(np.array([25.0]))[0] >= 0.99e-5)


def test_hysteresis_is_found_stated_and_part_of_the_uncertainty():
    unit, _, data = table(6, 6, bias_order=1, hysteresis_mg=0.6)
    result = thermal_calibration(data)
    (found,) = [signal for signal in result.signals if signal.name == "hysteresis"]
    assert np.allclose(found.half_width_g, np.abs(unit.hysteresis), rtol=0.25)
    stated = {part.parameter: part.half_width for part in result.curves.hysteresis}
    assert stated == {f"bias_{axis}": pytest.approx(size) for axis, size in zip("xyz", found.half_width_g, strict=True)}


@pytest.mark.long
def test_a_lag_of_the_thermometer_is_fitted_in_seconds():
    rates = Programme(-10.0, ((60.0, 2.0), (-10.0, 0.5), (60.0, 1.0)))
    _, _, data = table(7, 6, rates, bias_order=2, scale_order=1, more={"lag_s": 40.0, "noise_mg": 0.01})
    result = thermal_calibration(data)
    (found,) = result.signals
    assert found.name == "temperature_lag" and found.not_separated_from == ()
    assert result.choice.unseparated == ()
    (lag_s,), (sd,) = found.coefficients.values(), found.sd.values()
    assert lag_s == pytest.approx(40.0, abs=4 * sd + 0.5)
    assert result.choice.orders["bias"] == 2


def test_one_cycle_at_one_rate_cannot_separate_hysteresis_from_rate():
    _, _, data = table(8, 6, bias_order=1, more={"rate_effect": 0.02})
    choice = chosen_model(data, Stated())
    every = ("hysteresis", "temperature_lag", "temperature_rate")
    assert {*choice.orders} & {*every} and choice.unseparated == every and choice.of_temperature == ()


@pytest.mark.long
def test_one_direction_separates_no_effect_of_the_history_and_its_usual_size_is_in_the_intervals():
    _, _, data = table(8, 6, Programme(-10.0, ((60.0, 1.0),)), bias_order=1)
    result = thermal_calibration(data)
    every = ("hysteresis", "temperature_lag", "temperature_rate")
    assert result.choice.of_temperature == result.choice.unseparated == every
    span = np.ptp(result.curves.at(np.linspace(*result.curves.range_degc, 3))[:, 3:6], axis=0)
    for part, size in zip(result.curves.hysteresis, span, strict=True):
        assert part.not_separated_from == every and part.half_width == pytest.approx(0.05 * size, rel=0.05)


FAST = Programme(-10.0, ((60.0, 10.0), (-10.0, 10.0)))


@pytest.mark.long
def test_residuals_of_a_part_of_the_hysteresis_are_in_u_and_do_not_contradict_the_model():
    """At one rate the middle between branches with a difference of 7 mg is not known to 0.03 mg, the noise."""
    unit, _, data = table(13, 6, FAST, bias_order=3, more={"rate_effect": 0.02})
    result = thermal_calibration(data)
    assert result.choice.orders["bias"] < 3 and result.noise_factor > 3
    assert result.calibration.use.answer == "within"
    _, corrected = errors(unit, result, -9.0, 59.0)
    assert np.max(np.abs(corrected)) < result.calibration.use.expanded_g


FACES = np.concatenate([np.eye(3), -np.eye(3)])
EDGES = np.array([(1, 1, 0), (1, -1, 0), (0, 1, 1), (0, 1, -1), (1, 0, 1), (-1, 0, 1)]) / np.sqrt(2)


def soaked(seed, faces, soaks):
    """Faces set by hand at soaks, a row each: the numbers of a published six-face calibration in a refrigerator."""
    rng = np.random.default_rng(seed)
    constants = np.array([5e-3, -3e-3, 8e-3, 20e-3, -12e-3, 35e-3, 2e-3, -4e-3, 3e-3])
    half, changes = 12.0, np.zeros((9, 5))
    changes[:6, 0] = half * np.array([150e-6, -100e-6, 80e-6, 0.3e-3, -0.2e-3, 0.5e-3])
    unit = Unit(constants, changes, np.zeros(3), 14.0, 38.0)
    return unit, table_of(**soak_means(rng, unit, faces, soaks, noise_mg=0.5, tilt_deg=4.0))


def errors(unit, result, low=14.5, high=37.5):
    """Errors of raw and corrected readings at new attitudes and temperatures, g."""
    rng = np.random.default_rng(5)
    force, degc = rng.normal(size=(60, 3)), rng.uniform(low, high, 60)
    force /= np.linalg.norm(force, axis=1)[:, None]
    raw = readings(unit, force, degc)
    return raw - force, result.calibration.corrected(raw, degc) - force


@pytest.mark.long
@pytest.mark.parametrize(
    ("faces", "soaks", "answer"),
    [
        (FACES, (14.0, 38.0), "not tested"),
        (FACES, (14.0, 26.0, 38.0), "within"),
        pytest.param(np.concatenate([FACES, EDGES]), (14.0, 38.0), "within", marks=pytest.mark.long),
    ],
    ids=["six, two", "six, three", "twelve, two"],
)
def test_faces_at_soaks_in_files_of_their_own(faces, soaks, answer):
    unit, data = soaked(3, faces, soaks)
    result = thermal_calibration(data)
    use, sensor = result.calibration.use, result.calibration.sensor.of(SENSOR)
    assert use.answer == answer
    assert np.all(np.abs(sensor.values - truth(unit, [25.0])[0]) < 3 * sensor.sd)
    degc = np.array([15.0, 37.0])
    error = (result.curves.at(degc) - truth(unit, degc) + truth(unit, [25.0]))[:, :6] / result.curves.sd(degc)[:, :6]
    assert np.sqrt(np.mean(error**2)) < 2
    low, high = result.calibration.provenance["temperature_range_degc"]
    assert low <= data.temperature_degc.min() and data.temperature_degc.max() <= high
    raw, corrected = errors(unit, result)
    assert np.sqrt(np.mean(corrected**2)) < 0.2 * np.sqrt(np.mean(raw**2))
    if answer == "within":
        assert np.max(np.abs(corrected)) < use.expanded_g < 12e-3


@pytest.mark.long
def test_data_that_contradict_the_model_are_not_for_use():
    rng = np.random.default_rng(9)
    unit = replace(instrument(rng, bias_order=1, scale_order=0), square=np.array([1e-3, -1e-3, 0.5e-3]))
    _, _, data = table(9, 12, unit=unit, more={"bins": 8})
    use = thermal_calibration(data).calibration.use
    assert use.answer == "no" and use.reason.startswith("the data contradict the model")


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


@pytest.mark.long
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

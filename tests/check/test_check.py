"""A calibration checked by attitudes of a numpy triad; expected values in closed form: the size of gravity and its Jacobian."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2, ncx2

from tumblecal import InputError
from tumblecal.check.consistency import LEVEL
from tumblecal.check.drift import no_noise, noise_of_history, stated_noise
from tumblecal.check.gravity import local_size
from tumblecal.check.result import Model, check
from tumblecal.check.update import updated
from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_use import Use
from tumblecal.data.positions import PositionSet, attitudes_of
from tumblecal.data.sensor_parameters import SENSOR, SensorParameters, correction_slope
from tumblecal.data.temperature_curves import Curve, Hysteresis, TemperatureCurves, order_of_covariance
from tumblecal.ground.gravity import Gravity
from tumblecal.ground.temperature_functions import TemperatureFunctions
from tumblecal.history.entry import Entry


FILE = Path("calibration.json")
SD = 1e-4
UP = np.array(
    [[1, 0.1, 0], [-1, 0, 0.1], [0, 1, 0.05], [0.1, -1, 0], [0, 0.05, 1], [0.1, 0.1, -1],
     [1, 1, 0], [0, 1, 1], [1, 0, -1], [1, 1, 1]]
)  # fmt: skip
UP = UP / np.linalg.norm(UP, axis=1)[:, None]
VALUES = np.array([1e-3, -2e-3, 0.5e-3, 3e-3, -1e-3, 2e-3, 1e-3, -0.5e-3, 0.7e-3])
SD_OF = np.array([5e-5] * 3 + [6e-5] * 3 + [8e-5] * 3)


def triad(p):
    return np.diag(1 + p[:3]) @ np.array([[1, 0, 0], [p[6], 1, 0], [p[7], p[8], 1.0]])


def covariance():
    mixed = np.eye(9) + 0.3 * np.sin(np.arange(81.0)).reshape(9, 9)
    root = mixed / np.linalg.norm(mixed, axis=1)[:, None] * SD_OF[:, None]
    return root @ root.T


def calibration(**more):
    slope = correction_slope(VALUES)
    more = {"provenance": {"dof": None, "sigma_g": SD}, "use": Use("yes")} | more
    more = {"parameters": SensorParameters(SENSOR, VALUES, covariance())} | more
    return Calibration(np.linalg.inv(triad(VALUES)), VALUES[3:6], slope @ covariance() @ slope.T, **more)


def by_hand(values, noise=None, up=UP, **more):
    """Readings in unknown attitudes of a triad with these parameters."""
    readings = up @ triad(values).T + values[3:6] + (0 if noise is None else noise)
    alpha, beta = attitudes_of(readings)
    names = tuple(f"p{k + 1}" for k in range(len(up)))
    more = {"comments": {"attitudes": "unknown"}, "sd": np.full(readings.shape, SD)} | more
    return PositionSet(names, alpha, beta, readings, **more)


def sizes(data, values):
    """Size of the corrected readings less 1 g, and its derivative by the parameters (central differences)."""

    def size(p):
        return np.linalg.norm((data.readings - p[3:6]) @ np.linalg.inv(triad(p)).T, axis=1)

    slope = [(size(values + step) - size(values - step)) / 2e-6 for step in 1e-6 * np.eye(9)]
    return size(values) - 1, -np.stack(slope, axis=1)


def noise(seed):
    return SD * np.random.default_rng(seed).normal(size=UP.shape)


def of_units(change, count):
    """p-values of units of which the calibration has an error drawn from its covariance, and the first result."""
    rng, root, results = np.random.default_rng(5), np.linalg.cholesky(covariance()), []
    for _ in range(count):
        data = by_hand(VALUES + root @ rng.normal(size=9) + change, SD * rng.normal(size=UP.shape))
        results.append(check(calibration(), FILE, data))
    return np.array([result.test.p_value for result in results]), results[0]


def test_statistic_is_that_of_the_size_of_gravity():
    """T^2 and the rest together: r' (H P H' + R)^-1 r in the nine directions, and one attitude more than parameters."""
    data = by_hand(VALUES, noise(1))
    result = check(calibration(), FILE, data)
    excess, slope = sizes(data, VALUES)
    # The noise of a size is that along the upward vector, transformed by the triad.
    root = np.linalg.norm(UP @ np.linalg.inv(triad(VALUES)), axis=1) * SD
    total = slope @ covariance() @ slope.T + np.diag(root**2)
    expected = excess @ np.linalg.solve(total, excess)
    assert result.test.chi2 + result.test.rest_chi2 == pytest.approx(expected, rel=2e-3)
    assert (result.test.dof, result.test.rest_dof) == (9, 1)
    assert result.test.p_value == pytest.approx(chi2.sf(result.test.chi2, 9))
    np.testing.assert_allclose(result.sizes.excess, excess, atol=1e-12)
    assert not result.test.rejected and result.use.answer == "yes"


@pytest.mark.long
def test_false_alarms_and_power_are_those_promised():
    p_values, _ = of_units(np.zeros(9), 120)
    assert np.mean(p_values < 0.1) == pytest.approx(0.1, abs=0.07)
    assert np.sum(p_values < LEVEL) <= 3
    change = np.zeros(9)
    change[4] = 3.0e-4
    p_values, first = of_units(change, 120)
    predicted = first.test.power(change)
    assert 0.3 < predicted < 0.95
    assert np.mean(p_values < LEVEL) == pytest.approx(predicted, abs=0.12)
    data = by_hand(VALUES)
    _, slope = sizes(data, VALUES)
    total = slope @ covariance() @ slope.T + SD**2 * np.eye(len(UP))
    along = slope @ change
    # One row more than visible directions: noncentrality of the whole differs by its share.
    noncentrality = along @ np.linalg.solve(total, along)
    assert predicted == pytest.approx(ncx2.sf(chi2.isf(LEVEL, 9), 9, noncentrality), abs=0.01)
    limit = first.sensitivity.limits[4]
    assert first.test.power(change * limit / change[4]) == pytest.approx(0.8, abs=1e-3)


def test_changed_bias_is_named_with_its_size():
    change = np.zeros(9)
    change[5] = 2e-3
    result = check(calibration(), FILE, by_hand(VALUES + change, noise(2)))
    assert result.moved is not None and result.moved.named is not None
    assert result.moved.named.parameters == ("bias_z",)
    assert result.moved.named.change[5] == pytest.approx(2e-3, abs=3e-4)
    assert result.use.refused and result.change_g is not None and result.change_g[0] == pytest.approx(2e-3, abs=3e-4)
    usual = np.array([0.0] * 3 + [2e-3] * 3 + [0.0] * 3)
    assert not check(calibration(), FILE, by_hand(VALUES + change, noise(2)), repeatability=usual).test.rejected
    accepted = check(calibration(), FILE, by_hand(VALUES + change, noise(2)), largest_g=5e-3)
    assert accepted.use.answer == "yes" and accepted.use.expanded_g > 2e-3


def test_attitude_that_was_not_at_rest_is_named_and_the_others_decide():
    disturbed = noise(3)
    disturbed[9] += 8e-3
    result = check(calibration(), FILE, by_hand(VALUES, disturbed))
    assert (result.outcome, result.disturbed) == ("repeat", "p10")
    assert result.use.answer == "yes" and "p10" in result.use.reason


def test_known_angles_show_all_parameters_but_not_the_mount():
    alpha, beta = np.array([0.0, 90, 180, 270, 45, 135, 225, 315, 0, 90]), np.array([0.0] * 8 + [90.0, 45.0])
    a, b = np.radians(alpha), np.radians(beta)
    up = np.column_stack([-np.sin(b), np.sin(a) * np.cos(b), np.cos(a) * np.cos(b)])
    turn = np.radians(2.0)
    turned = up @ np.array([[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1.0]]).T
    readings = turned @ triad(VALUES).T + VALUES[3:6] + noise(4)
    data = PositionSet(tuple(map(str, range(10))), alpha, beta, readings, sd=np.full(readings.shape, SD))
    result = check(calibration(), FILE, data, model=Model(priors={"dbeta": (0.0, 1e-4)}))
    assert not result.test.rejected and result.test.dof == 9 and not result.sensitivity.invisible
    assert result.test.rest_p is not None and result.test.rest_p > 1e-3


def test_noise_between_attitudes_is_estimated_from_their_disagreement():
    up = np.concatenate([UP, -UP[6:], UP[:3] + np.array([0.3, 0.2, 0.1])])
    up /= np.linalg.norm(up, axis=1)[:, None]
    larger = 30 * SD * np.random.default_rng(6).normal(size=up.shape)
    result = check(calibration(), FILE, by_hand(VALUES, larger, up=up))
    assert result.test.noise_factor == pytest.approx(30, rel=0.5) and result.test.noise_dof == 8
    assert result.outcome == "agrees" and result.sensitivity.limits[3] > 20 * SD
    # Without the degrees of freedom for an estimate, the check must be repeated or the sensor changed; it never agrees.
    assert check(calibration(), FILE, by_hand(VALUES, larger[:10])).outcome != "agrees"


def test_gravity_of_another_place():
    here, there = Gravity(9.81, "measured"), Gravity(9.78, "measured")
    of = calibration(gravity=here)
    # The unit of the readings is that of the calibration: gravity of the other place is smaller.
    data = by_hand(VALUES, noise(1), up=UP * 9.78 / 9.81)
    size, same = local_size(of, data, there, None, "c.json")
    assert size.ratio == pytest.approx(9.78 / 9.81) and size.u == pytest.approx(3e-5 * 0, abs=1e-4)
    assert not check(of, FILE, same, gravity=size).test.rejected
    assert check(of, FILE, same).test.rejected
    stated = replace(data, comments=data.comments | {"gravity_ms2": "9.78", "gravity_source": "measured"})
    with pytest.raises(InputError, match=r"gravity 9\.78 .*--gravity 9\.78"):
        local_size(of, stated, None, None, "c.json")


def test_temperature_outside_is_rejected():
    of = calibration(provenance={"dof": None, "temperature_range_degc": [24.0, 26.0]})
    data = by_hand(VALUES, noise(1), temperature_degc=np.full(10, 35.0))
    with pytest.raises(InputError, match=r"recorded at 35 degC, but calibration\.json is valid at 24 to 26"):
        check(of, FILE, data)
    assert check(of, FILE, data, extrapolate=True).outside_degc is not None
    assert check(of, FILE, replace(data, temperature_degc=np.full(10, 25.0))).outside_degc is None


def test_update_is_that_of_bayes():
    """The information of the prior with process noise, and of the sizes, in closed form."""
    data = by_hand(VALUES, noise(1))
    result = check(calibration(), FILE, data)
    process = stated_noise({"bias": 1e-5, "dK_x": 2e-5}, 6.0)
    made = updated(result.test, process, (), {})
    excess, slope = sizes(data, VALUES)
    root = np.linalg.norm(UP @ np.linalg.inv(triad(VALUES)), axis=1) * SD
    drift = np.diag([1.2e-4**2, 0, 0] + [6e-5**2] * 3 + [0] * 3)
    prior = np.linalg.inv(covariance() + drift)
    posterior = np.linalg.inv(prior + slope.T @ np.diag(root**-2) @ slope)
    mean = VALUES + posterior @ slope.T @ (excess / root**2)
    sensor = made.calibration.sensor
    np.testing.assert_allclose(sensor.values, mean, atol=0.02 * SD_OF.min())
    np.testing.assert_allclose(sensor.covariance, posterior, atol=5e-3 * SD_OF.max() ** 2)
    np.testing.assert_allclose(made.calibration.matrix @ triad(sensor.values), np.eye(3), atol=1e-12)
    record = made.calibration.provenance["update"]
    assert record["process_noise"]["months"] == 6.0 and record["freed"] == []


def curved():
    functions = TemperatureFunctions(1, reference_degc=25.0, range_degc=(0.0, 60.0))
    curve = Curve("bias_x", functions, np.array([1e-4]))
    joint = np.zeros((10, 10))
    joint[:9, :9], joint[9, 9] = covariance(), (5e-6) ** 2
    curves = TemperatureCurves((curve,), joint, order_of_covariance([curve]), (Hysteresis("bias_y", 3e-4, "g"),))
    return calibration(temperature=curves, temperature_degc=25.0)


def test_curves_of_temperature_are_used_and_kept():
    values = VALUES + 20 * 1e-4 * np.eye(9)[3]
    data = by_hand(values, noise(1), temperature_degc=np.full(10, 45.0))
    result = check(curved(), FILE, data)
    assert not result.test.rejected and result.expected.mean[3] == pytest.approx(values[3])
    assert result.expected.common[4, 4] == pytest.approx((3e-4) ** 2 / 3)
    made = updated(result.test, no_noise(), (), {}).calibration
    assert made.temperature is not None
    # Both parts of bias_x at 45 degC are improved together, and hysteresis remains.
    before, after = (each.at(45.0).sensor.sd for each in (curved(), made))
    assert after[3] < before[3] and after[4] > 3e-4 / np.sqrt(3)
    with pytest.raises(InputError, match="no temperatures"):
        check(curved(), FILE, by_hand(values, noise(1)))


def test_process_noise_of_a_history():
    def entry(month):
        parameters = SensorParameters(SENSOR, VALUES + month * 1e-4 * np.eye(9)[3], covariance())
        return Entry(
            "calibration", "A", f"2025-{month + 1:02d}-01T00:00:00Z", f"{month}", f"{month}", "", parameters=parameters
        )

    process = noise_of_history([entry(month) for month in range(6)], 3.0, "lab.db")
    assert process.shift[3] == pytest.approx(3e-4, rel=0.02) and process.shift[4] == pytest.approx(0, abs=1e-7)
    assert np.all(process.variance > 0)
    few = noise_of_history([entry(0)], 3.0, "lab.db")
    assert not np.any(few.variance) and "a drift needs three" in few.source


def test_readings_far_from_gravity_are_rejected():
    moving = noise(1)
    moving[2] += 0.5
    with pytest.raises(InputError, match="position p3: the corrected readings are far from gravity"):
        check(calibration(), FILE, by_hand(VALUES, moving))
    with pytest.raises(InputError, match="no standard uncertainty of dK_x"):
        check(calibration(parameters=SensorParameters(SENSOR, VALUES, np.zeros((9, 9)))), FILE, by_hand(VALUES))


def test_attitudes_that_are_proposed_separate_the_explanations():
    """Three attitudes leave several explanations of a changed bias, with their mean; with those proposed it is named."""
    change = 2e-3 * (np.arange(9) == 5)
    few = check(calibration(), FILE, by_hand(VALUES + change, noise(2)[:3], up=UP[:3])).moved
    assert few is not None and few.named is None and few.separating
    assert sum(one.probability for one in few.possible) > 0.95 >= sum(one.probability for one in few.possible[:-1])
    assert ("bias_z",) in [one.parameters for one in few.possible]
    mean, spread = few.average
    np.testing.assert_allclose(mean, sum(one.probability * one.change for one in few.explanations))
    assert abs(mean[5] - 2e-3) < 2 * np.sqrt(spread[5, 5]) and spread[5, 5] >= few.explanations[0].covariance[5, 5]
    up = np.vstack([UP[:3], *(own.up for own in few.separating)])
    more = check(calibration(), FILE, by_hand(VALUES + change, noise(2)[: len(up)], up=up)).moved
    assert more is not None and more.named is not None and more.named.parameters == ("bias_z",)


def test_terms_of_a_calibration_are_a_part_of_its_state():
    """A square of z that is known to 0.1 mg/g^2: counted in the readings, and improved with the parameters by an update."""
    square, sd = 3e-3, 1e-4
    term = {"axis": "z", "powers": [0, 0, 2], "coefficient": square, "effect": "second_order.z"}
    plain = calibration()
    joint = np.zeros((13, 13))
    joint[:12, :12], joint[12, 12] = plain.covariance, sd**2
    stated = {"order": [*map(str, range(12)), "second_order.z"], "covariance": joint.tolist()}
    more = {"dof": None, "sigma_g": SD, "verdict": "identified"}
    of = calibration(extra={"terms": [term], "covariance_with_terms": stated}, provenance=more)
    up = np.concatenate([UP, -UP])
    noise_of_all = SD * np.random.default_rng(3).normal(size=up.shape)
    bent = by_hand(
        VALUES, noise_of_all + np.outer((up @ triad(VALUES).T / (1 + VALUES[:3]))[:, 2] ** 2, [0, 0, square]), up=up
    )
    result = check(of, FILE, bent)
    assert not result.test.rejected and len(result.expected.state) == 10
    assert check(of, FILE, by_hand(VALUES, noise_of_all, up=up)).test.rejected
    made = updated(result.test, no_noise(), (), {}).calibration
    (coefficient,) = [own.coefficient for own in made.terms]
    whole = np.array(made.extra["covariance_with_terms"]["covariance"])
    assert whole[12, 12] < (0.7 * sd) ** 2 and abs(coefficient - square) < 3 * np.sqrt(whole[12, 12])
    np.testing.assert_allclose(whole, whole.T, atol=1e-20)
    assert np.linalg.eigvalsh(whole).min() > -1e-18

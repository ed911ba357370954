"""Every entry against the blind instrument of the benchmarks, which writes the same physics down a second time."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import blind_instrument as blind
from tumblecal.chain import nominal_chain, settings
from tumblecal.effects import catalogue
from tumblecal.effects.catalogue import belongs_to
from tumblecal.effects.temperature import ENTRIES as OVER_TEMPERATURE
from tumblecal.full_model.full_model import model_of


# The blind instrument measures one run at nearly one temperature: what differs between runs is tested below, and effects over a
# wide range of temperature in tests/report/test_every_sensor_effect.py.
PHYSICS = [
    one.id
    for one in catalogue().values()
    if one.make is not None and "run" not in one.needs and not one.found_as and one not in OVER_TEMPERATURE
]


@pytest.fixture(scope="module")
def setup():
    return blind.random_setup(np.random.default_rng(4), 3, 8)


def where_of(setup):
    return settings(
        setup.alpha,
        setup.beta,
        time_s=setup.time_s,
        temperature_degc=setup.temperature_degc,
        approach=setup.approach,
    )


def nominal_values(setup):
    n = setup.nominal
    return {
        **{f"{name}_{axis}": n[name][k] for name in ("dK", "bias", "dtheta") for k, axis in enumerate("xyz")},
        **{f"gamma_{pair}": n["gamma"][k] for k, pair in enumerate(("21", "31", "32"))},
        **{f"dbeta_{k}": value for k, value in enumerate(n["dbeta"])},
    }


@pytest.mark.parametrize("axis", blind.AXES)
def test_the_blind_instrument_turns_frames_as_scipy_does(axis):
    rng = np.random.default_rng(5)
    f, angle = rng.normal(size=(24, 3)), rng.uniform(-7, 7, 24)
    expected = Rotation.from_euler(axis, -angle[:, None]).apply(f)
    np.testing.assert_allclose(blind.turned(axis, angle, f), expected, rtol=0, atol=1e-14)


def test_the_catalogue_has_every_id_that_the_blind_instrument_knows():
    assert set(PHYSICS) == set(blind.COEFFICIENTS | blind.RARE)


@pytest.mark.parametrize("id", PHYSICS)
def test_effect_equals_the_blind_instrument(id, setup):
    where = where_of(setup)
    link = catalogue()[id].make(where)[0]
    rng = np.random.default_rng(len(id))
    chain = nominal_chain(where) + link
    names = [name for name in chain.names if name.startswith(id)]
    size = 1e-7 if "drift" in id else 1e-3
    values = dict(zip(names, size * rng.normal(size=len(names)), strict=True))
    coefficients = [value for name, value in values.items() if not name.endswith("tau")]
    if id in ("warm_up", "settling"):
        values[f"{id}_tau"] = 400.0
        coefficients = [*coefficients, 400.0]
    predicted = np.asarray(chain.named({**nominal_values(setup), **values})(where))
    expected = blind.readings(setup, setup.nominal, {id: coefficients})
    np.testing.assert_allclose(predicted, expected, rtol=0, atol=1e-13)
    plain = blind.readings(setup, setup.nominal, {})
    assert np.max(np.abs(expected - plain)) > 1e-8  # the effect does something


def test_bias_of_each_run_after_the_first(setup):
    runs = [str(k % 3) for k in range(len(setup.alpha))]
    where = settings(setup.alpha, setup.beta, run=runs)
    link = catalogue()["bias_repeatability"].make(where)[0]
    chain = nominal_chain(where) + link
    names = [name for name in chain.names if name.startswith("bias_repeatability")]
    assert names[0] == "bias_repeatability_x_run=1" and len(names) == 6
    values = {**nominal_values(setup), **{name: 1e-3 * (k + 1) for k, name in enumerate(names)}}
    moved = np.asarray(chain.named(values)(where)) - blind.readings(setup, setup.nominal, {})
    by_run = np.array([[0, 0, 0], [1, 2, 3], [4, 5, 6]]) * 1e-3
    np.testing.assert_allclose(moved, by_run[[int(run) for run in runs]], rtol=0, atol=1e-13)
    assert catalogue()["bias_repeatability"].lacking(settings(setup.alpha, setup.beta)) == "only one run"


def test_what_was_before_follows_the_time_within_a_run(setup):
    """Rows in any order; the first position of each run has none before it."""
    rows = np.random.default_rng(2).permutation(24)
    runs = ["1"] * 10 + ["2"] * 14
    mixed = [runs[row] for row in rows]
    where = settings(setup.alpha[rows], setup.beta[rows], run=mixed, time_s=setup.time_s[rows])
    plain = settings(setup.alpha, setup.beta, run=runs, time_s=setup.time_s)
    sines = np.cos(setup.beta) * np.sin(setup.alpha)
    expected = np.append(0.0, np.diff(sines))
    expected[10] = 0.0
    for here, order in ((where, rows), (plain, np.arange(24))):
        chain = nominal_chain(here)
        moved = np.asarray(
            (chain + catalogue()["memory.y"].make(here)[0]).named({"memory.y": 1e-3})(here) - chain(here)
        )
        np.testing.assert_allclose(moved[:, 1], -1e-3 * expected[order], atol=1e-15)


def test_drift_of_each_run(setup):
    runs = ["a"] * 12 + ["b"] * 12
    # The second run's clock starts again.
    time = np.concatenate([setup.time_s[:12], setup.time_s[:12]])
    where = settings(setup.alpha, setup.beta, run=runs, time_s=time)
    chain = nominal_chain(where)
    drifting = chain + catalogue()["run_drift.z"].make(where)[0]
    moved = np.asarray(drifting.named({"run_drift.z_first": 1e-6, "run_drift.z_run=b": -3e-6})(where) - chain(where))
    passed = np.tile(setup.time_s[:12] - setup.time_s[0], 2)
    np.testing.assert_allclose(moved, np.outer(passed * np.repeat([1e-6, -3e-6], 12), [0, 0, 1]), atol=1e-15)
    assert catalogue()["run_drift.z"].lacking(where_of(setup)) == "only one run"


READOUT = {
    "clipping.z": (1 / 0.8, lambda a: np.minimum(np.maximum(a, -0.8), 0.8)),
    "quantisation.z": (4e-3, lambda a: 4e-3 * np.rint(a / 4e-3)),
    "dead_zone.z": (2e-2, lambda a: np.where(np.abs(a) > 2e-2, a - np.copysign(2e-2, a), 0.0)),
}


@pytest.mark.parametrize("id", list(READOUT))
def test_the_readout_is_simulated_and_not_sought(id, setup):
    size, put_out = READOUT[id]
    where, plain = where_of(setup), blind.readings(setup, setup.nominal, {})
    chain = nominal_chain(where) + catalogue()[id].make(where)[0]
    expected = plain.copy()
    expected[:, 2] = put_out(plain[:, 2])
    assert np.max(np.abs(expected - plain)) > 1e-3
    np.testing.assert_allclose(chain.named({**nominal_values(setup), id: size})(where), expected, rtol=0, atol=1e-13)
    np.testing.assert_allclose(chain.named(nominal_values(setup))(where), plain, rtol=0, atol=1e-13)
    reason = model_of(nominal_chain(where), where, {id: catalogue()[id]}).not_testable[id]
    assert reason.startswith("it would be found as")


def test_every_entry_belongs_to_the_head_or_to_the_sensor():
    """What acts before the triad's mount is the head's, the fixture that carries all units included."""
    belongs = {id: belongs_to(effect) for id, effect in catalogue().items()}
    head = {id for id, owner in belongs.items() if owner == "head"}
    assert head == {
        "base_levelling",
        "axis_perpendicularity",
        "index_eccentricity",
        "index_ellipticity",
        "index_gain",
        "index_zero",
        "index_backlash",
        "spindle_wobble_1",
        "spindle_wobble_2",
        "fixture_flexure",
        "gravity_value",
    }
    assert {belongs[id] for id in PHYSICS} == {"head", "sensor"} and belongs["swapped_positions"] == ""

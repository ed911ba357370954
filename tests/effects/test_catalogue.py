"""Every entry against the blind instrument of the benchmarks, which writes the same physics down a second time."""

import numpy as np
import pytest

import blind_instrument as blind
from tumblecal.chain import nominal_chain, settings
from tumblecal.effects import catalogue, entry
from tumblecal.effects.catalogue import belongs_to
from tumblecal.effects.effect import base_unit
from tumblecal.ground.errors import InputError


# The blind instrument measures one run: what differs between runs is tested below.
PHYSICS = [one.id for one in catalogue().values() if one.make is not None and "run" not in one.needs]


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


def test_the_catalogue_has_every_id_that_the_blind_instrument_knows():
    assert set(PHYSICS) == set(blind.COEFFICIENTS)


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
    if id == "warm_up":
        values["warm_up_tau"] = 400.0
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
    assert catalogue()["bias_repeatability"].missing(settings(setup.alpha, setup.beta)) == ("run",)


@pytest.mark.parametrize(
    ("unit", "base", "scale"),
    [
        ("mg/g^2", "g/g^2", 1e-3),
        ("(mg/g)/h", "1/s", 1e-3 / 3600),
        ("mrad/rad", "rad/rad", 1e-3),
        ("mg/h", "g/s", 1e-3 / 3600),
        ("1e-3", "1", 1e-3),
    ],
)
def test_units(unit, base, scale):
    assert base_unit(unit) == (base, pytest.approx(scale, rel=1e-12))


def test_unknown_id_names_near_ones():
    with pytest.raises(InputError, match=r"did you mean .*second_order"):
        entry(catalogue(), "secondorder.x")


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
        "index_backlash",
        "spindle_wobble_1",
        "spindle_wobble_2",
        "fixture_flexure",
        "gravity_value",
    }
    assert {belongs[id] for id in PHYSICS} == {"head", "sensor"} and belongs["swapped_positions"] == ""

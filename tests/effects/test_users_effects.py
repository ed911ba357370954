"""Effects of the user's own: what the document shows works, and a fault is one line with its place."""

import re
from pathlib import Path

import numpy as np
import pytest

import blind_instrument as blind
import independent
from tumblecal.chain import nominal_chain, settings
from tumblecal.effects import catalogue
from tumblecal.ground.errors import InputError


DOCUMENT = Path(__file__).parents[2] / "docs" / "own_effects.md"
EXAMPLES = [text for text in re.findall(r"```python\n(.*?)```", DOCUMENT.read_text(), re.S) if "EFFECTS" in text]


@pytest.fixture
def written(tmp_path):
    """A user's file."""

    def write(text, name="mine.py"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


def values_of(chain, **values):
    """Readings of a chain at a plan, and the plan's angles."""
    alpha, beta = np.tile(np.radians(np.arange(8) * 45.0), 3), np.repeat(np.radians([0.0, 45, 90]), 8)
    where = settings(alpha, beta)
    made = nominal_chain(where)
    for link in chain(where):
        made = made + link
    return alpha, beta, np.asarray(made.named(values)(where))


@pytest.mark.parametrize("text", EXAMPLES, ids=lambda text: text.split('"')[1])
def test_the_documents_examples_work(written, text):
    entries = catalogue(written(text))
    assert len(entries) == len(catalogue()) + 1


def test_an_output_effect_does_what_it_says(written):
    make = catalogue(written(EXAMPLES[0]))["fourth_order.y"].make
    alpha, beta, readings = values_of(make, **{"fourth_order.y": 2e-3})
    v = independent.specific_force(alpha, beta)
    np.testing.assert_allclose(readings, v + 2e-3 * v[:, 1:2] ** 4 * [0, 1, 0], atol=1e-14)


def test_an_angle_effect_equals_the_blind_instrument(written):
    """The third harmonic of the index is in the blind instrument, and in no entry of the catalogue."""
    setup = blind.random_setup(np.random.default_rng(1), 3, 8)
    setup.nominal = {name: np.zeros_like(value) for name, value in setup.nominal.items()}
    make = catalogue(written(next(text for text in EXAMPLES if "angle_effect(" in text)))["index_third"].make
    *_, readings = values_of(make, index_third_cos=3e-3, index_third_sin=-2e-3)
    expected = blind.readings(setup, setup.nominal, {"?index_third": [3e-3, -2e-3]})
    np.testing.assert_allclose(readings, expected, atol=1e-14)


def test_a_link_of_ones_own(written):
    make = catalogue(written(next(text for text in EXAMPLES if "(Link)" in text)))["fixture_twist"].make
    alpha, beta, readings = values_of(make, fixture_twist=5e-3)
    v = independent.specific_force(alpha, beta)
    turned = np.stack([independent.passive("z", 5e-3 * one[0]).apply(one) for one in v])
    np.testing.assert_allclose(readings, turned, atol=1e-14)


GOOD = """from tumblecal.effects import output_effect
import jax.numpy as jnp


def term(u, where):
    return u[1] ** 5


EFFECTS = [
    output_effect("fifth.y", "y", term, unit="mg/g^2", typical=0.2, physics="K5 u^5", cause="Fifth order."),
]
"""


def test_a_column_that_is_used_must_be_named(written):
    text = GOOD.replace("u[1] ** 5", "where.time_s * u[1]")
    with pytest.raises(InputError, match=r":line 6: effect 'fifth.y': TypeError.* add one of time_s"):
        catalogue(written(text))
    assert "fifth.y" in catalogue(written(text.replace("unit=", "needs=['time_s'], unit=")))


def test_a_term_may_look_back_where_that_is_said(written):
    text = GOOD.replace("u[1] ** 5", "where.inputs_before[1] - u[1]")
    with pytest.raises(InputError, match=r":line 6: effect 'fifth.y': TypeError.* with looks_back=True"):
        catalogue(written(text))
    make = catalogue(written(text.replace("unit=", "looks_back=True, unit=")))["fifth.y"].make
    alpha, beta, readings = values_of(make, **{"fifth.y": 2e-3})
    v = independent.specific_force(alpha, beta)
    before = np.vstack([v[:1], v[:-1]])
    np.testing.assert_allclose(readings, v + 2e-3 * (before - v) * [0, 1, 0], atol=1e-14)


def test_the_good_file_is_good_and_twice_is_not(written):
    path, again = written(GOOD), written(GOOD, "again.py")
    assert "fifth.y" in catalogue(path)
    with pytest.raises(InputError, match=r"again.py:line 10: the id 'fifth.y' exists already"):
        catalogue(path, again)
    twice = written(GOOD.replace("EFFECTS = [", "EFFECTS = 2 * ["), "twice.py")
    with pytest.raises(InputError, match=r"twice.py:line 10: the id 'fifth.y' exists already"):
        catalogue(twice)

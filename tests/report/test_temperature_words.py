"""A calibration says so where the temperature changed and its standard deviations hold nothing of that."""

from dataclasses import replace

import numpy as np
import pytest

import blind_instrument as blind
from blind_noise import position_set
from tumblecal.chain import nominal_chain
from tumblecal.effects.catalogue import catalogue, links
from tumblecal.estimation.methods import calibrate
from tumblecal.estimation.position_problem import where_of
from tumblecal.show.calibration import words_of_calibration


def temperature_words(calibrated):
    return dict(words_of_calibration(calibrated).pairs("details")).get("Temperature", "")


@pytest.fixture(scope="module")
def positions():
    setup = blind.random_setup(np.random.default_rng(1), 3, 8)
    return position_set(setup, blind.readings(setup, setup.nominal, {}) + 1e-4, known=True)


@pytest.mark.parametrize(("rise", "said"), [(0.0, False), (1.5, False), (12.0, True)])
def test_a_change_is_said(positions, rise, said):
    warmed = replace(positions, temperature_degc=20 + np.linspace(0, rise, len(positions)))
    words = temperature_words(calibrate(warmed))
    assert bool(words) is said and ("changed by 12 degC" in words) is said


def test_nothing_is_said_without_temperatures_or_where_the_chain_has_effects_of_them(positions):
    assert temperature_words(calibrate(replace(positions, temperature_degc=None))) == ""
    warmed = replace(positions, temperature_degc=20 + np.linspace(0, 12, len(positions)))
    where = where_of(warmed)
    made = links(catalogue(), ("bias_temperature.y",), where)
    chain = nominal_chain(where)
    for link in made["bias_temperature.y"]:
        chain = chain + link
    assert temperature_words(calibrate(warmed, chain=chain)) == ""

"""Units on one head: the joint fit against one stacked least squares in numpy, and what a later unit is told."""

import json
from dataclasses import replace

import numpy as np
import pytest

import blind_instrument as blind
from blind_sets import measured
from tumblecal.chain.head_file import MeasuredHead
from tumblecal.diagnosis.units import joint_diagnosis
from tumblecal.estimation.plausibility import implausible_head
from tumblecal.show.units_together import words_of_units, write_units


LEVEL = 0.3e-3


@pytest.fixture(scope="module")
def units():
    """Four units of one head, rolled by `LEVEL`, pitch errors their own."""
    rng = np.random.default_rng(8)
    setups = [blind.random_setup(rng, 3, 8) for _ in range(4)]
    return setups, [measured(setup, {"base_levelling": [LEVEL]}, rng) for setup in setups]


def joint(diagnoser, sets):
    """The joint diagnosis of units."""
    sets = list(sets)
    return joint_diagnosis([diagnoser.begun(own).screened for own in sets], [f"unit{k}" for k in range(len(sets))])


@pytest.fixture(scope="module")
def found(units, diagnoser):
    return joint(diagnoser, units[1])


def stacked(setups, sets) -> tuple[float, float]:
    """Level and its sd by one least squares over all readings and all units' parameters, derivatives by differences."""
    rows, right = [], []
    for number, (setup, positions) in enumerate(zip(setups, sets, strict=True)):

        def of(shift, setup=setup):
            nominal, first = {}, 0
            for name, values in setup.nominal.items():
                nominal[name] = values + shift[first : first + len(values)]
                first += len(values)
            return blind.readings(setup, nominal, {"base_levelling": [LEVEL + shift[first]]}).ravel()

        count = sum(len(values) for values in setup.nominal.values()) + 1
        steps = 1e-5 * np.eye(count)
        own = np.stack([(of(step) - of(-step)) / 2e-5 for step in steps], axis=1)
        block = np.zeros((len(own), (count - 1) * len(sets) + 1))
        block[:, number * (count - 1) : (number + 1) * (count - 1)] = own[:, :-1]
        block[:, -1] = own[:, -1]
        rows.append(block / blind.SIGMA)
        right.append((positions.readings.ravel() - of(np.zeros(count))) / blind.SIGMA)
    whole = np.concatenate(rows)
    solution, *_ = np.linalg.lstsq(whole, np.concatenate(right), rcond=None)
    return LEVEL + solution[-1], float(np.sqrt(np.linalg.inv(whole.T @ whole)[-1, -1]))


def test_the_joint_fit_is_that_of_all_readings_stacked(units, found):
    assert found.joint.detected and found.joint.best.shared.labels == ("base_levelling",)
    head, (value, sd) = found.fit.head, stacked(*units)
    assert head is not None and head.names == ("base_levelling",) and found.fit.pitch.p_value < 1e-6
    assert head.sd[0] == pytest.approx(sd, rel=2e-3)
    assert abs(head.values[0] - value) < 0.02 * sd
    assert abs(value - LEVEL) < 4 * sd


def test_a_unit_is_told_what_the_others_measured(units, found):
    setups, sets = units
    for number in range(4):
        others = [k for k in range(4) if k != number]
        value, sd = stacked([setups[k] for k in others], [sets[k] for k in others])
        head = found.known_to(number)
        assert abs(head.values[0] - value) < 0.02 * sd
        # On a coarse scale, so that units of a plan share what a plan decides.
        assert 0.85 * sd < head.sd[0] < 1.15 * sd


@pytest.mark.long
def test_an_effect_of_a_different_size_in_each_unit_is_fitted_with_the_heads_errors(diagnoser):
    """A nonlinearity is partly what an eccentric index makes: the head's error was wrong by 20 sd, and units stood out."""
    rng, sets, eccentricity = np.random.default_rng(21), [], [-0.12e-3, 0.58e-3]
    for size in np.array([-0.2, 0.8, 1.7, 1.8]) * 1e-3:
        setup = blind.random_setup(rng, 4, 12)
        sets.append(measured(setup, {"index_eccentricity": eccentricity, "second_order.y": [size]}, rng))
    found = joint(diagnoser, sets)
    assert found.joint.best.shared.labels == ("index_eccentricity",) and found.joint.best.by_unit == ("second_order.y",)
    head = found.fit.head
    assert head is not None and np.all(np.abs(head.values - eccentricity) < 3.5 * head.sd) and np.all(head.sd < 4e-5)
    assert found.outlying == ()


def test_a_head_such_as_none_is_goes_into_no_file(found, diagnoser, tmp_path):
    """A base 6 degrees out of level and a pitch setting off by 4 were written to head.toml without a word."""
    covariance = np.diag([1e-10, 1e-10, 1e-10])
    names, values = ("base_levelling", "dbeta@45", "index_gain"), np.array([0.11, -0.07, 0.05])
    head = MeasuredHead(("base_levelling", "index_gain"), names, ("rad", "rad", "1"), values, covariance)
    unusual = implausible_head(head)
    assert [own.parameter for own in unusual] == ["dbeta@45", "base_levelling"] and found.implausible == ()
    rows = [(f"unit{k}", {"file": f"unit{k}", "causes": "", "verdict": "adequate"}) for k in range(4)]
    for told, written in ((found, True), (replace(found, implausible=unusual), False)):
        folder = tmp_path / str(written)
        folder.mkdir()
        words = words_of_units(told, rows, diagnoser.entries)
        names = write_units(folder, told, rows, diagnoser.entries, words, figures=False)
        assert ("head.toml" in names) == (folder / "head.toml").exists() == written
        text = (folder / "verdict.txt").read_text()
        assert ("IMPLAUSIBLE: dbeta@45 = -4.011 deg" in text) != written and text.startswith("AMBIGUOUS") != written


def units_with(hidden, seed, pitch=None):
    """Position sets of units of 3 x 8 positions, with these effects in each; `pitch`: errors (rad) of the settings of each."""
    rng = np.random.default_rng(seed)
    for number, effects in enumerate(hidden):
        setup = blind.random_setup(rng, 3, 8)
        setup.nominal["dbeta"] = pitch[number] if pitch else setup.nominal["dbeta"]
        yield measured(setup, {id: np.atleast_1d(size) for id, size in effects.items()}, rng)


def rows(count, causes=""):
    return [(f"u{k}", {"file": f"u{k}", "causes": causes, "verdict": "", "probability": 0.9}) for k in range(count)]


@pytest.mark.long
def test_a_head_that_was_levelled_again_has_two_levels(diagnoser, tmp_path):
    """It was ADEQUATE, with p = 1e-15, and of another size in each unit."""
    levels = (LEVEL, -LEVEL)
    hidden = [{"base_levelling": levels[0]}] * 3 + [{"base_levelling": levels[1]}] * 3
    found = joint(diagnoser, units_with(hidden, 31))
    assert found.verdict in ("identified", "ambiguous") and [own.first for own in found.levels] == [3]
    # By itself a unit may call it a spindle out of square; the last has something of its own too.
    units = [*rows(5, "axis_perpendicularity"), *rows(6, "base_levelling")[5:]]
    write_units(tmp_path, found, units, diagnoser.entries, words_of_units(found, units, diagnoser.entries))
    batch = json.loads((tmp_path / "diagnosis.json").read_text())
    (told,) = batch["levels"]
    assert batch["verdict"] == found.verdict and told["effect"] == "base_levelling" and told["p_value"] < 0.01
    for part, level in zip(told["parts"], levels, strict=True):
        size = part["coefficients"]["base_levelling"]
        assert abs(size["value"] - 1e3 * level) < 4 * size["sd"] and size["unit"] == "mrad"
    assert [(part["first"], part["last"]) for part in told["parts"]] == [("u0", "u2"), ("u3", "u5")]
    assert "it changed between u2 and u3" in batch["text"] and "ADEQUATE" not in batch["text"]
    assert "Errors of individual units" not in batch["text"] and all(
        unit["same_as_shared"] for unit in batch["units"][:5]
    )
    assert "it changed between u2 and u3" in (tmp_path / "diagnosis.html").read_text()

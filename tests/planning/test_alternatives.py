"""Rivals of what was named: those that these data cannot tell from it count, and each has the rows that it sees itself."""

from dataclasses import replace

import numpy as np
import pytest

import blind_instrument as blind
from blind_noise import position_set
from tumblecal.diagnosis import Diagnoser
from tumblecal.effects import catalogue
from tumblecal.planning.alternatives import Alternative, alternatives_of, columns_of
from tumblecal.planning.new_rows import rows_of
from tumblecal.planning.next_plan import SEPARATE, next_plan
from tumblecal.planning.proposals import Allowed, Proposal, proposals
from tumblecal.planning.value import Separation


HIDDEN, OFF = "cross_coupling.x.xz", ("outlier_position:1-1", "outlier_position:1-3")


@pytest.fixture(scope="module")
def diagnosed():
    """At 3 x 4 positions the product of inputs differs from zero at two alone, which may as well be off by themselves."""
    entries = catalogue()
    kept = {id: effect for id, effect in entries.items() if id == HIDDEN or effect.make is None}
    rng = np.random.default_rng(3)
    setup = blind.random_setup(rng, 3, 4)
    readings = blind.readings(setup, setup.nominal, {HIDDEN: np.array([0.002])})
    data = position_set(setup, readings + blind.SIGMA * rng.normal(size=readings.shape), known=True)
    diagnosis = Diagnoser(kept, nested=False)(data)
    best = diagnosis.best
    assert best.labels == (HIDDEN,) and best.equivalents == (OFF,)
    # Its probability decides; one that counts at any odds is an alternative however improbable it is.
    assert sum(best.shares) < 1e-4 and diagnosis.verdict == "identified"
    assert not alternatives_of(diagnosis, present(diagnosis))
    return doubted(diagnosis, OFF)


def doubted(diagnosis, rival):
    """The same with one equivalent, which counts at any odds."""
    best, *others = diagnosis.screened.explanations
    best = replace(best, equivalents=(rival,), at_any_odds=(rival,))
    return replace(diagnosis, screened=replace(diagnosis.screened, explanations=[best, *others]))


def present(diagnosis):
    """Rows of all that could be measured in the present mounting."""
    return rows_of(diagnosis, proposals(diagnosis.data, Allowed(remount=False), ()))


def test_a_rival_at_any_odds_is_told_apart_however_improbable(diagnosed):
    planned = next_plan(diagnosed, Allowed(remount=False))
    assert planned.purpose == SEPARATE and planned.value > 4.0
    # The clearest alone would do, were it not off itself.
    assert planned.positions > 1


def test_positions_that_a_rival_takes_for_off_tell_it_nothing(diagnosed):
    alternative = alternatives_of(diagnosed, present(diagnosed))[0]
    by_position = alternative.rows.old[: 3 * len(diagnosed.data)].reshape(len(diagnosed.data), 3, -1)
    off = [diagnosed.data.names[k] for k in np.flatnonzero(~np.any(by_position, axis=(1, 2)))]
    assert alternative.labels == OFF == tuple(f"outlier_position:{name}" for name in off)


def test_what_is_told_apart_by_thousands_of_sd_stays_finite(diagnosed):
    rows, leader = present(diagnosed), columns_of(diagnosed.members)
    amplitudes = 1e4 * diagnosed.extended.vector[leader] / diagnosed.model.scales[leader]
    own = Alternative(diagnosed.best.labels, tuple(leader), 1.0, rows)
    value = Separation(diagnosed.model.nominal, own, amplitudes, alternatives_of(diagnosed, rows))
    for cells in rows.cells[:3]:
        expected = value.total + value.of([cells])[0]
        value.take(cells)
        np.testing.assert_allclose(value.total, expected, rtol=1e-12)
    assert 1e4 < value.total < np.inf and np.all(np.isfinite(value.of(rows.cells)))


def test_what_has_changed_for_good_is_so_at_new_positions(diagnosed):
    """A mount that slipped at the sixth position: three angles more from there on, and at every new one."""
    slipped, rows = doubted(diagnosed, (f"mount_slip:{diagnosed.data.names[5]}",)), present(diagnosed)
    alternative = alternatives_of(slipped, rows)[0]
    own = [diagnosed.model.names.index(f"dtheta_{axis}") for axis in "xyz"]
    added = slice(rows.old.shape[1], None)
    np.testing.assert_allclose(alternative.rows.new[:, :, added], rows.new[:, :, own])
    after = alternative.rows.old[: 3 * len(diagnosed.data), added]
    assert not np.any(after[:15]) and np.any(after[15:18])
    np.testing.assert_allclose(after[15:], rows.old[15 : 3 * len(diagnosed.data), own])


def test_what_is_measured_with_the_triad_turned_tells_how_it_stands(diagnosed):
    """With the spindle upright alone no reading depends on the mounting's angle about it: such data would be refused."""
    side, turn = "turned 90 deg about z", (0.0, 90.0, 180.0, 270.0)
    rows = rows_of(diagnosed, [Proposal(turn, beta, side) for beta in (0.0, 90.0)])
    level, upright = rows.cells
    assert rows.determine_group_parameters(level) and not rows.determine_group_parameters(upright)
    assert rows.determine_group_parameters(np.concatenate([level, upright]))

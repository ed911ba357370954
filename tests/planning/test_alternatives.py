"""Rivals of what was named: those that these data cannot tell from it count, and each has the rows that it sees itself."""

from dataclasses import replace

import numpy as np
import pytest

import blind_instrument as blind
from blind_sets import measured
from tumblecal.diagnosis import Diagnoser
from tumblecal.effects import catalogue
from tumblecal.plan.next.competition import competition
from tumblecal.plan.next.conditions import continued
from tumblecal.plan.next.next_plan import SEPARATE, next_plan
from tumblecal.plan.next.proposals import Allowed, proposals
from tumblecal.plan.next.rows import rows_of


HIDDEN, OFF = "cross_coupling.x.xz", ("outlier_position:1-1", "outlier_position:1-3")


@pytest.fixture(scope="module")
def diagnosed():
    """At 3 x 4 positions the product of inputs differs from zero at two alone, which may as well be off by themselves."""
    entries = catalogue()
    kept = {id: effect for id, effect in entries.items() if id == HIDDEN or effect.make is None}
    rng = np.random.default_rng(3)
    setup = blind.random_setup(rng, 3, 4)
    diagnosis = Diagnoser(kept, nested=False)(measured(setup, {HIDDEN: np.array([0.002])}, rng))
    best = diagnosis.best
    assert best.labels == (HIDDEN,) and best.equivalents == (OFF,)
    # Its probability decides; one that counts at any odds is an alternative however improbable it is.
    assert sum(best.shares) < 1e-4 and diagnosis.verdict == "identified"
    assert len(competition(diagnosis).competing) == 1
    return doubted(diagnosis, OFF)


def doubted(diagnosis, rival):
    """The same with one equivalent, which counts at any odds."""
    best, *others = diagnosis.screened.explanations
    best = replace(best, equivalents=(rival,), at_any_odds=(rival,))
    return replace(diagnosis, screened=replace(diagnosis.screened, explanations=[best, *others]))


def present(diagnosis, causes):
    """Rows of all that could be measured in the present mounting, and the posterior under some causes."""
    listed, conditions = proposals(diagnosis.data, Allowed(remount=False), ()), continued(diagnosis.data)
    rows = rows_of(diagnosis, listed, conditions)
    return rows, rows.posterior(causes, diagnosis.model)


def test_a_rival_at_any_odds_is_told_apart_however_improbable(diagnosed):
    planned = next_plan(diagnosed, Allowed(remount=False))
    assert planned.purpose == SEPARATE and planned.value > 4.0
    # The clearest alone would do, were it not off itself.
    assert planned.positions > 1


def test_positions_that_a_rival_takes_for_off_tell_it_nothing(diagnosed):
    alternative = competition(diagnosed).competing[1]
    rows, known = present(diagnosed, alternative.causes)
    off = [f"outlier_position:{name}" in alternative.labels for name in diagnosed.data.names]
    assert alternative.labels == OFF and sum(off) == 2
    nominal, kept = diagnosed.model.nominal, rows.old[: 3 * len(off)][~np.repeat(off, 3)]
    kept = np.concatenate([kept, rows.old[3 * len(off) :]])[:, :nominal]
    np.testing.assert_allclose(known.information[:nominal, :nominal], kept.T @ kept, rtol=1e-6, atol=1e-3)


@pytest.fixture(scope="module")
def of_settings():
    """An offset of z from the second of three settings on: a jump, or a bias by setting."""
    names = ("bias_by_pitch.z", "mount_by_pitch")
    kept = {id: effect for id, effect in catalogue().items() if id in names or effect.make is None}
    rng = np.random.default_rng(8)
    setup = blind.random_setup(rng, 3, 4)
    return Diagnoser(kept, nested=False)(measured(setup, {"bias_by_pitch.z": np.array([1e-3, 1e-3])}, rng))


def test_what_has_a_value_for_each_pitch_setting_predicts_none_for_another(of_settings):
    """Neither a bias by setting nor a mount that moved at one setting predicts a new one."""
    labels = {of_settings.best.labels, *of_settings.best.equivalents}
    assert ("bias_by_pitch.z",) in labels and any(one[0].startswith("bias_jump") for one in labels)
    assert competition(of_settings).at_settings
    plan = next_plan(of_settings)
    assert plan.purpose == SEPARATE and {one.beta_deg for one in plan.together} <= {0.0, 45.0, 90.0}
    assert any("pitch setting" in note for note in plan.notes)


def test_what_has_changed_for_good_is_so_at_new_positions(diagnosed):
    """A mount that slipped at the sixth position: three angles more from there on, and at every new one."""
    label = f"mount_slip:{diagnosed.data.names[5]}"
    pool = diagnosed.screened.pool
    slip = pool.causes[pool.labels.index(label)]
    rows, slipped = present(diagnosed, [slip])
    own = [diagnosed.model.names.index(f"dtheta_{axis}") for axis in "xyz"]
    np.testing.assert_allclose(slipped.columns[:, :, -3:], rows.new[:, :, own])
    after = rows.old[15 : 3 * len(diagnosed.data), own]
    np.testing.assert_allclose(slipped.information[-3:, -3:], after.T @ after, rtol=1e-6, atol=1e-3)


def test_a_mounting_with_the_spindle_upright_is_not_proposed_alone(diagnosed):
    """With the spindle upright no reading depends on the mounting's angle about it: such data would be refused."""
    for plan in (next_plan(diagnosed), next_plan(diagnosed, Allowed(beta_deg=(90.0,)))):
        assert not any(one.mount and one.beta_deg == 90.0 for one in plan.singles)
        level = {one.mount for one in plan.together if one.beta_deg != 90.0}
        assert {one.mount for one in plan.together} <= {"", *level}

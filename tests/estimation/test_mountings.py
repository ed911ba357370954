"""Turned mountings: which quarter turn the readings show, against plain numpy and scipy."""

from dataclasses import replace

import numpy as np
import pytest

from remounted import blind, measured, two
from tumblecal.chain.nominal import Mount
from tumblecal.data.joined import joined
from tumblecal.estimation import default_chain, exact, problem_of
from tumblecal.estimation.joined_files import with_distinct_mounts
from tumblecal.estimation.mountings import quarter_turns, turn_of, turned_mountings
from tumblecal.ground.errors import InputError


TURNS = [turn.angles_deg for turn in quarter_turns()]
NONE = TURNS[0]
Z90, Y90, X90 = (0.0, 0.0, 90.0), (0.0, 90.0, 0.0), (90.0, 0.0, 0.0)


@pytest.mark.parametrize("turn", TURNS[1:], ids=str)
def test_every_turn_is_recognised(turn):
    seed = TURNS.index(turn)
    assert turn_of(quarter_turns()[seed].matrix) == turn and turn_of(np.diag([1.0, 1.0, -1.0])) is None
    data, *_ = two(seed, NONE, turn)
    assert turned_mountings(data) == {"A": NONE, "B": turn}
    other = Z90 if turn == Y90 else Y90
    data, *_ = two(seed, turn, other)
    assert turned_mountings(data) == {"A": turn, "B": other}


def _small(seed, degrees):
    """Two mountings with mount angles of this size in random directions, errors of 30e-3 and the worst of a file."""
    rng = np.random.default_rng(seed)
    setup = blind.random_setup(rng, 3, 8)
    parts = []
    for label in "AB":
        dtheta = rng.normal(size=3)
        nominal = setup.nominal | {"dtheta": np.radians(degrees) * dtheta / np.linalg.norm(dtheta)}
        nominal |= {"dK": rng.normal(0, 0.03, 3), "bias": rng.normal(0, 0.03, 3)}
        parts.append(measured(setup, nominal, NONE, rng, label))
    return joined(parts)


@pytest.mark.parametrize("seed", range(6))
def test_small_mounts_are_left_as_they_are(seed):
    data = _small(seed, 5.0)
    swapped = data.readings.copy()
    swapped[[1, 3, 30]] = swapped[[3, 1, 35]]
    for own in (data, replace(data, readings=swapped), replace(data, mount=None, run=data.mount)):
        assert turned_mountings(own) == {}
        assert with_distinct_mounts([own, own])[1] is own
    mirrored = replace(data, readings=data.readings * [-1, 1, 1])
    assert {*(with_distinct_mounts([data, mirrored])[1].mount or ())}.isdisjoint({"A", "B"})
    (mount,) = (link for link in default_chain(data).links if isinstance(link, Mount))
    assert mount.nominal is None


def test_positions_that_say_nothing_of_a_turn_leave_it_as_it_is():
    """At beta 90 the triad sees gravity along the spindle alone; three positions may be wrong ones."""
    data, *_ = two(1, NONE, X90)
    along = [row for row in range(48) if data.mount and (data.mount[row] == "A" or data.beta_deg[row] == 90)]
    assert turned_mountings(data.chosen(along)) == {}
    assert turned_mountings(data.chosen(range(27))) == {}
    assert turned_mountings(data.chosen(range(29))) == {"A": NONE, "B": X90}


def test_the_fit_of_a_turned_mounting_finds_the_truth():
    """90 deg about y would otherwise stand where two of the mount's angles turn about the same axis."""
    for seed, turn in ((1, Y90), (2, (0.0, 180.0, 0.0))):
        data, one, other = two(seed, NONE, turn)
        problem = problem_of(data, noise_sd=blind.SIGMA)
        result = exact.fit(problem)
        assert result.code.good and result.chi2 < 1.6 * result.dof
        for label, truth in (("A", one), ("B", other)):
            found = np.array([result.value(f"dtheta_{axis}@mount={label}") for axis in "xyz"])
            sd = np.array([result.sd[result.names.index(f"dtheta_{axis}@mount={label}")] for axis in "xyz"])
            assert np.all(np.abs(found - truth["dtheta"]) < 4.5 * sd) and np.all(sd < 1e-4)


def test_files_of_several_turns_are_told_apart():
    rng = np.random.default_rng(7)
    setup = blind.random_setup(rng, 3, 8)
    nominal = setup.nominal
    order = [("in/a", NONE), ("in/b", Z90), ("in/c", Z90), ("in/d", NONE), ("more/b", Y90)]
    files = [measured(setup, nominal, turn, rng, source=f"{name}.csv") for name, turn in order]
    labels = [None if one.mount is None else set(one.mount) for one in with_distinct_mounts(files)]
    # Back at the first attitude the triad was mounted anew all the same.
    assert labels == [None, {"b"}, {"b"}, {"d"}, {"b 2"}]
    assert turned_mountings(joined(with_distinct_mounts(files))) == {"1": NONE, "b": Z90, "d": NONE, "b 2": Y90}
    named = [replace(one, mount=("A",) * 24) for one in files[:2]]
    assert set(with_distinct_mounts(named)[1].mount or ()) == {"A of b"}


def test_a_turn_that_cannot_be_told_is_refused_with_what_to_write():
    data, *_ = two(4, NONE, Z90)
    rows = [row for row in range(48) if data.mount and (data.mount[row] == "A" or data.beta_deg[row] == 90)]
    with pytest.raises(InputError, match=r'mount B: .* --rig FILE, .* \[mounts."A"\] rotation_deg = \[0, 0, 0\]'):
        turned_mountings(data.chosen(rows))

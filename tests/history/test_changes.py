"""Changes of a unit over time, on populations of units that `benchmarks/history_changes.py` writes in numpy."""

import numpy as np
import pytest

from history_changes import NOISE, found, unit
from tumblecal.history.changes import DRIFT, STEP
from tumblecal.history.repeatability import PAPER_LIMITS, unit_history
from tumblecal.show.history import history_text, words_of_history


@pytest.mark.long
def test_stable_units_have_no_change_in_95_percent():
    """Repeatability from that of the noise alone to ten times that, 4 to 12 dates; equal or not for the parameters of a kind,
    noise stated or estimated; the mount is clamped for each date."""
    rng, flagged, count = np.random.default_rng(11), [], 0
    for dates in (4, 5, 6, 8, 12):
        for k in range(48):
            ratio = rng.choice([0.0, 0.5, 1.0, 3.0, 10.0], 3)
            changes = found(unit(rng, dates, ratio=ratio, unequal=k % 3 == 0, dof=5.0 if k % 4 == 0 else np.inf))
            flagged += [(dates, k, *changes)] if changes else []
            count += 1
    assert len(flagged) <= 0.05 * count, flagged


@pytest.mark.long
def test_an_estimated_uncertainty_that_is_small_by_chance_is_no_change():
    """Five degrees of freedom: as weights without a lower bound these uncertainties give 8 %."""
    rng = np.random.default_rng(14)
    flagged = sum(bool(found(unit(rng, 12, ratio=rng.choice([0.0, 0.5, 1.0, 3.0], 3), dof=5.0))) for _ in range(100))
    assert flagged <= 5


def test_the_repeatability_is_that_of_the_population():
    rng, sizes = np.random.default_rng(3), []
    for _ in range(60):
        history = unit_history(unit(rng, 5, ratio=[0.0, 3.0, 1.0]), PAPER_LIMITS)
        sizes.append([repeats.sd for repeats in history.repeats[:3]])
    expected = NOISE[[0, 3, 6]] * np.hypot(1, [0.0, 3.0, 1.0])
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(sizes), axis=0)), expected, rtol=0.08)


@pytest.mark.parametrize(
    ("dates", "sizes", "least"), [(4, 10, 0.7), (5, 5, 0.35), (5, 10, 0.9), (8, 5, 0.8), (8, 10, 0.98), (12, 5, 0.95)]
)
def test_a_step_is_found_with_its_date_and_its_size(dates, sizes, least):
    """Steps of 5 and 10 repeatability standard deviations, in one parameter and in all biases."""
    rng, hits, within, pulls, count = np.random.default_rng(5), 0, 0, [], 40
    for k in range(count):
        place = int(rng.integers(2, max(dates - 1, 3)))
        step = sizes * (np.arange(dates) >= place)
        names = ("bias_x",) if k % 2 else ("bias_x", "bias_y", "bias_z")
        entries = unit(rng, dates, changes=[(name, step) for name in names])
        changes = found(entries).get("bias_x", [])
        hits += bool(changes)
        steps = [change for change in changes if change.kind == STEP]
        within += any(change.first < place <= change.last for change in steps)
        pulls += [(change.size - sizes * NOISE[3] * np.sqrt(10)) / change.u for change in steps[:1]]
    assert hits >= least * count, hits
    assert within >= 0.8 * hits, (within, hits)
    assert np.mean(np.abs(pulls) < 2.2) >= 0.88  # Student's t with eleven degrees of freedom or more: 0.95


@pytest.mark.parametrize(("dates", "size", "least"), [(5, 12, 0.85), (12, 8, 0.9)])
def test_a_drift_is_found_with_its_rate(dates, size, least):
    rng, named, pulls, count = np.random.default_rng(6), 0, [], 40
    for _ in range(count):
        ramp = size * np.linspace(0, 1, dates)
        changes = found(unit(rng, dates, changes=[("bias_z", ramp)], days=90)).get("bias_z", [])
        named += (drift := [change.kind for change in changes[:1]] == [DRIFT])
        rate = size * NOISE[3] * np.sqrt(10) / ((dates - 1) * 90 / (365.25 / 12))
        pulls += [(changes[0].size - rate) / changes[0].u] if drift else []
    assert named >= least * count, named
    assert np.mean(np.abs(pulls) < 2.2) >= 0.88


def test_what_a_history_states(snapshot):
    """The change, what to do and when to recalibrate; a step that may be a drift; results that are too few for a change."""
    order, texts = np.arange(6), {}
    cases = {
        "nothing": [],
        "shock": [("bias_x", 15.0 * (order >= 4))],
        "shock in the last result": [("bias_x", 20.0 * (order >= 5))],
        "drift": [("bias_z", 4.0 * order)],
        "different value of gravity": [(f"dK_{axis}", 15.0 * (order >= 3)) for axis in "xyz"],
        "one wrong result": [("gamma_21", 20.0 * (order == 2))],
        "small shock": [("bias_x", 5.0 * (order >= 3))],
    }
    for title, changes in cases.items():
        texts[title] = unit(np.random.default_rng(4), 6, changes=changes, days=60)
    texts |= {f"{count} results": unit(np.random.default_rng(1), count) for count in (1, 2)}
    words = {k: words_of_history("A-17", unit_history(own, PAPER_LIMITS), 0.05) for k, own in texts.items()}
    snapshot("changes", {title: history_text(each) for title, each in words.items()})

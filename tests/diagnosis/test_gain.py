"""Cross-validation that repeats the choice of causes, against leaving the data out by hand."""

from dataclasses import replace

import numpy as np
import pytest

from tumblecal.diagnosis import Diagnoser
from tumblecal.diagnosis.causes.cause import EFFECT
from tumblecal.diagnosis.findings.fold_search import chosen_anew
from tumblecal.diagnosis.findings.gain import fold_errors
from tumblecal.effects.catalogue import read_rig_with_effects
from tumblecal.simulation.position_means import simulated


def test_fold_errors_are_those_of_fits_without_the_fold():
    rng = np.random.default_rng(0)
    design, values = rng.normal(size=(40, 6)), rng.normal(size=40)
    q, _ = np.linalg.qr(design)
    residual = values - q @ (q.T @ values)
    for rows in (np.arange(3), np.arange(10, 22)):
        others = np.setdiff1d(np.arange(40), rows)
        fitted = np.linalg.lstsq(design[others], values[others], rcond=None)[0]
        np.testing.assert_allclose(
            fold_errors(q[rows], residual[rows]), values[rows] - design[rows] @ fitted, atol=1e-12
        )


def test_a_clear_cause_is_chosen_in_every_fold(diagnoser, hidden):
    diagnosis = diagnoser(hidden(1, {"cross_coupling.y.yz": [1.5e-3]}))
    groups = np.arange(24)
    errors, same = chosen_anew(diagnosis.screened, groups)
    assert np.all(same)
    kept = diagnosis.gain.cv_rms_kept_g
    # The same causes everywhere: the same errors, but for the linearisation.
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(kept, rel=0.01)


def test_a_choice_by_luck_gains_less_than_it_seems(diagnoser, hidden):
    """On adequate data the best of all causes always seems to gain; chosen anew without each position it does not."""
    seeming, honest = [], []
    for seed in range(12):
        diagnosis = diagnoser(hidden(100 + seed, {}))
        search, causes, at = diagnosis.screened.search, diagnosis.screened.pool.causes, diagnosis.screened.at
        search.expand([()])
        singles = [k for k, cause in enumerate(causes) if cause.kind is EFFECT]
        best = min(singles, key=lambda k: search.left((k,)))
        block = causes[best].block
        q, _ = np.linalg.qr(np.hstack([at.reached, at.basis @ block]))
        rows = np.arange(72).reshape(24, 3)
        kept = fold_errors(q[rows], (at.residual - q @ (q.T @ at.residual))[rows])
        before = np.linalg.qr(at.reached)[0]
        nominal = fold_errors(before[rows], (at.residual - before @ (before.T @ at.residual))[rows])
        errors, _ = chosen_anew(diagnosis.screened, np.arange(24))
        seeming.append(np.mean(nominal**2) - np.mean(kept**2))
        honest.append(np.mean(nominal**2) - np.mean((errors / diagnosis.problem.sd) ** 2))
    assert np.mean(seeming) > 0.02
    assert np.mean(honest) < 0.5 * np.mean(seeming)


def test_equal_causes_are_told_in_an_order_that_rounding_does_not_turn(configs):
    """The temperature rises evenly in time there: what follows the one follows the other. Which was told first, and how many
    folds chose the same, hung on the last digit of the readings."""
    data = simulated(read_rig_with_effects(configs / "hidden_effect.toml"), 0)
    told = set()
    for seed in range(3):
        last_digits = 1.0 + 4e-16 * np.random.default_rng(seed).normal(size=data.readings.shape)
        diagnosis = Diagnoser()(replace(data, readings=data.readings * last_digits), noise_sd=1e-4)
        told.add((diagnosis.best.labels, diagnosis.best.equivalents[:3]))
        assert diagnosis.gain.cv_same_causes == 1.0
    ((labels, equivalents),) = told
    assert any("temperature" in label for other in equivalents for label in other)
    assert any("drift" in label for label in labels)
    # Two findings: a bias of x that follows either of the two, and the square of z, which has two forms at 1 g.
    drift, square = sorted(diagnosis.factors, key=lambda factor: factor.resolved)
    assert {("bias_drift.x",), ("bias_temperature.x",)} <= {*drift.members}
    assert "columns" in [reason.kind for reason in drift.reasons]
    assert square.members[0] == ("second_order.z",) and {reason.kind for reason in square.reasons} == {"identity"}

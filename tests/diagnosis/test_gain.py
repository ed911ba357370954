"""Cross-validation that repeats the choice of causes, against leaving the data out by hand."""

import numpy as np
import pytest

from tumblecal.diagnosis.findings.gain import chosen_anew, fold_errors


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

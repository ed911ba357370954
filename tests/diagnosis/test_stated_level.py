"""The uncertainty follows the noise that the data show, whatever level was stated; a stated level that holds is kept."""

from dataclasses import replace

import numpy as np
import pytest

import blind_instrument as blind
from blind_noise import position_set
from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.estimation.methods import calibrate
from tumblecal.show.fit import fit_words


FACTORS = (0.3, 1.0, 5.0, 14.0)


def measured(factor, by_columns, seed=3):
    """Positions whose sd is stated as `factor` times the true one, by columns or for all; the true sd of every reading."""
    rng = np.random.default_rng([seed, 71])
    setup = blind.random_setup(rng, 3, 8)
    clean = blind.readings(setup, setup.nominal, {})
    sd = blind.SIGMA * (rng.uniform(0.7, 1.4, clean.shape) if by_columns else np.ones(clean.shape))
    data = position_set(setup, clean + sd * rng.normal(size=sd.shape), known=by_columns)
    stated = {} if by_columns else {"noise_sd": factor * blind.SIGMA}
    return replace(data, sd=factor * sd) if by_columns else data, stated, setup, sd


@pytest.mark.parametrize("by_columns", [True, False], ids=["sd columns", "one sd"])
@pytest.mark.parametrize("factor", FACTORS)
def test_the_uncertainty_does_not_depend_on_a_wrong_stated_level(factor, by_columns):
    """It was 5 to 30 times too large for columns 14 times too large, and 0.3 times the true one for a stated sd too small."""
    data, stated, setup, sd = measured(factor, by_columns)
    made = calibrate(data, **stated)
    columns = blind.nominal_columns(setup) / sd.reshape(-1, 1)
    # The order of `blind`: dK, bias, gamma come first.
    truth = np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)))[:9]
    own = made.exact.sd[[made.exact.names.index(name) for name in SENSOR]]
    # 58 degrees of freedom tell the level to 9 %; that of this draw is the same in all cases.
    np.testing.assert_allclose(own / truth, 1.0, rtol=0.2)
    assert made.exact.noise == ("stated" if factor == 1.0 else "estimated")
    if made.level is None:
        assert factor == 1.0 or (factor < 1.0 and by_columns and made.floor is not None)
        return
    assert made.level.too_small == (factor < 1.0)
    assert made.level.factor == pytest.approx(1.0 / factor, rel=0.2)
    assert f"from the residuals: sd {made.level.factor * made.level.stated_g * 1e3:.2g} mg" in fit_words(
        made.exact, made.level
    ).text("noise")
    assert made.judgements[0].tone != "good"


def test_calibrate_and_diagnose_use_the_same_level(diagnoser):
    for factor, by_columns in ((0.3, False), (14.0, True)):
        data, stated, *_ = measured(factor, by_columns)
        diagnosis, made = diagnoser(data, **stated), calibrate(data, **stated).exact
        assert not diagnosis.members and diagnosis.noise_labels
        here, there = ([fit.names.index(name) for name in SENSOR] for fit in (made, diagnosis.extended))
        np.testing.assert_allclose(made.sd[here], diagnosis.extended.sd[there], rtol=0.03)


def test_a_wrong_prior_does_not_make_the_noise_level_wrong():
    data, stated, setup, _ = measured(1.0, False)
    wrong = {"bias": (setup.nominal["bias"][0] + 1.0, 1e-3)}
    made = calibrate(data, **stated, priors=wrong)
    assert made.exact.chi2_p_value < 1e-6 and made.level is None

"""Terms of a calibration in words: value and uncertainty to the same decimal, unit by the factors."""

import numpy as np

from tumblecal.certificate.term_words import term_words
from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_terms import Term


def test_terms_are_stated_with_unit_uncertainty_and_effect():
    terms = (
        Term("z", 0.5321e-3, (0, 0, 2), effect="second_order.z"),
        Term("y", -8.24e-4, (0, 1, 1), degc_power=1, reference_degc=25.0, effect="mine", determined=False),
        Term("x", 1e-4, (1, 0, 0), kind="abs", degc_power=2, reference_degc=20.0),
        Term("x", 2e-5, (1, 0, 0), kind="sign"),
        Term("x", 0.2e-3, per_hour=True, reference_s=60.0),
    )
    covariance = np.diag([1.0] * 12 + [0.0617e-3**2, 0.089e-3**2, 0, 0, 0]).tolist()
    extra = {"terms": [term.record() for term in terms], "covariance_with_terms": {"covariance": covariance}}
    calibration = Calibration(np.eye(3), np.zeros(3), np.eye(12), extra=extra)
    assert list(term_words(calibration)) == [
        "A_z: (0.532 +- 0.062) mg/g^2 u_z^2 (second_order.z)",
        "A_y: (-0.824 +- 0.089) mg/g^2/degC u_y u_z (T - 25 degC) (mine, determined only together with other parameters)",
        "A_x: 0.1 mg/g/degC^2 |u_x| (T - 20 degC)^2",
        "A_x: 0.02 mg sign(u_x)",
        "A_x: 0.2 mg/h (t - 60 s)",
    ]
    assert not list(term_words(Calibration(np.eye(3), np.zeros(3), np.eye(12))))

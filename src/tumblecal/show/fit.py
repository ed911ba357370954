"""Words on a fit that several results share: values, noise, gravity and pitch settings."""

import numpy as np

from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.estimation.contradicted import UNLIKELY, ContradictedLevel, dof_of_readings
from tumblecal.estimation.fit import Fit
from tumblecal.ground.gravity import normal_gravity
from tumblecal.show.words import Words, words_of


# The estimators.
TITLES = {"exact": "exact", "harmonic": "harmonic", "kalman": "Kalman"}
# More settings than these with so few rows each are not commanded settings.
_MANY, _ROWS_EACH = 8, 3
# Gravity at sea level.
_LEAST_MS2, _MOST_MS2 = normal_gravity(0.0), normal_gravity(90.0)


def fit_words(fit: Fit, level: ContradictedLevel | None = None) -> Words:
    """The blocks `values` (of the sensor, with U), `noise`, `gravity warning` (effect of an assumed gravity), `gravity`,
    `read settings` and `many settings`; empty if they do not apply.

    **Arguments:**

    - `level`: the stated noise level, if the residuals contradict it.
    """
    data, gravity = fit.data, fit.data.gravity
    shift, shift_u = 0.0, 0.0
    if gravity is not None and gravity.assumed:
        shift = max(gravity.value_ms2 / _LEAST_MS2 - 1.0, 1.0 - gravity.value_ms2 / _MOST_MS2)
        spread = [sd for name, sd in zip(fit.names, fit.sd, strict=True) if name.startswith("dK") and sd > 0]
        shift_u = shift / min(spread) if spread else 0.0
    called = data.pitch_setting_deg
    read = np.isin(called, called[~np.isclose(called, data.beta_deg, rtol=0.0, atol=1e-6)])
    settings = np.unique(called[read])
    errors = [leaf for leaf in fit.problem.chain.free if leaf.name == "dbeta" and (leaf.by or "").endswith("pitch")]
    count = sum(len(leaf.names) for leaf in errors)
    weighing, pooled = data.weighing_sd, 0.0
    if data.n is not None and weighing is not None and weighing is not data.sd:
        pooled = float(np.median(data.n)) if np.array_equal(fit.problem.sd, weighing) else 0.0
    return words_of(
        "fit",
        fit=fit,
        level=level,
        sensor=[name for name in SENSOR if name in fit.names],
        freedom=dof_of_readings(fit),
        unlikely=UNLIKELY,
        pooled=pooled,
        least=_LEAST_MS2,
        most=_MOST_MS2,
        shift=shift,
        shift_u=shift_u,
        settings=[f"{one:g}" for one in settings],
        angles=len(np.unique(data.beta_deg[read])),
        many=count if count > _MANY and count * _ROWS_EACH > len(data) else 0,
    )

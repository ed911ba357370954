"""Local gravity from latitude and height: the normal-gravity formula of the GRS 80 ellipsoid.

Somigliana's closed formula on the ellipsoid and the second-order free-air reduction (Moritz, Geodetic Reference
System 1980).
"""

import math


_EQUATOR_MS2 = 9.7803267715
_K = 0.001931851353
_E2 = 0.00669438002290
_A_M = 6378137.0
_F = 0.00335281068118
_M = 0.00344978600308


def normal_gravity(latitude_deg: float, height_m: float = 0.0) -> float:
    """Gravity in m/s^2.

    **Arguments:**

    - `latitude_deg`: geodetic latitude.
    - `height_m`: height over the ellipsoid; sea-level height differs by tens of metres, 3e-6 m/s^2 a metre.
    """
    s2 = math.sin(math.radians(latitude_deg)) ** 2
    surface = _EQUATOR_MS2 * (1 + _K * s2) / math.sqrt(1 - _E2 * s2)
    ratio = height_m / _A_M
    return surface * (1 - 2 * (1 + _F + _M - 2 * _F * s2) * ratio + 3 * ratio**2)

"""A triad taken out of its fixture and put back turned, by the blind instrument: plain numpy and scipy."""

import numpy as np
from scipy.spatial.transform import Rotation

import blind_instrument as blind
from tumblecal.data import PositionSet
from tumblecal.data.joined import joined


def passive(angles_deg):
    """Rx Ry Rz of frames by scipy: vectors turn the other way."""
    x, y, z = -np.radians(angles_deg)
    return (Rotation.from_euler("x", x) * Rotation.from_euler("y", y) * Rotation.from_euler("z", z)).as_matrix()


def measured(setup, nominal, turn_deg, rng, label=None, noise=blind.SIGMA, source="measured.csv", square_y=0.0):
    """Positions of the blind instrument, its triad turned in the fixture before its own small mount angles.

    `square_y`: a quadratic error of y.
    """
    f = np.tile([0.0, 0.0, 1.0], (len(setup.alpha), 1))
    f = blind.turned("y", setup.beta + nominal["dbeta"][setup.pitch], f)
    f = blind.turned("x", setup.alpha, f) @ passive(turn_deg).T
    u = blind.along_axes(blind.mounted(f, nominal["dtheta"]), nominal["gamma"])
    readings = (1 + nominal["dK"]) * u + nominal["bias"] + noise * rng.normal(size=u.shape)
    readings[:, 1] += square_y * u[:, 1] ** 2
    mount = None if label is None else (label,) * len(u)
    names = tuple(setup.names)
    return PositionSet(names, np.degrees(setup.alpha), np.degrees(setup.beta), readings, mount=mount, source=source)


def two(seed, first, second, plan=(3, 8), **options):
    """One sensor in two mountings, with the truth of the second."""
    rng = np.random.default_rng(seed)
    setup, other = blind.random_setup(rng, *plan), blind.random_setup(rng, *plan)
    nominal = setup.nominal | {name: other.nominal[name] for name in ("dbeta", "dtheta")}
    one = measured(setup, setup.nominal, first, rng, "A", **options)
    return joined([one, measured(setup, nominal, second, rng, "B", **options)]), setup.nominal, nominal

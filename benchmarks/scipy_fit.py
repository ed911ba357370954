"""What a user would write without tumblecal: Table 1 fitted with numpy and scipy alone.

python benchmarks/scipy_fit.py POSITIONS.csv
"""

import csv
import sys

import numpy as np
from scipy.optimize import least_squares


def predict(p, alpha, beta, setting):
    """Readings, g, by dK, bias, mount, gamma and the error of each pitch setting."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(p[6:9]), np.sin(p[6:9])
    about_x = np.array([[1, 0, 0], [0, cx, sx], [0, -sx, cx]])
    about_y = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]])
    about_z = np.array([[cz, sz, 0], [-sz, cz, 0], [0, 0, 1]])
    triad = np.array([[1, 0, 0], [p[9], 1, 0], [p[10], p[11], 1]])
    pitch = beta + p[12:][setting]
    force = np.stack([-np.sin(pitch), np.cos(pitch) * np.sin(alpha), np.cos(pitch) * np.cos(alpha)], axis=1)
    return (force @ (triad @ about_x @ about_y @ about_z).T) * (1 + p[:3]) + p[3:6]


def main():
    """Print the parameters and their standard deviations."""
    with open(sys.argv[1], encoding="utf-8") as file:
        rows = list(csv.reader(line for line in file if not line.startswith("#")))[1:]
    alpha, beta = (np.radians([float(row[column]) for row in rows]) for column in (1, 2))
    readings = np.array([[float(cell) for cell in row[3:6]] for row in rows])
    setting = np.unique(beta, return_inverse=True)[1]
    start = np.zeros(12 + setting.max() + 1)
    fit = least_squares(lambda p: (predict(p, alpha, beta, setting) - readings).ravel(), start, xtol=1e-12, ftol=1e-12)
    dof = readings.size - len(fit.x)
    sd = np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)) * 2 * fit.cost / dof)
    for value, deviation in zip(fit.x, sd, strict=True):
        print(f"{value * 1e3:10.4f} {deviation * 1e3:8.4f}")


if __name__ == "__main__":
    main()

"""The population `hand`: cubes set by hand at nominal angles, calibrated, next to pairs of opposite faces.

    python benchmarks/blind hand --cubes 200 --positions 6 12 24 --deg 0.5
    python benchmarks/blind hand --cubes 200 --positions 24 --deg 0 --unknown    # a dividing head: how often tilts are used

Random triads (bias 5 mg, dK 2e-3, non-orthogonality 3 mrad, mounting 0.5 deg, one standard deviation each) in a cube that is
rotated by random angles about each axis at each position: faces, then edges. Plain numpy.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

import tumblecal
from tumblecal.chain import nominal_chain
from tumblecal.data import PositionSet
from tumblecal.diagnosis.diagnose import Diagnoser
from tumblecal.effects import catalogue
from tumblecal.estimation import problem_of, where_of
from tumblecal.estimation.methods import exact_fit


tumblecal.enable_float64()

FACES = np.repeat(np.eye(3), 2, axis=0) * np.array([1, -1] * 3)[:, None]
EDGES = np.array(
    [np.insert(pair, axis, 0) for axis in range(3) for pair in ((1, 1), (-1, -1), (1, -1), (-1, 1))], float
) / np.sqrt(2)
PLANS = {
    6: FACES,
    10: np.vstack([FACES, EDGES[[0, 1, 6, 10]]]),
    12: np.vstack([FACES, EDGES[[0, 1, 4, 5, 8, 9]]]),
    24: np.vstack([FACES, FACES, EDGES]),
}
LEAVES = ("dK", "bias", "gamma")


def turned(rng: np.random.Generator, sd: float) -> np.ndarray:
    """A rotation by random angles about x, y and z (rad)."""
    (a, b, c), s, one = rng.normal(0.0, sd, 3), np.sin, np.cos
    about_x = np.array([[1, 0, 0], [0, one(a), s(a)], [0, -s(a), one(a)]])
    about_y = np.array([[one(b), 0, -s(b)], [0, 1, 0], [s(b), 0, one(b)]])
    about_z = np.array([[one(c), s(c), 0], [-s(c), one(c), 0], [0, 0, 1]])
    return about_x @ about_y @ about_z


def cube(positions: int, tilt_deg: float, noise_g: float, seed: int) -> tuple[PositionSet, np.ndarray]:
    """The position set of a cube, and its true dK, bias and gamma."""
    rng, up = np.random.default_rng(seed), PLANS[positions]
    bias, scale, gamma = rng.normal(0, 5e-3, 3), rng.normal(0, 2e-3, 3), rng.normal(0, 3e-3, 3)
    axes = np.array([[1, 0, 0], [gamma[0], 1, 0], [gamma[1], gamma[2], 1]]) @ turned(rng, np.radians(0.5))
    force = np.array([turned(rng, np.radians(tilt_deg)) @ direction for direction in up])
    readings = force @ axes.T * (1 + scale) + bias + rng.normal(0, noise_g, up.shape)
    alpha, beta = np.degrees(np.arctan2(up[:, 1], up[:, 2])), np.degrees(np.arcsin(-up[:, 0]))
    names = tuple(f"p{number}" for number in range(len(up)))
    data = PositionSet(names, np.round(alpha, 9), np.round(beta, 9), readings, source="cube.csv")
    return data, np.concatenate([scale, bias, gamma])


def fitted(data: PositionSet, noise_g: float | None, stated: str, diagnoser: Diagnoser | None):
    """The fit of `calibrate`, or of the diagnosis, and whether it includes tilts."""
    data = replace(data, comments={"attitudes": stated}) if stated else data
    chain = nominal_chain(where_of(data)).fixed({"dbeta"})
    if diagnoser:
        fit = diagnoser(data, chain=chain, noise_sd=noise_g).extended
        return fit, any(name.startswith("tilt") for name in fit.names)
    found = exact_fit(problem_of(data, chain, noise_sd=noise_g), by_columns=False)
    return found.fit, found.scatter is not None


def main(words: Sequence[str]) -> None:
    """A row for each number of positions, tilt and noise."""
    parser = argparse.ArgumentParser(prog="blind hand")
    parser.add_argument("--cubes", type=int, default=200)
    parser.add_argument("--positions", type=int, nargs="*", default=[*PLANS])
    parser.add_argument("--deg", type=float, nargs="*", default=[0.1, 0.5, 2.0])
    parser.add_argument("--noise-mg", type=float, nargs="*", default=[0.1, 1.0])
    parser.add_argument("--unknown", action="store_true", help="the noise is not stated")
    parser.add_argument("--stated", choices=("hand", "head"), default="", help="how the attitudes were set")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--diagnose", action="store_true", help="the fit of the diagnosis")
    asked = parser.parse_args(words)
    diagnoser = Diagnoser(catalogue()) if asked.diagnose else None
    print("| positions | tilt / deg | noise / mg | tilts used | rms error of bias / mg: pairs | fit | median u / mg | "
          "covered: bias | dK | gamma |")  # fmt: skip
    print("|---" * 10 + "|")
    for positions, deg, noise_mg in product(asked.positions, asked.deg, asked.noise_mg):
        errors, u, halves, of_pairs, used = [], [], [], [], []
        for number in range(asked.cubes):
            data, truth = cube(positions, deg, 1e-3 * noise_mg, asked.seed + number)
            fit, tilts = fitted(data, None if asked.unknown else 1e-3 * noise_mg, asked.stated, diagnoser)
            here = [k for k, name in enumerate(fit.names) if name.partition("_")[0] in LEAVES]
            errors.append(fit.values[here] - truth)
            u.append(fit.sd[here])
            halves.append(np.ptp(fit.interval(0.95), axis=1)[here] / 2)
            of_pairs.append(np.diag(data.readings[0:6:2] + data.readings[1:6:2]) / 2 - truth[3:6])
            used.append(tilts)
        inside = np.abs(errors) <= np.array(halves)
        rms = [f"{1e3 * np.sqrt(np.mean(np.square(own))):.3f}" for own in (of_pairs, np.array(errors)[:, 3:6])]
        covered = [f"{np.mean(inside[:, part]):.1%}" for part in (slice(3, 6), slice(0, 3), slice(6, 9))]
        cells = [positions, f"{deg:g}", f"{noise_mg:g}", f"{np.mean(used):.0%}", *rms]
        print(
            "|",
            " | ".join(map(str, [*cells, f"{1e3 * np.median(np.array(u)[:, 3:6]):.3f}", *covered])),
            "|",
            flush=True,
        )

"""Coverage of 95 % intervals for cubes set by hand at nominal angles, against pairs of opposite faces.

The simulator is numpy only and shares no code with the chain: a random triad (bias 5 mg, dK 2e-3, non-orthogonality 3 mrad,
mounting 0.5 deg, one sd each) in a cube that is rotated by a random angle about each axis at each position. Positions: faces,
then edges.

    python benchmarks/hand_set.py --cubes 200                    # noise stated
    python benchmarks/hand_set.py --cubes 200 --unknown          # noise estimated
    python benchmarks/hand_set.py --cubes 200 --positions 6 --deg 0.5 --noise-mg 0.1 --diagnose
    python benchmarks/hand_set.py --cubes 200 --positions 24 --deg 0 --unknown   # a dividing head: how often tilts are used
"""

import argparse
from dataclasses import replace

import numpy as np

import tumblecal
from tumblecal.chain import nominal_chain
from tumblecal.data import PositionSet
from tumblecal.diagnosis.diagnose import Diagnoser
from tumblecal.effects import catalogue
from tumblecal.estimation import problem_of, where_of
from tumblecal.estimation.methods import exact_fit


tumblecal.enable_float64()

FACES = np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], float)
EDGES = np.array(
    [np.insert(pair, axis, 0) for axis in range(3) for pair in ((1, 1), (-1, -1), (1, -1), (-1, 1))], float
) / np.sqrt(2)
PLANS = {
    6: FACES,
    10: np.vstack([FACES, EDGES[[0, 1, 6, 10]]]),
    12: np.vstack([FACES, EDGES[[0, 1, 4, 5, 8, 9]]]),
    24: np.vstack([FACES, FACES, EDGES]),
}


def turned(rng, sd):
    """A rotation by random angles about x, y and z (rad)."""
    (a, b, c), s, one = rng.normal(0.0, sd, 3), np.sin, np.cos
    about_x = np.array([[1, 0, 0], [0, one(a), s(a)], [0, -s(a), one(a)]])
    about_y = np.array([[one(b), 0, -s(b)], [0, 1, 0], [s(b), 0, one(b)]])
    about_z = np.array([[one(c), s(c), 0], [-s(c), one(c), 0], [0, 0, 1]])
    return about_x @ about_y @ about_z


def cube(positions, tilt_deg, noise_g, seed):
    """The position set of a cube at nominal angles, and its true dK, bias and gamma."""
    rng, up = np.random.default_rng(seed), PLANS[positions]
    bias, scale, gamma = rng.normal(0, 5e-3, 3), rng.normal(0, 2e-3, 3), rng.normal(0, 3e-3, 3)
    axes = np.array([[1, 0, 0], [gamma[0], 1, 0], [gamma[1], gamma[2], 1]]) @ turned(rng, np.radians(0.5))
    force = np.array([turned(rng, np.radians(tilt_deg)) @ direction for direction in up])
    readings = force @ axes.T * (1 + scale) + bias + rng.normal(0, noise_g, up.shape)
    alpha, beta = np.degrees(np.arctan2(up[:, 1], up[:, 2])), np.degrees(np.arcsin(-up[:, 0]))
    names = tuple(f"p{number}" for number in range(len(up)))
    data = PositionSet(names, np.round(alpha, 9), np.round(beta, 9), readings, source="cube.csv")
    return data, np.concatenate([scale, bias, gamma])


def pairs(data):
    """Biases by the three pairs of opposite faces, g."""
    return np.diag(data.readings[0:6:2] + data.readings[1:6:2]) / 2


def fitted(data, noise_g, stated, diagnoser):
    """The fit as in `calibrate`, or that of the diagnosis, and whether tilts are in it."""
    if stated:
        data = replace(data, comments={"attitudes": stated})
    chain = nominal_chain(where_of(data)).fixed({"dbeta"})
    if diagnoser:
        fit = diagnoser(data, chain=chain, noise_sd=noise_g).extended
        return fit, any(name.startswith("tilt") for name in fit.names)
    found = exact_fit(problem_of(data, chain, noise_sd=noise_g), by_columns=False)
    return found.fit, found.scatter is not None


def main():
    """Run the study and print a line for each case."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--cubes", type=int, default=200)
    options.add_argument("--positions", type=int, nargs="*", default=[*PLANS])
    options.add_argument("--deg", type=float, nargs="*", default=[0.1, 0.5, 2.0])
    options.add_argument("--noise-mg", type=float, nargs="*", default=[0.1, 1.0])
    options.add_argument("--unknown", action="store_true", help="the noise is not stated")
    options.add_argument("--stated", choices=("hand", "head"), help="how the attitudes were set; default: not stated")
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--diagnose", action="store_true", help="the fit of the diagnosis")
    given = options.parse_args()
    diagnoser = Diagnoser(catalogue()) if given.diagnose else None
    print("positions  tilt/deg  noise/mg  used   rms error of bias/mg: pairs  fit   u    covered: bias    dK  gamma")
    for positions in given.positions:
        for deg in given.deg:
            for noise_mg in given.noise_mg:
                errors, sds, halves, of_pairs, used = [], [], [], [], []
                for number in range(given.cubes):
                    noise_g = 1e-3 * noise_mg
                    data, truth = cube(positions, deg, noise_g, given.seed + number)
                    fit, scattered = fitted(data, None if given.unknown else noise_g, given.stated, diagnoser)
                    here = [k for k, name in enumerate(fit.names) if name.partition("_")[0] in ("dK", "bias", "gamma")]
                    errors.append(fit.values[here] - truth)
                    sds.append(fit.sd[here])
                    halves.append(np.ptp(fit.interval(0.95), axis=1)[here] / 2)
                    of_pairs.append(pairs(data) - truth[3:6])
                    used.append(scattered)
                errors, inside = np.array(errors), np.abs(errors) <= np.array(halves)
                rms = [1e3 * np.sqrt(np.mean(np.square(each))) for each in (of_pairs, errors[:, 3:6])]
                covered = [100 * np.mean(inside[:, part]) for part in (slice(3, 6), slice(0, 3), slice(6, 9))]
                print(
                    f"{positions:9d}  {deg:8g}  {noise_mg:8g}  {100 * np.mean(used):3.0f} %  {rms[0]:27.3f}  {rms[1]:.3f}"
                    f"  {1e3 * np.median(np.array(sds)[:, 3:6]):.3f}  {covered[0]:13.1f}  {covered[1]:5.1f}  {covered[2]:5.1f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()

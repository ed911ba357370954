"""Hand-held sets in which nothing is wrong: how often is something named, and are the p-values uniform?

    python benchmarks/hand_held_null.py --cases 1000 --seed 1

`--hidden 5` hides in each an effect of which five sigma (norm over all readings) are beyond the reach of the nominal model.

Attitudes at random over the sphere, 20 to 40 of them; biases to 0.2 g, scale errors to 3 %, misalignments to 5 degrees;
noise of 0.05 to 2 mg, stated in half of the sets. Simulated in plain numpy and scipy. The readings are given in g.
"""

import argparse
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy import stats
from scipy.spatial.transform import Rotation

import tumblecal


tumblecal.enable_float64()
from tumblecal.data import PositionSet, read_positions  # noqa: E402
from tumblecal.diagnosis import Diagnoser  # noqa: E402
from tumblecal.ground.errors import InputError  # noqa: E402


def hidden_effect(rng: np.random.Generator, f: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """A nonlinearity of one axis by the attitudes (positions, 3), so large that a norm of one is left of it by the linear triad
    with free attitudes."""
    x, y, z = f.T
    shapes = [x * x, y * y, z * z, x**3, y**3, z**3, x * y, x * z, y * z, abs(x), abs(y), abs(z)]
    signal = np.zeros_like(f)
    signal[:, rng.integers(3)] = shapes[rng.integers(len(shapes))]
    tilts = np.stack([np.linalg.svd(own[None])[2][1:] for own in f]) @ matrix.T
    columns = np.zeros((len(f), 3, 12 + 2 * len(f)))
    for axis in range(3):
        columns[:, axis, 4 * axis : 4 * axis + 4] = np.column_stack([f, np.ones(len(f))])
    for k in range(len(f)):
        columns[k, :, 12 + 2 * k : 14 + 2 * k] = tilts[k].T
    q, size, _ = np.linalg.svd(columns.reshape(signal.size, -1), full_matrices=False)
    reached = q[:, size > 1e-9 * size[0]]
    left = signal.ravel() - reached @ (reached.T @ signal.ravel())
    return signal / np.linalg.norm(left)


def null_set(rng: np.random.Generator, count: int, path: Path, hidden: float = 0.0) -> PositionSet:
    """A hand-held set of an imperfect, linear triad; the noise is stated in half of them. `hidden`: what is left of an effect
    in it, sigma."""
    f = Rotation.random(count, random_state=rng).apply([0.0, 0.0, 1.0])
    skew = np.eye(3) + np.tril(np.radians(rng.uniform(-5, 5, (3, 3))), -1)
    sd = 10 ** rng.uniform(-4.3, -2.7)
    matrix = (1 + rng.uniform(-0.03, 0.03, 3))[:, None] * skew
    readings = f @ matrix.T + rng.uniform(-0.2, 0.2, 3)
    readings = readings + sd * rng.normal(size=readings.shape)
    stated = rng.uniform() < 0.5
    if hidden:
        readings = readings + hidden * sd * hidden_effect(rng, f, matrix)
    header = "position,ax_g,ay_g,az_g" + (",ax_sd_g,ay_sd_g,az_sd_g" if stated else "")
    rows = [
        ",".join([f"p{k}", *map(repr, row), *([repr(float(sd))] * 3 * stated)])
        for k, row in enumerate(readings.tolist())
    ]
    path.write_text("\n".join(["# attitudes: unknown", header, *rows]) + "\n", encoding="utf-8")
    return read_positions(path)


def main() -> None:
    """Alarms and the Kolmogorov-Smirnov test of the p-values, known and unknown noise apart."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--detail", action="store_true", help="a line a set")
    parser.add_argument("--hidden", type=float, default=0.0, help="an effect of so many sigma in each")
    args = parser.parse_args()
    with TemporaryDirectory() as folder:
        run(args.cases, args.seed, Path(folder) / "hand.csv", hidden=args.hidden, verbose=args.detail)


def run(cases: int, seed: int, path: Path, *, hidden: float, verbose: bool) -> None:
    """Diagnose so many sets, each written to `path` and read from there; `hidden` as of `null_set`."""
    diagnoser, p_values, said = Diagnoser(nested=False), {True: [], False: []}, Counter()
    for number in range(cases):
        rng = np.random.default_rng([seed, number])
        try:
            diagnosis = diagnoser(null_set(rng, (20, 30, 40)[number % 3], path, hidden))
        except InputError as refused:
            said[f"refused: {str(refused)[:60]}"] += 1
            continue
        known = diagnosis.problem.known and not diagnosis.noise_labels
        p_values[known].append(diagnosis.assumed_p_value)
        labels = sorted({label.split(":")[0] for label in diagnosis.labels})
        if verbose:
            print(number, diagnosis.verdict, *labels, f"p = {diagnosis.assumed_p_value:.3g}", flush=True)
        said[" + ".join(labels) or diagnosis.verdict] += 1
    for known, values in p_values.items():
        if values:
            test = stats.kstest(values, "uniform")
            print(
                f"{'stated' if known else 'unknown'} noise: {len(values)} sets, Kolmogorov-Smirnov p = {test.pvalue:.3g}"
            )
    for words, count in said.most_common():
        print(f"{count:5d}  {words}")


if __name__ == "__main__":
    main()

"""Hand-held sets in which nothing is wrong: how often is something named, and are the p-values uniform?

    python benchmarks/hand_held_null.py --cases 1000 --seed 1

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


def null_set(rng: np.random.Generator, count: int, path: Path) -> PositionSet:
    """A hand-held set of an imperfect, linear triad; the noise is stated in half of them."""
    f = Rotation.random(count, random_state=rng).apply([0.0, 0.0, 1.0])
    skew = np.eye(3) + np.tril(np.radians(rng.uniform(-5, 5, (3, 3))), -1)
    sd = 10 ** rng.uniform(-4.3, -2.7)
    readings = (1 + rng.uniform(-0.03, 0.03, 3)) * (f @ skew.T) + rng.uniform(-0.2, 0.2, 3)
    readings = readings + sd * rng.normal(size=readings.shape)
    stated = rng.uniform() < 0.5
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
    args = parser.parse_args()
    with TemporaryDirectory() as folder:
        run(args.cases, args.seed, Path(folder) / "hand.csv", args.detail)


def run(cases: int, seed: int, path: Path, verbose: bool) -> None:
    """Diagnose so many sets, each written to `path` and read from there."""
    diagnoser, p_values, said = Diagnoser(nested=False), {True: [], False: []}, Counter()
    for number in range(cases):
        rng = np.random.default_rng([seed, number])
        try:
            diagnosis = diagnoser(null_set(rng, (20, 30, 40)[number % 3], path))
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

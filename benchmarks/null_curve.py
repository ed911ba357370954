"""The null distribution of the global test: fit its curve, or test it on plans that it was not fitted to.

    python benchmarks/null_curve.py fit
    python benchmarks/null_curve.py test --draws 4000

`fit` prints the table of `diagnosis/detection/null_curve.py`; `test` the probability that data without errors exceed the
threshold for 1 % and 0.1 %. Both by importance sampling (Naiman and Priebe 2001): three draws in ten are noise alone; in the
others one cause, by its share of the false alarms, explains as much as it needs for one. The likelihood ratio is a count of
causes.
"""

from collections.abc import Iterator

import numpy as np
from scipy import special, stats

import blind_instrument as blind
from blind.acting import direction
from blind_noise import position_set
from command_line import asked
from stated_sd import recorded
from tumblecal.data import PositionSet
from tumblecal.data.positions import attitudes_of
from tumblecal.diagnosis import Diagnoser
from tumblecal.diagnosis.detection import null_curve
from tumblecal.diagnosis.detection.detect import statistics, weight_of
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.full_model.evidence import log_evidence, log_evidence_of_noise
from tumblecal.ground.precision import enable_float64


# Positions and pitch settings: on a regular grid, in random order, or at random angles.
FIT = {
    "grid": "12/3 18/3 24/3 32/4 48/4 60/5 80/5 48/3 42/7 72/3 120/6",
    "shuffled": "24/3 48/4 40/5",
    "random": "12/3 15/3 16/4 18/4 20/3 24/3 30/6 36/5 48/4 60/4 100/5",
}
TEST = {
    "grid": "15/3 24/4 50/5 36/3 70/7",
    "shuffled": "30/3 48/6 64/4",
    "random": "14/3 16/3 21/3 22/3 26/5 28/6 33/4 40/4 54/6 72/3 90/9 110/5",
}
STATISTIC = np.array([-3.2, -2.9, -2.7, -2.4, -2.0, -1.4, -0.6, 0.2, 1.0, 2.2, 4.0, 7.0])
LEVELS, OF_NOISE = (-2.0, -1.0, 0.0, 1.5), 0.3


def measured(kind: str, count: int, settings: int, seed: int) -> tuple[blind.Setup, np.ndarray]:
    """A setup with a plan of a kind, and its readings without any error but noise."""
    rng = np.random.default_rng([seed, count, settings, *map(ord, kind)])
    setup = blind.random_setup(rng, settings, -(-count // settings))
    if kind == "shuffled":
        order = rng.permutation(count)
        setup.alpha, setup.beta, setup.pitch = setup.alpha[order], setup.beta[order], setup.pitch[order]
    if kind == "random":
        setup.alpha = np.radians(np.round(rng.uniform(0, 360, len(setup.alpha)), 1))
        setup.beta = np.radians(np.sort(rng.choice(np.arange(0, 91, 5), settings, replace=False)))[setup.pitch]
    clean = blind.readings(setup, setup.nominal, {})
    return setup, clean + blind.SIGMA * rng.normal(size=clean.shape)


def plans(listed: dict[str, str], seed: int) -> Iterator[tuple[str, PositionSet, dict]]:
    """Each plan, with the noise stated and unknown."""
    for kind, sizes in listed.items():
        for text in sizes.split():
            made = measured(kind, *map(int, text.split("/")), seed)
            for known in (True, False):
                yield f"{kind} {text} {'known' if known else 'unknown'}", position_set(*made, known), {}


def others(seed: int) -> Iterator[tuple[str, PositionSet, dict]]:
    """Unknown attitudes, correlated noise, priors."""
    for count in (20, 40, 80):
        setup, readings = measured("random", count, 4, seed)
        rng = np.random.default_rng([seed, count])
        units = np.array([direction(rng) for _ in range(count)])
        readings = blind.sensed(setup, units, setup.nominal, {}) + blind.SIGMA * rng.normal(size=units.shape)
        for known in (True, False):
            sd = np.full(units.shape, blind.SIGMA) if known else None
            names = tuple(f"h{k}" for k in range(count))
            data = PositionSet(names, *attitudes_of(readings), readings, sd=sd, comments={"attitudes": "unknown"})
            yield f"hand {count} {'known' if known else 'unknown'}", data, {}
    for kind in ("flicker", "walk", "Gauss-Markov"):
        yield kind, recorded(kind, seed)[0], {}
    priors = {name: (0.0, sd) for name, sd in (("dK_x", 3e-3), ("bias_x", 3e-3), ("gamma_21", 1e-3), ("dbeta_1", 3e-3))}
    yield "priors known", position_set(*measured("grid", 24, 3, seed), True), {"priors": priors}


def sampled(of: Screened, draws: int, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Statistics, and the weight of each draw."""
    known, dof, rng = of.problem.known, of.at.dof, np.random.default_rng(seed)
    pool = of.pool.in_units_of(of.at.rough_level)
    blocks = [each for each in pool.tested if len(each.ranks)]
    ranks, weights = (np.concatenate([getattr(each, name) for each in blocks]) for name in ("ranks", "log_weights"))
    columns = [each.columns[:, a : a + r] for each in blocks for a, r in zip(each.first, each.ranks, strict=True)]
    tails = np.zeros((len(LEVELS), len(ranks)))
    for rank in np.unique(ranks).tolist():
        x = np.linspace(0, 160, 4001) if known else np.linspace(0, 1, 4001)[:-1]
        score = _gain(x, 1.0, rank, dof, known)
        sf = stats.chi2.sf(x, rank) if known else special.betainc(max(dof - rank, 0.5) / 2, rank / 2, 1 - x)
        rising, own = np.isfinite(score), ranks == rank
        score = np.maximum.accumulate(score[rising])
        tails[:, own] = np.interp(np.array(LEVELS)[:, None] - weights[own], score, sf[rising], right=0.0)
    sums, z = tails.sum(axis=1), rng.standard_normal((draws, dof))
    level = np.where(rng.uniform(size=draws) < OF_NOISE, -1, rng.integers(len(LEVELS), size=draws))
    for row in np.flatnonzero(level >= 0):
        cause = rng.choice(len(ranks), p=tails[level[row]] / sums[level[row]])
        tail, rank, block = rng.uniform() * tails[level[row], cause], ranks[cause], columns[cause]
        along = block.T @ z[row]
        rest, direction = z[row] - block @ along, block @ along / np.linalg.norm(along)
        if known:
            z[row] = rest + direction * np.sqrt(special.chdtri(rank, tail))
        else:
            share = special.betaincinv(rank / 2, (dof - rank) / 2, 1 - tail)
            unit = np.sqrt(share) * direction + np.sqrt(1 - share) * rest / np.linalg.norm(rest)
            z[row] = np.linalg.norm(z[row]) * unit
    total, ratio = np.vecdot(z, z)[:, None], np.full(draws, OF_NOISE)
    for each in blocks:
        explained = np.add.reduceat((z @ each.columns) ** 2, each.first, axis=1)
        scores = _gain(explained, total, each.ranks, dof, known) + each.log_weights
        for own, lowest in zip(sums, LEVELS, strict=True):
            ratio += (1 - OF_NOISE) / len(LEVELS) * np.sum(scores > lowest, axis=1) / own
    return statistics(pool, of.alternatives, z, known), 1 / ratio


def _gain(explained, total, ranks, dof: int, known: bool) -> np.ndarray:
    total = np.broadcast_to(total, explained.shape)
    return log_evidence(total, [(explained, ranks)], dof, known) - log_evidence_of_noise(total, dof, known)


def null_of(of: Screened) -> tuple[int, bool, float]:
    """Degrees of freedom, whether the noise is known, and the weights: arguments of the curve."""
    return of.at.dof, of.problem.known, weight_of(of.pool, of.alternatives, of.at.rough_level)


def fit(cases: list[tuple[Screened, np.ndarray, np.ndarray]]) -> None:
    """Print the table: at each statistic least squares in 1 and 1/nu, one slope for known and one for unknown noise."""
    rows, log_p = [], []
    for of, drawn, weight in cases:
        nu, known, total = null_of(of)
        shift = np.log(total / null_curve._WEIGHT)
        log_p.append([np.log(np.mean(weight * (drawn > s + shift))) for s in STATISTIC])
        rows.append([1.0, known / nu, (not known) / nu])
    table = np.linalg.lstsq(np.array(rows), np.array(log_p), rcond=None)[0]
    for name, values in zip(("_STATISTIC", "_LIMIT", "_KNOWN", "_UNKNOWN"), (STATISTIC, *table), strict=True):
        print(f"{name} = np.array([{', '.join(f'{value:.4g}' for value in values)}])")


def main() -> None:
    given = asked(__doc__, part=("fit", "test"), draws=4000, seed=1)
    enable_float64()
    listed = plans(FIT, given.seed) if given.part == "fit" else (*plans(TEST, given.seed), *others(given.seed))
    cases, diagnoser = [], Diagnoser(nested=False)
    for name, data, options in listed:
        of = diagnoser.begun(data, **options).screened
        drawn, weight = sampled(of, given.draws)
        cases.append((of, drawn, weight))
        sizes = [np.mean(weight * (drawn > null_curve.threshold(size, *null_of(of)))) for size in (0.01, 0.001)]
        print(f"{name:24} nu {of.at.dof:4}  1 %: {sizes[0]:7.2%}  0.1 %: {sizes[1]:7.3%}", flush=True)
    if given.part == "fit":
        fit(cases)


if __name__ == "__main__":
    main()

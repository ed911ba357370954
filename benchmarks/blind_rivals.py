"""What a user would do instead, and the best that anyone could do, on the same cases as the blind study.

- stepwise: forward regression of the nominal residuals on the catalogue's terms, an effect at a time, entering at
  p < 0.01 (F test) and leaving at p > 0.05;
- lasso: scikit-learn's LassoLarsIC (BIC) on the same terms, an effect named when one of its terms is kept;
- clairvoyant: for single effects, the Bayes-optimal test and classifier that knows sigma, the true linearisation, the
  list, and exactly how the study draws sizes and directions.
"""

import warnings

import numpy as np
from scipy import stats
from scipy.special import logsumexp

import blind_instrument as blind


DRAWS = 150


def terms(setup: blind.Setup, projector: np.ndarray) -> dict[str, np.ndarray]:
    """Each effect's terms after projection, columns in sigma per unit; effects hardly visible are left out."""
    plain = blind.readings(setup, setup.nominal, {})
    listed = {}
    for name, count in blind.COEFFICIENTS.items():
        columns = []
        taus = np.array([0.1, 0.2, 0.4]) * np.ptp(setup.time_s) if name == "warm_up" else [None]
        for tau in taus:
            for k in range(count):
                unit = np.zeros(count)
                unit[k] = 1e-8 if "drift" in name else 1e-5
                coefficients = unit if tau is None else [*unit, tau]
                change = blind.readings(setup, setup.nominal, {name: coefficients}) - plain
                columns.append(change.ravel() / blind.SIGMA / np.max(unit))
        whole = np.stack(columns, axis=1)
        projected = projector @ whole
        if np.linalg.norm(projected) > 0.05 * np.linalg.norm(whole):
            listed[name] = projected / np.linalg.norm(whole, axis=0)
    return listed


def residual(setup: blind.Setup, projector: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Residual of the nominal model linearised at the truth, in sigma (kinder to the rivals than a real fit)."""
    return projector @ (measured - blind.readings(setup, setup.nominal, {})).ravel() / blind.SIGMA


def stepwise(
    listed: dict[str, np.ndarray], rest: np.ndarray, dof: int, enter: float = 0.01, leave: float = 0.05
) -> set[str]:
    """Effects kept by forward selection with backward steps."""
    chosen: list[str] = []

    def left(names: list[str]) -> tuple[float, int]:
        if not names:
            return float(rest @ rest), 0
        basis = _span(np.hstack([listed[name] for name in names]))
        return float(rest @ rest - np.sum((basis.T @ rest) ** 2)), basis.shape[1]

    def p_value(small: list[str], large: list[str]) -> float:
        (more, rank_small), (less, rank_large) = left(small), left(large)
        extra, free = rank_large - rank_small, dof - rank_large
        if extra <= 0 or free <= 0:
            return 1.0
        return float(stats.f.sf((more - less) / extra / (less / free), extra, free))

    for _ in range(8):
        best = min((p_value(chosen, [*chosen, name]), name) for name in listed if name not in chosen)
        if best[0] > enter:
            break
        chosen.append(best[1])
        for name in list(chosen):
            others = [other for other in chosen if other != name]
            if p_value(others, chosen) > leave:
                chosen = others
    return set(chosen)


def lasso(listed: dict[str, np.ndarray], rest: np.ndarray, dof: int) -> set[str]:
    """Effects with a term kept by the lasso, its penalty chosen by BIC."""
    from sklearn.linear_model import LassoLarsIC

    columns = np.hstack(list(listed.values()))
    owner = [name for name, block in listed.items() for _ in range(block.shape[1])]
    norms = np.linalg.norm(columns, axis=0)
    seen = norms > 1e-3
    # The projected rows have only `dof` dimensions: turn to them, so that BIC counts rightly.
    _, _, right = np.linalg.svd(np.hstack([columns, rest[:, None]]).T, full_matrices=False)
    right = right[:dof]
    variance = None if columns.shape[1] < dof else 1.0
    model = LassoLarsIC(criterion="bic", fit_intercept=False, noise_variance=variance)
    with warnings.catch_warnings():
        # Its path ends early among collinear terms and says so.
        warnings.simplefilter("ignore")
        model.fit(right @ (columns[:, seen] / norms[seen]), right @ rest)
    return {
        name
        for name, keep, value in zip(np.array(owner)[seen], seen[seen], model.coef_, strict=True)
        if keep and abs(value) > 1e-9
    }


class Clairvoyant:
    """Knows sigma, list, size d and the law of the directions; false alarms one in a hundred."""

    def __init__(self):
        self.thresholds: dict[tuple, float] = {}

    def __call__(self, listed: dict[str, np.ndarray], rest: np.ndarray, d: float, rng: np.random.Generator) -> str:
        """The name given, or "" for adequate."""
        signals = {name: self._signals(block, d, rng) for name, block in listed.items()}
        key = (len(rest), d)
        if key not in self.thresholds:
            null = rng.normal(size=(1500, len(rest)))
            totals = logsumexp([_average(block, null, d) for block in signals.values()], axis=0)
            self.thresholds[key] = float(np.quantile(totals, 0.99))
        scores = {name: float(_average(block, rest[None], d)[0]) for name, block in signals.items()}
        if logsumexp(list(scores.values())) < self.thresholds[key]:
            return ""
        return max(scores, key=lambda name: scores[name])

    def _signals(self, block: np.ndarray, d: float, rng: np.random.Generator) -> np.ndarray:
        per = block.shape[1] if block.shape[1] != 9 else 3
        if per == 1:
            rows = np.stack([block[:, 0], -block[:, 0]])
        else:
            groups = [block[:, start : start + per] for start in range(0, block.shape[1], per)]
            rows = np.concatenate([rng.normal(size=(DRAWS, per)) @ group.T for group in groups])
        return rows * d / np.linalg.norm(rows, axis=1, keepdims=True)


def _average(signals: np.ndarray, z: np.ndarray, d: float) -> np.ndarray:
    """Log likelihood ratio averaged over the law of the signal, for every row of z."""
    return logsumexp(z @ signals.T - 0.5 * d * d, axis=1) - np.log(len(signals))


def _span(columns: np.ndarray) -> np.ndarray:
    left, singular, _ = np.linalg.svd(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-12), full_matrices=False)
    return left[:, singular > 1e-2]

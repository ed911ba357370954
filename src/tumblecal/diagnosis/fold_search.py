"""The causes chosen anew without each fold of a cross-validation, and what they then predict of it.

For every fold the search is made on the linearised chain without it: the fold's readings are given free values, which is the
same as leaving them out; what was chosen is fitted to the rest and predicts the fold. A gain so measured is that of the whole
procedure, not of a lucky choice. The folds are searched side by side: what differs is only which directions are set aside.
"""

from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.evidence import log_evidence
from tumblecal.diagnosis.gain import fold_errors
from tumblecal.diagnosis.partial_set import evidence_of_each, evidence_with_each, partial_set
from tumblecal.diagnosis.pool import Pool
from tumblecal.diagnosis.screen import Screened
from tumblecal.diagnosis.search import MOST
from tumblecal.diagnosis.set_prior import log_prior, log_priors_with_each
from tumblecal.diagnosis.tuning import HOPELESS, SIZE_PRIOR


# A direction of the residual space that a fold takes with it.
_TAKEN = 1e-6
# The search begins from the best single causes without the fold, and from the best sets of all data and their parts.
_SINGLES, _SETS = 4, 4
_MOST_ROUNDS = 8
# Further causes are those that come this near (log) in a set of all data; of one left-out fold no other gains so much.
_NEAR = 8.0
# So many sets, and numbers of one array, are scored at once.
_AT_ONCE, _NUMBERS_AT_ONCE = 256, 2_000_000

Members = tuple[int, ...]
# A fold and a set of causes.
_FoldSet = tuple[int, Members]
# Causes that a set may be enlarged by, and their numbers in the whole pool.
_Further = tuple[Pool, Int[np.ndarray, " further"]]


def chosen_anew(
    screened: Screened, groups: Int[np.ndarray, " positions"]
) -> tuple[Float[np.ndarray, "positions 3"], Bool[np.ndarray, " folds"]]:
    """Prediction errors of every fold, the causes chosen without it.

    **Arguments:**

    - `screened`: the screen of all data. `groups`: the fold of each position, -1: in every fit.

    **Returns:** measured minus predicted, g (0 for the group -1), and for each fold whether it chose the same causes.
    """
    names = {cause.label for cause in screened.members}
    errors, same = np.zeros(screened.problem.readings.size), []
    rows_of = np.repeat(groups, 3)
    folds = [np.flatnonzero(rows_of == fold) for fold in np.unique(groups[groups >= 0])]
    for rows, chosen in zip(folds, _chosen_without(folds, screened), strict=True):
        same.append({screened.pool.causes[k].label for k in chosen} == names)
        errors[rows] = _predicted(rows, screened, chosen)
    return errors.reshape(-1, 3) * screened.problem.sd, np.array(same, bool)


def _chosen_without(folds: list[np.ndarray], screened: Screened) -> list[Members]:
    """The best set of causes (indices into the pool) for each fold when its rows have free values of their own."""
    asides = []
    for rows in folds:
        left, singular, _ = np.linalg.svd(screened.at.basis[rows].T, full_matrices=False)
        asides.append(left[:, singular > _TAKEN])
    chosen: list[Members] = [()] * len(folds)
    ranks = np.array([aside.shape[1] for aside in asides])
    for rank in np.unique(ranks):
        here = np.flatnonzero(ranks == rank).tolist()
        for fold, members in zip(here, _FoldSearch(screened, [asides[fold] for fold in here]).run(), strict=True):
            chosen[fold] = members
    return chosen


class _FoldSearch:
    """The best sets of causes for several folds that set aside as many directions each."""

    def __init__(self, screened: Screened, asides: list[Float[np.ndarray, "nu out"]]):
        search = screened.search
        self._pool, self._z, self._known, self._asides = search.pool, search.z, search.known, asides
        ranked = search.ranked()
        self._starts = [ranked.set_at(rank) for rank in range(min(_SETS, len(ranked.members)))]
        near = ranked.members[ranked.log_posterior > search.top - _NEAR]
        numbers = np.unique(near[near >= 0])
        few = Pool(tuple(self._pool.causes[k] for k in numbers.tolist()), self._pool.dof)
        self._all: _Further = (self._pool, np.arange(len(self._pool.causes)))
        self._near: _Further = (few, numbers)
        left = np.array([self._z @ self._z - np.sum((aside.T @ self._z) ** 2) for aside in asides])
        nothing = log_evidence(left, [], self._pool.dof - asides[0].shape[1], self._known) + np.log(SIZE_PRIOR[0])
        self._best: list[tuple[float, Members]] = [(float(value), ()) for value in nothing]
        self._scores: dict[_FoldSet, np.ndarray] = {}
        self._priors: dict[Members, np.ndarray] = {}

    def run(self) -> list[Members]:
        """The best set for each fold: from the starts by adding, dropping and exchanging causes, until none is better."""
        folds = range(len(self._asides))
        self._expand([(fold, ()) for fold in folds], self._all)
        singles = np.stack([self._scores[fold, ()] for fold in folds])
        best = np.argsort(-singles, axis=1, kind="stable")[:, :_SINGLES].tolist()
        starts = [part for members in self._starts for part in _parts(members)]
        todo = [(fold, members) for fold in folds for members in (*((k,) for k in best[fold]), *starts)]
        for size in range(1, MOST):
            some = [each for each in dict.fromkeys(todo) if len(each[1]) == size]
            self._expand(self._promising(some), self._near)
        for _ in range(_MOST_ROUNDS):
            todo = [(fold, part) for fold in folds for part in _exchanged(self._best[fold][1])]
            todo = [each for each in todo if each not in self._scores]
            if not todo:
                break
            for size in sorted({len(members) for _, members in todo}):
                self._expand([each for each in todo if len(each[1]) == size], self._near)
        return [members for _, members in self._best]

    def _promising(self, sets: list[_FoldSet]) -> list[_FoldSet]:
        """Those of some sets (fold, members) that are not far behind the best of their fold."""
        scores = [self._score(fold, members) for fold, members in sets]
        return [each for each, score in zip(sets, scores, strict=True) if score > self._best[each[0]][0] - HOPELESS]

    def _score(self, fold: int, members: Members) -> float:
        """Log posterior of one set, from a part of it that was expanded where there is one."""
        for number, added in enumerate(members):
            row = self._scores.get((fold, members[:number] + members[number + 1 :]))
            if row is not None:
                return float(row[added])
        base = partial_set(self._pool, self._z, members, self._asides[fold])
        score = float(evidence_of_each(self._pool, self._known, [base])[0]) + log_prior(self._pool, members)
        self._best[fold] = max(self._best[fold], (score, members), key=lambda best: best[0])
        return score

    def _expand(self, sets: list[_FoldSet], further: _Further) -> None:
        """Score sets (fold, members) with each of some further causes; the best of each fold is kept."""
        some, numbers = further
        step = max(1, min(_AT_ONCE, _NUMBERS_AT_ONCE // (some.stacked.shape[1] + len(some.faults) + 1)))
        for first in range(0, len(sets), step):
            part = sets[first : first + step]
            bases = [partial_set(self._pool, self._z, members, self._asides[fold]) for fold, members in part]
            evidence = evidence_with_each(some, self._known, bases)
            for each, own in zip(part, evidence, strict=True):
                row = np.full(len(self._pool.causes), -np.inf)
                row[numbers] = own
                self._keep(*each, row)

    def _keep(self, fold: int, members: Members, row: Float[np.ndarray, " causes"]) -> None:
        """The log posteriors of a set with every further cause, from their evidence; the best of the fold is kept."""
        if members not in self._priors:
            self._priors[members] = log_priors_with_each(self._pool, members)
        row += self._priors[members]
        row[list(members)] = -np.inf
        self._scores[fold, members] = row
        added = int(np.argmax(row))
        if row[added] > self._best[fold][0]:
            self._best[fold] = float(row[added]), tuple(sorted((*members, added)))


def _exchanged(members: Members) -> list[Members]:
    """The sets that lead from one to its neighbours with one cause more, or one exchanged."""
    own = [members] if len(members) < MOST else []
    return own + [members[:number] + members[number + 1 :] for number in range(len(members))]


def _parts(members: Members) -> list[Members]:
    """A set and its parts."""
    return [part for size in range(len(members) + 1) for part in combinations(members, size)]


def _predicted(rows: np.ndarray, screened: Screened, chosen: Members) -> np.ndarray:
    """White errors in some rows of the fit of the chosen causes to the other rows."""
    at = screened.at
    residual, columns = at.residual.copy(), [at.reached]
    for cause in (screened.pool.causes[k] for k in chosen):
        if cause.offset is not None:
            residual -= at.basis @ cause.offset
        elif cause.block is not None:
            # What the nominal model absorbs of a cause needs no column: only its part in the residual space counts.
            columns.append(at.basis @ cause.block)
    left, singular, _ = np.linalg.svd(np.hstack(columns), full_matrices=False)
    q = left[:, singular > _TAKEN * singular[0]]
    return fold_errors(q[rows], (residual - q @ (q.T @ residual))[rows])

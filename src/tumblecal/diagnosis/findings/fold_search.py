"""Causes selected without each fold of a cross-validation, and their predictions for it.

For every fold the search is made on the linearised chain without it: the fold's readings get free values, which is equivalent
to excluding them. The selected causes are fitted to the rest and predict the fold. This improvement is that of the whole
procedure, not of a selection that fits by chance. The folds are searched together: they differ only in the excluded
directions.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.findings.gain import fold_errors
from tumblecal.diagnosis.priors import COLLINEAR, FOLD_ROUNDS, FOLD_SETS, FOLD_SINGLES, HOPELESS, NEAR_IN_FOLDS
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.diagnosis.sets.cause_sets import MOST, Members, parts_of, rows_of
from tumblecal.diagnosis.sets.partial_set import partial_sets, with_each
from tumblecal.diagnosis.sets.prior import SetPriors
from tumblecal.full_model.evidence import highest_shortfall, log_evidence_at_most
from tumblecal.full_model.priors import SIZE_PRIOR


# Least singular value of a direction of the residual space that is lost without a fold.
_TAKEN = 1e-6
# So many sets, and numbers of one array, are scored at once.
_AT_ONCE, _NUMBERS_AT_ONCE = 256, 2_000_000

# A fold and a set of causes.
_FoldSet = tuple[int, Members]


def chosen_anew(
    screened: Screened, groups: Int[np.ndarray, " positions"]
) -> tuple[Float[np.ndarray, "positions 3"], Bool[np.ndarray, " folds"]]:
    """Prediction errors of every fold, with causes selected without it.

    **Arguments:**

    - `screened`: the screen of all data. `groups`: the fold of each position, -1: in every fit.

    **Returns:** measured minus predicted, g (0 for the group -1), and for each fold whether it selected the same causes, or
    causes that the data cannot distinguish from them.
    """
    indistinguishable = [[cause.label for cause in screened.members], *screened.best.equivalents]
    equal = {frozenset(labels) for labels in indistinguishable}
    errors, rows_of = np.zeros(screened.problem.readings.size), np.repeat(groups, 3)
    folds = [np.flatnonzero(rows_of == fold) for fold in np.unique(groups[groups >= 0])]
    chosen = _chosen_without(folds, screened)
    for members in set(chosen):
        q, residual = _fitted(screened, members)
        for rows in _of_equal_size([rows for rows, causes in zip(folds, chosen, strict=True) if causes == members]):
            errors[rows] = fold_errors(q[rows], residual[rows])
    same = [frozenset(screened.pool.causes[k].label for k in members) in equal for members in chosen]
    return errors.reshape(-1, 3) * screened.problem.sd, np.array(same, bool)


def _of_equal_size(folds: list[np.ndarray]) -> list[Int[np.ndarray, "folds rows"]]:
    """The folds' rows, those of equal size together."""
    return [np.array([rows for rows in folds if len(rows) == size]) for size in dict.fromkeys(map(len, folds))]


def _chosen_without(folds: list[np.ndarray], screened: Screened) -> list[Members]:
    """The best set of causes (indices into the pool) for each fold when its rows have free values of their own."""
    chosen: dict[bytes, Members] = {}
    for rows in _of_equal_size(folds):
        _, singular, directions = np.linalg.svd(screened.at.basis[rows], full_matrices=False)
        ranks = np.sum(singular > _TAKEN, axis=1)
        for rank in np.unique(ranks).tolist():
            of_rank = np.flatnonzero(ranks == rank)
            step = 1 + _NUMBERS_AT_ONCE // ((rank + 1) * screened.pool.size)
            for some in np.split(of_rank, range(step, len(of_rank), step)):
                sets = _FoldSearch(screened, directions[some, :rank]).run()
                chosen.update(zip((fold.tobytes() for fold in rows[some]), sets, strict=True))
    return [chosen[fold.tobytes()] for fold in folds]


class _FoldSearch:
    """The best sets of causes for several folds that set aside as many directions each."""

    def __init__(self, screened: Screened, asides: Float[np.ndarray, "folds out nu"]):
        search = screened.search
        self._search, self._asides = search, asides
        self._pool, self._z, self._known = search.pool, search.z, search.known
        ranked = search.ranked()
        self._starts = [ranked.set_at(rank) for rank in range(min(FOLD_SETS, len(ranked.members)))]
        near = ranked.members[ranked.log_posterior > ranked.log_posterior[0] - NEAR_IN_FOLDS]
        numbers = np.unique(near[near >= 0]).tolist()
        # Further causes, and the position of each among them.
        self._near = self._pool.only(np.array(numbers, int))
        self._numbers, self._column = numbers, {k: column for column, k in enumerate(numbers)}
        self._priors: dict[Members, np.ndarray] = {}
        self._best: list[tuple[float, Members]] = [(-np.inf, ())] * len(asides)
        self._singles = np.zeros((0, 0))
        self._scores: dict[_FoldSet, np.ndarray] = {}

    def run(self) -> list[Members]:
        """The best set for each fold: from the starts by adding, dropping and exchanging causes, until none is better."""
        folds = range(len(self._asides))
        parts = [part for members in self._starts for part in parts_of(members)]
        best = self._begun()
        todo = dict.fromkeys((fold, members) for fold in folds for members in (*((k,) for k in best[fold]), *parts))
        # The whole sets first: they are the best of nearly every fold, which leaves few of their parts.
        self._promising([(fold, members) for members in self._starts if len(members) > 1 for fold in folds])
        for size in range(1, MOST):
            self._expand(self._promising([each for each in todo if len(each[1]) == size]))
        for _ in range(FOLD_ROUNDS):
            todo = [(fold, part) for fold in folds for part in _exchanged(self._best[fold][1])]
            self._expand([each for each in todo if each[1] and each not in self._scores])
        return [members for _, members in self._best]

    def _begun(self) -> list[list[int]]:
        """The causes alone scored for every fold: the best of each fold."""
        nothing = partial_sets(self._pool, self._z, [()] * len(self._asides), self._asides)
        evidence, prior = (
            with_each(self._pool, self._known, nothing),
            SetPriors.of(self._pool, rows_of([()])).with_each(),
        )
        self._singles = evidence + prior
        count = min(FOLD_SINGLES, self._pool.size)
        best = np.argpartition(self._singles, -count, axis=1)[:, -count:].tolist()
        empty = nothing.log_evidence(self._pool.dof, self._known) + np.log(SIZE_PRIOR[0])
        for fold, (alone, causes, row) in enumerate(zip(empty.tolist(), best, self._singles, strict=True)):
            self._best[fold] = max((alone, ()), *((float(row[k]), (k,)) for k in causes))
        return best

    def _promising(self, sets: list[_FoldSet]) -> list[_FoldSet]:
        """Sets (fold, members), of those given, that are not far behind the best of their fold."""
        by_part = {each: self._score_by_part(*each) for each in sets}
        scores = {each: score for each, score in by_part.items() if score is not None}
        alone = self._may_be_promising([each for each in by_part if each not in scores])
        for first in range(0, len(alone), _AT_ONCE):
            some = alone[first : first + _AT_ONCE]
            bases = partial_sets(
                self._pool, self._z, [members for _, members in some], self._asides[[fold for fold, _ in some]]
            )
            evidence = bases.log_evidence(self._pool.dof, self._known)
            known = (evidence + SetPriors.of(self._pool, rows_of(bases.members)).own).tolist()
            for (fold, members), score in zip(some, known, strict=True):
                scores[fold, members] = score
                self._best[fold] = max(self._best[fold], (score, members))
        return [each for each, score in scores.items() if score > self._hopeless(each[0])]

    def _may_be_promising(self, sets: list[_FoldSet]) -> list[_FoldSet]:
        """Those of some sets (fold, members) that an upper bound of their score does not show to be far behind.

        The sum of squares that a set leaves without a fold is that of all data less the part that the excluded directions
        explain: one basis for each set serves all folds.
        """
        by_members: dict[Members, list[int]] = {}
        for fold, members in sets:
            by_members.setdefault(members, []).append(fold)
        listed, may = [*by_members], list[_FoldSet]()
        priors = SetPriors.of(self._pool, rows_of(listed)).own.tolist()
        for members, prior, base in zip(listed, priors, self._search.bases(listed), strict=True):
            folds, rest = by_members[members], base.z - base.q @ (base.q.T @ base.z)
            asides = self._asides[folds]
            inside = asides @ base.q
            free, turn = np.linalg.eigh(np.eye(asides.shape[1]) - inside @ inside.mT)
            toward = (turn.mT @ (asides @ rest)[:, :, None])[:, :, 0]
            left = np.maximum(rest @ rest - np.vecdot(toward, toward / np.maximum(free, COLLINEAR)), 0.0)
            shortfalls = np.sum(highest_shortfall(1) * (np.array(base.segments) > 0))
            most = log_evidence_at_most(
                left,
                np.array(base.z @ base.z),
                shortfalls,
                np.array(self._pool.dof - asides.shape[1] - base.q.shape[1]),
                self._pool.dof - asides.shape[1],
                self._known,
            )
            # Where a fold alone shows a direction of the set, the bound is not valid.
            most = np.where(free.min(axis=1) > COLLINEAR, most + prior, np.inf)
            may += [
                (fold, members)
                for fold, score in zip(folds, most.tolist(), strict=True)
                if score > self._hopeless(fold)
            ]
        return may

    def _hopeless(self, fold: int) -> float:
        """The score that a set of a fold must exceed."""
        return self._best[fold][0] - HOPELESS

    def _score_by_part(self, fold: int, members: Members) -> float | None:
        """Log posterior of one set from a part of it that was expanded; None where there is none."""
        if len(members) == 1:
            return float(self._singles[fold, members[0]])
        for number, added in enumerate(members):
            row = self._scores.get((fold, members[:number] + members[number + 1 :]))
            if row is not None:
                return float(row[self._column[added]]) if added in self._column else -np.inf
        return None

    def _expand(self, sets: list[_FoldSet]) -> None:
        """Score sets (fold, members) with each of the further causes; the best of each fold is kept."""
        if not self._numbers:
            return
        step = max(1, min(_AT_ONCE, _NUMBERS_AT_ONCE // (len(self._near.rows) + len(self._near.faults) + 1)))
        for first in range(0, len(sets), step):
            part = sets[first : first + step]
            asides = self._asides[[fold for fold, _ in part]]
            bases = partial_sets(self._pool, self._z, [members for _, members in part], asides)
            scores = with_each(self._near, self._known, bases)
            scores = scores + np.stack([self._prior(members) for _, members in part])
            best = np.argmax(scores, axis=1).tolist()
            for each, row, column in zip(part, scores, best, strict=True):
                self._scores[each] = row
                fold, members = each
                if row[column] > self._best[fold][0]:
                    self._best[fold] = float(row[column]), tuple(sorted((*members, self._numbers[column])))

    def _prior(self, members: Members) -> Float[np.ndarray, " further"]:
        """Log priors of a set with each of the further causes; -inf for its own."""
        if members not in self._priors:
            (prior,) = SetPriors.of(self._pool, rows_of([members])).with_each()
            prior[list(members)] = -np.inf
            self._priors[members] = prior[self._numbers]
        return self._priors[members]


def _exchanged(members: Members) -> list[Members]:
    """The sets that lead from one to its neighbours with one cause more, or one exchanged."""
    enlarged = [members] if len(members) < MOST else []
    return enlarged + [members[:number] + members[number + 1 :] for number in range(len(members))]


def _fitted(
    screened: Screened, chosen: Members
) -> tuple[Float[np.ndarray, "rows columns"], Float[np.ndarray, " rows"]]:
    """Orthonormal basis of the nominal model and the chosen causes, and the residual of their fit to all rows."""
    at = screened.at
    residual, columns = at.residual.copy(), [at.reached]
    for cause in (screened.pool.causes[k] for k in chosen):
        if cause.offset is not None:
            residual -= at.basis @ cause.offset
        elif cause.block is not None:
            # What the nominal model absorbs of a cause needs no column: only its part in the residual space counts.
            columns.append(at.basis @ cause.block)
    vectors, singular, _ = np.linalg.svd(np.hstack(columns), full_matrices=False)
    q = vectors[:, singular > _TAKEN * singular[0]]
    return q, residual - q @ (q.T @ residual)

"""Sets of causes under other noise models, scored together.

For a set M and a noise alternative N with covariance K on the residual space, `z` and the set's columns are whitened by K and
the evidence is that of the screen, less half the logarithm of K's determinant.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import chain, combinations

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.evidence import LEAST_FREE, log_evidence, log_evidence_of_noise
from tumblecal.diagnosis.noise_causes import NoiseAlternative, log_noise_evidence
from tumblecal.diagnosis.noise_models import LEVEL
from tumblecal.diagnosis.screen import Screened
from tumblecal.diagnosis.search import Search
from tumblecal.diagnosis.set_prior import log_prior
from tumblecal.diagnosis.tuning import MANY_OUTLIERS


_MOST_SETS = 8
# A noise model this far (log) behind before the set is fitted anew under it is not tried.
_HOPELESS = 10.0


@dataclass(frozen=True)
class NoiseChange:
    """A noise alternative that, with the causes `members` (indices into the pool), is more probable than the best set of
    causes under the noise as assumed; `log_odds` of all of its kind against that set. `rival`: another alternative that these
    data cannot tell from it."""

    alternative: NoiseAlternative
    members: tuple[int, ...]
    log_odds: float
    rival: str = ""


def many_outliers(screened: Screened) -> bool:
    """Whether so many outlying positions are named that they are rather heavy tails."""
    return sum(bool(cause.left_out) for cause in screened.members) >= MANY_OUTLIERS


@dataclass(frozen=True)
class NoiseScores:
    """Noise alternatives with the sets of causes that may go with them.

    - `log_posterior`: of each set under each alternative, unnormalised, on the scale of the search's `top`; -inf where the pair
      is hopeless. `without_outliers`: each set less its outlying positions, which heavy tails stand for.
    """

    listed: list[NoiseAlternative]
    sets: list[tuple[int, ...]]
    without_outliers: list[tuple[int, ...]]
    log_posterior: Float[np.ndarray, "sets alternatives"]
    top: float

    @classmethod
    def of(cls, screened: Screened, listed: list[NoiseAlternative]) -> "NoiseScores":
        """Those of a screen."""
        search, sets, outlying = screened.search, _sets(screened), screened.pool.outlying
        others = [tuple(k for k in members if k not in outlying) for members in sets]
        scores = np.full((len(sets), len(listed)), -np.inf)
        if not sets or not listed:
            return cls(listed, sets, others, scores, search.top)
        gains = _gains(search, sets, listed)
        posterior = np.array([search.posterior(members) for members in sets])
        worth = posterior[:, None] + gains > search.top - _HOPELESS
        if not many_outliers(screened):
            # What is left of a set whose outlying positions heavy tails stand for is tried by itself.
            whole = np.array([own == members for own, members in zip(others, sets, strict=True)], bool)
            worth &= whole[:, None] | np.array([alternative.tail is None for alternative in listed], bool)
        for row, members in enumerate(sets):
            tried = np.flatnonzero(worth[row])
            alternatives = [listed[k] for k in tried.tolist()]
            scores[row, tried] = _log_posterior(search, members, alternatives, gains[row, tried])
        return cls(listed, sets, others, scores, search.top)

    def most_probable(self, among: Callable[[NoiseAlternative], bool] = lambda _: True) -> NoiseChange | None:
        """The alternative that, with the causes that go best with it, explains the data best; None where all are hopeless."""
        kinds: dict[tuple[str, str], list[int]] = {}
        for k, alternative in enumerate(self.listed):
            if among(alternative):
                kinds.setdefault((alternative.label, alternative.kind), []).append(k)
        best, most = None, -np.inf
        for row, own in enumerate(self.log_posterior):
            for columns in kinds.values():
                # Kinds are compared by all their members together: one tried in fine steps is not worse for it.
                total = float(np.logaddexp.reduce(own[columns]))
                if total > most:
                    most, best = total, (row, columns[int(np.argmax(own[columns]))])
        if best is None:
            return None
        row, k = best
        members = self.sets[row] if self.listed[k].tail is None else self.without_outliers[row]
        return NoiseChange(self.listed[k], members, most - self.top)


def _gains(
    search: Search, sets: list[tuple[int, ...]], listed: list[NoiseAlternative]
) -> Float[np.ndarray, "sets alternatives"]:
    """By how much each alternative explains better what each set leaves when it is fitted under the noise as assumed (log, with
    the alternative's prior)."""
    rest = np.stack([base.z - base.q @ (base.q.T @ base.z) for base in search.bases(sets)])
    normal = log_evidence_of_noise(np.sum(rest**2, axis=1), search.pool.dof, search.known)
    return log_noise_evidence(listed, rest, search.known) - normal[:, None]


def _log_posterior(
    search: Search, members: tuple[int, ...], listed: list[NoiseAlternative], gains: Float[np.ndarray, " alternatives"]
) -> Float[np.ndarray, " alternatives"]:
    """Log posterior of one set of causes, fitted under each alternative, unnormalised."""
    if not listed:
        return np.zeros(0)
    base, dof = search.base(members), search.pool.dof
    # Tails are judged by what the set leaves; its own part counts as under the normal distribution.
    scores = gains + float(
        log_evidence(np.array(base.z @ base.z), base.explained(base.q.T @ base.z), dof, search.known)
    )
    rows = listed[0].basis @ np.column_stack([base.z, base.q])
    for k, alternative in enumerate(listed):
        if alternative.tail is None:
            white = alternative.whitened(rows)
            z, (q, _) = white[:, 0], np.linalg.qr(white[:, 1:])
            stated = search.known and alternative.kind != LEVEL
            own = float(log_evidence(np.array(z @ z), base.explained(q.T @ z), dof, stated))
            scores[k] = alternative.log_weight + own - alternative.half_log_det
    return scores + log_prior(search.pool, members)


def _sets(screened: Screened) -> list[tuple[int, ...]]:
    """The sets worth trying: nothing, those of the best explanations, and every part of the best one; none that leaves no
    degrees of freedom to tell a noise by."""
    listed = [told for told in screened.explanations if told.members][:_MOST_SETS]
    first = listed[0].members if listed else ()
    parts = chain.from_iterable(combinations(first, size) for size in range(len(first) + 1))
    sets = list(dict.fromkeys([*parts, *(told.members for told in listed)]))
    bases, dof = screened.search.bases(sets), screened.pool.dof
    return [members for members, base in zip(sets, bases, strict=True) if base.q.shape[1] + LEAST_FREE <= dof]

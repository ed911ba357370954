"""A stated standard deviation that is in error by one factor, and the remaining errors.

If the stated standard deviation is too small, all data look like many causes, and one outlier position, far beyond the noise,
looks like many. The same causes are searched again with a free level: if they lead then, the level was wrong.
"""

import numpy as np

from tumblecal.diagnosis.noise.alternatives import NoiseAlternatives
from tumblecal.diagnosis.noise.models import LEVEL
from tumblecal.diagnosis.screening.noise_scores import NoiseChange, NoiseScores, without_outliers
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.diagnosis.sets.cause_sets import sets_of
from tumblecal.diagnosis.sets.prior import SetPriors, given_found
from tumblecal.diagnosis.sets.search import Search


# Another level this far (log) ahead of all causes under the stated one is sure.
SURE_LEVEL = 10.0
# So many of the best sets are tried with heavy tails, without their outlier positions.
_MOST_BESIDE_TAILS = 8


def level_change(screened: Screened) -> NoiseChange | None:
    """A different level of a stated noise, with the most probable causes for it. None if heavy tails are more probable, or
    nearly so for sets with outlier positions, which tails would replace."""
    noise, search = screened.alternatives.noise, Search(screened.pool, screened.at.z, known=False)
    levels = [model for model in noise.listed if model.kind == LEVEL]
    if not levels:
        return None
    ranked = search.run()
    tails = NoiseAlternatives(screened.at, tuple(model for model in noise.listed if model.tail is not None))
    sets = [(), *(without_outliers(search, own) for own in sets_of(ranked.members[:_MOST_BESIDE_TAILS]))]
    tail, best = NoiseScores.among(search, list(dict.fromkeys(sets)), tails).most_probable(), ranked.set_at(0)
    off = any(screened.pool.causes[k].left_out for k in best)
    if tail is not None and (off or tail.log_odds > levels[0].log_weight):
        return None
    causes = SetPriors.of(screened.pool, ranked.members[:1]).causes
    odds = float(ranked.log_posterior[0] + given_found(causes, 1)[0]) + levels[0].log_weight - screened.search.top
    return NoiseChange(levels[0], best, odds, float(np.exp(-np.logaddexp(0.0, -odds))))

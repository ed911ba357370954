"""Null distributions of plans, stored on disk between calls with the compiled programs.

Drawing one takes half a second. Its key contains the inputs of the draws: the scores of every cause for a few residual
vectors, which are unique for plan, catalogue and noise, and the sources.
"""

import hashlib

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.causes.pool import Pool
from tumblecal.diagnosis.detection import detect
from tumblecal.diagnosis.detection.alternatives import Alternatives
from tumblecal.diagnosis.detection.detect import SEED, null_distribution, scores_of_each
from tumblecal.ground.program_cache import program_cache, sources_digest


_PREFIX, _MOST_KEPT = "null-", 200
_VECTORS = 4


def kept_null(pool: Pool, alternatives: Alternatives, known: bool) -> Float[np.ndarray, " draws"]:
    """`detect.null_distribution`, from disk where it was drawn before and programs are kept."""
    cache = program_cache()
    if cache is None:
        return null_distribution(pool, alternatives, known)
    vectors = np.random.default_rng(SEED).standard_normal((_VECTORS, pool.dof))
    scores = scores_of_each(pool, alternatives, vectors, known)
    digest = hashlib.sha256(sources_digest("diagnosis", "noise").encode())
    for array in (*scores, np.array([pool.dof, known, detect.DRAWS])):
        digest.update(repr(array.shape).encode() + array.tobytes())
    name = f"{_PREFIX}{digest.hexdigest()[:32]}"
    payload = cache.get(name)
    if payload is not None:
        return np.frombuffer(payload)
    drawn = null_distribution(pool, alternatives, known)
    cache.put(name, drawn.tobytes())
    cache.keep_newest(_PREFIX, _MOST_KEPT)
    return drawn

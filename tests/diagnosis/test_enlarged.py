"""Sets side by side against each set alone, written out; bounds against what they bound."""

import numpy as np
import pytest

from tumblecal.diagnosis.causes.cause import EFFECT, Cause
from tumblecal.diagnosis.causes.faults import swap
from tumblecal.diagnosis.causes.pool import Pool
from tumblecal.diagnosis.priors import COLLINEAR
from tumblecal.diagnosis.sets.enlarged import Enlarged
from tumblecal.diagnosis.sets.partial_set import partial_sets
from tumblecal.full_model.evidence import log_evidence


DOF = 24
RANKS = (1, 3, 1, 2, 1, 5, 8, 2, 1, 3)
SETS = [(), (0,), (6,), (1, 10), (0, 3, 5), (11, 12), (2, 6, 12), (4, 7, 9)]


def pool_of(rng):
    """Blocks of several ranks, the last nearly in the span of the one before it and another, and three faults."""
    blocks = [np.linalg.qr(rng.normal(size=(DOF, rank)))[0] for rank in RANKS]
    mixed = np.column_stack([blocks[7][:, 0] + 0.05 * blocks[0][:, 0], blocks[4][:, 0], blocks[7][:, 1]])
    blocks[9] = np.linalg.qr(mixed)[0]
    effects = [Cause(EFFECT, f"effect_{k}", -3.0, -3.0, block) for k, block in enumerate(blocks)]
    faults = [swap(f"swap:{k}", (-4.0, -4.0), 3 * rng.normal(size=DOF), (k, k + 1)) for k in range(3)]
    return Pool.of((*effects, *faults), DOF)


def alone(pool, z, members, further, known, aside):
    """Log evidence of one set with one cause more, every step written out; -inf where that adds nothing."""
    for k in (*members, further):
        z = z if pool.causes[k].offset is None else z - pool.causes[k].offset
    z = z - aside @ (aside.T @ z)
    faultless = z + (0 if pool.causes[further].offset is None else pool.causes[further].offset)
    faultless = faultless - aside @ (aside.T @ faultless)
    blocks = [pool.causes[k].block for k in members if pool.causes[k].block is not None]
    blocks.sort(key=lambda block: -float(np.sum((block.T @ faultless) ** 2)))
    if pool.causes[further].block is not None:
        blocks.append(pool.causes[further].block)
    taken, parts = aside, []
    for block in blocks:
        left, singular, _ = np.linalg.svd(block - taken @ (taken.T @ block), full_matrices=False)
        new = left[:, singular**2 > COLLINEAR]
        parts.append((np.array(np.sum((new.T @ z) ** 2)), new.shape[1]))
        taken = np.hstack([taken, new])
    if pool.causes[further].block is not None and not parts[-1][1]:
        return -np.inf
    return float(log_evidence(np.array(z @ z), parts, DOF - aside.shape[1], known))


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("out", [0, 3])
@pytest.mark.parametrize("size", [1.0, 40.0])
def test_sets_side_by_side_are_those_alone(known, out, size):
    rng = np.random.default_rng([out, known, int(size)])
    pool = pool_of(rng)
    z = rng.normal(size=DOF) + size * (pool.causes[6].block @ rng.normal(size=8) + pool.causes[0].block[:, 0])
    asides = np.stack([np.linalg.qr(rng.normal(size=(DOF, out)))[0].T for _ in SETS])
    evidence = Enlarged(pool, known, partial_sets(pool, z, SETS, asides)).settled()
    for members, aside, own in zip(SETS, asides, evidence, strict=True):
        for k in set(range(len(pool.causes))) - set(members):
            expected = alone(pool, z, members, k, known, aside.T)
            assert own[k] == pytest.approx(expected, rel=1e-9), (members, k)


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("size", [1.0, 10.0, 1000.0])
def test_no_evidence_exceeds_its_bound(known, size):
    for seed in range(10):
        rng = np.random.default_rng([seed, known, int(size)])
        pool = pool_of(rng)
        z = rng.normal(size=DOF) + size * sum(
            pool.causes[k].block @ rng.normal(size=RANKS[k]) for k in rng.choice(10, 2, replace=False)
        )
        enlarged = Enlarged(pool, known, partial_sets(pool, z, SETS))
        bounds, bound = enlarged.evidence.copy(), enlarged.open.copy()
        assert np.sum(bound) > 20
        evidence = enlarged.settled()
        assert not np.any(enlarged.open)
        np.testing.assert_array_equal(evidence[~bound], bounds[~bound])
        # To within what the table of `gain` leaves between its nodes.
        assert np.all(evidence[bound] <= bounds[bound] + 1e-3)

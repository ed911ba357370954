"""The search over sets against brute force; its priors written out."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from tumblecal.diagnosis.causes.cause import EFFECT, NO_SLOT, Cause, Kind
from tumblecal.diagnosis.causes.table import Pool
from tumblecal.diagnosis.priors import FAULT_WEIGHTS, OF_ORDERS, ON_AXES
from tumblecal.diagnosis.sets.cause_sets import rows_of
from tumblecal.diagnosis.sets.prior import SetPriors, log_prior
from tumblecal.diagnosis.sets.search import Search
from tumblecal.full_model.evidence import gain
from tumblecal.full_model.priors import EFFECT_WEIGHT, SIZE_PRIOR


DOF = 20


def unit(rng):
    vector = rng.normal(size=(DOF, 1))
    return vector / np.linalg.norm(vector)


def pool_of(rng, count=12, labels=None, powers=None):
    """`powers`: of some labels the polynomial and the power."""
    labels, powers = labels or [f"effect_{k}" for k in range(count)], powers or {}
    share, fault_share = np.log(EFFECT_WEIGHT / len(labels)), np.log(FAULT_WEIGHTS["swapped_positions"] / 3)
    stated = {label: powers.get(label, ((), 0)) for label in labels}
    slots = {label: replace(NO_SLOT, polynomial=of, order=order) for label, (of, order) in stated.items()}
    blocks = [Cause(EFFECT, label, share, share, unit(rng), slot=slots[label]) for label in labels]
    faults = [Cause(Kind.SWAP, f"swap:{k}", fault_share, fault_share, offset=rng.normal(size=DOF)) for k in range(3)]
    return Pool.of((*blocks, *faults), DOF)


def score(pool, z, members):
    """Log posterior of a set of rank-one causes, known noise, written out."""
    weights = sum(pool.causes[k].log_weight for k in members)
    prior = np.log(SIZE_PRIOR[len(members)]) + np.log(float(np.prod(np.arange(1, len(members) + 1)))) + weights
    for k in members:
        z = z - (0 if pool.causes[k].offset is None else pool.causes[k].offset)
    total, taken = z @ z, np.zeros((DOF, 0))
    value = prior - 0.5 * total
    for k in members:
        block = pool.causes[k].block
        if block is not None:
            new = block - taken @ (taken.T @ block)
            new = new / np.linalg.norm(new)
            value += float(gain((new.T @ z)[0] ** 2, 1))
            taken = np.hstack([taken, new])
    return value


@pytest.mark.parametrize("seed", range(6))
def test_best_pair_is_that_of_brute_force(seed):
    rng = np.random.default_rng(seed)
    pool = pool_of(rng)
    i, j = rng.choice(12, 2, replace=False)
    z = 9 * pool.causes[i].block[:, 0] + 7 * pool.causes[j].block[:, 0] + rng.normal(size=DOF)
    ranked = Search(pool, z, known=True).run()
    pairs = {pair: score(pool, z, pair) for pair in combinations(range(pool.size), 2)}
    best = max(pairs, key=pairs.__getitem__)
    scores = {ranked.set_at(k): value for k, value in enumerate(ranked.log_posterior)}
    assert best in scores
    # Blocks are taken in turn: the score of a set depends a little on their order.
    assert scores[best] == pytest.approx(pairs[best], abs=1.0)
    assert ranked.set_at(0) == best or scores[ranked.set_at(0)] >= pairs[best]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("size", [30.0, 100.0, 1000.0])
@pytest.mark.parametrize("count", [2, 3])
def test_the_stronger_the_signal_the_surer_the_set(size, count, seed):
    rng = np.random.default_rng(seed)
    pool = pool_of(rng, count=40)
    hidden = tuple(sorted(rng.choice(40, count, replace=False).tolist()))
    sizes = size * rng.uniform(0.7, 1.3, count) * rng.choice([-1, 1], count)
    z = sum(a * pool.causes[k].block[:, 0] for a, k in zip(sizes, hidden, strict=True)) + rng.normal(size=DOF)
    ranked = Search(pool, z, known=True).run()
    assert ranked.set_at(0) == hidden


@pytest.mark.parametrize("axes", [2, 3])
def test_several_axes_of_a_family_count_as_one_cause(axes):
    rng = np.random.default_rng(5)
    labels = [f"{family}.{axis}" for family in ("drift", "square", "cube") for axis in "xyz"]
    pool = pool_of(rng, labels=labels)
    hidden = tuple(range(axes))
    z = sum(8 * pool.causes[k].block[:, 0] for k in hidden) + rng.normal(size=DOF)
    ranked = Search(pool, z, known=True).run()
    assert ranked.set_at(0) == hidden
    choices = 3 if axes == 3 else 9
    one_cause = np.log(SIZE_PRIOR[1] * EFFECT_WEIGHT * ON_AXES[axes] / choices)
    separate = np.log(SIZE_PRIOR[axes] * np.prod(np.arange(1, axes + 1))) + axes * np.log(EFFECT_WEIGHT / 9)
    assert one_cause > separate
    assert ranked.log_posterior[0] == pytest.approx(score(pool, z, hidden) + one_cause - separate, abs=1.0)


# Bias against temperature on two axes, first and second order; an input's second, third and fifth power.
POWERS = {
    "slope.x": (("x", "degc"), 1), "bend.x": (("x", "degc"), 2), "slope.y": (("y", "degc"), 1), "bend.y": (("y", "degc"), 2),
    "square.z": (("z", "z"), 2), "cube.z": (("z", "z"), 3), "fifth.z": (("z", "z"), 5),
}  # fmt: skip
LABELS = [*POWERS, "slope.z", "bend.z", "other", "another"]


@pytest.mark.parametrize(
    ("labels", "causes", "shares"),
    [
        ("slope.x bend.x", 1, [dict(OF_ORDERS)[2] / 3]),
        ("square.z cube.z", 1, [dict(OF_ORDERS)[2] / 3]),
        # One of three orders is listed.
        ("square.z cube.z fifth.z", 1, [dict(OF_ORDERS)[3]]),
        # A power below is missing.
        ("cube.z fifth.z", 2, [1 / 11, 1 / 11]),
        ("square.z fifth.z", 2, [1 / 11, 1 / 11]),
        ("slope.x bend.x other", 2, [dict(OF_ORDERS)[2] / 3, 1 / 11]),
        # Either two polynomials, or two families on two axes, of which there are two with three choices each.
        ("slope.x bend.x slope.y bend.y", 2, [max(dict(OF_ORDERS)[2] / 3, ON_AXES[2] / 6)] * 2),
        ("slope.x bend.x bend.y", 2, [dict(OF_ORDERS)[2] / 3, 1 / 11]),
    ],
)
def test_powers_of_one_variable_on_one_output_count_as_one_cause(labels, causes, shares):
    pool = pool_of(np.random.default_rng(0), labels=LABELS, powers=POWERS)
    members = tuple(sorted(LABELS.index(label) for label in labels.split()))
    expected = np.log(SIZE_PRIOR[causes] * causes * np.prod(EFFECT_WEIGHT * np.array(shares)))
    assert log_prior(pool, members) == pytest.approx(expected)
    # The same by each way of single steps.
    for k in members:
        less = tuple(other for other in members if other != k)
        assert SetPriors.of(pool, rows_of([less])).with_each()[0, k] == pytest.approx(expected)

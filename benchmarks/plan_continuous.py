"""Continuous angles against the listed ones, for random heads.

    python benchmarks/plan_continuous.py --heads 20 --seed 1

Heads as in `plan_heads.py`, with a spindle step of 90 or 15 deg, three pitch settings, and one or two mountings; 24 positions.
The numbers are the criterion with continuous angles over that at the listed angles (white noise): median and least.
"""

import argparse
from dataclasses import replace

import numpy as np

import tumblecal
from plan_heads import PITCH, everything
from tumblecal.chain.head_ability import HeadAbility, Repeatability
from tumblecal.design.criteria.criterion import mean, volume, worst
from tumblecal.design.criteria.measure import measures
from tumblecal.design.model.limits import limits_of
from tumblecal.design.model.one_visit import one_visit
from tumblecal.design.model.responses import responses_of
from tumblecal.design.positions.continuous import continuous_cells
from tumblecal.design.positions.exchange import exchange


STEPS = {"coarse": 90, "fine": 15}


def ratio(rng, rig, whole, step, mountings, build, pitch):
    """The criterion with continuous angles over that at the listed ones, for a random head; None if nothing is gained."""
    cells, settings = whole.cells, np.sort(rng.choice(PITCH, 3, replace=False))
    labels = rng.choice(sorted(set(cells.mounts)), mountings, replace=False)
    taken = np.isin(cells.mounts, labels) & np.isin(cells.beta_deg, settings) & (cells.alpha_deg % step == 0)
    ability = HeadAbility(
        tuple(np.arange(0, 360.0, step)),
        tuple(settings),
        tuple(labels),
        alpha_continuous=True,
        beta_continuous=pitch,
        repeatability=Repeatability(),
    )
    rig, few = replace(rig, ability=ability), whole.chosen(np.flatnonzero(taken))
    criterion, repeats = build(few), int(np.ceil(24 / len(few.cells)))
    limits = limits_of(few.cells, ability, count=24, repeats=repeats)
    found = exchange(limits, measures(one_visit(few), criterion), restarts=4)
    moved = continuous_cells(rig, few, ability, criterion, found.cells)
    after = one_visit(responses_of(rig, moved)).covariance(np.arange(24))
    return min(1.0, float(criterion.of(after)) / found.value)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--heads", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    tumblecal.enable_float64()
    rig, whole, _ = everything(np.random.default_rng(asked.seed))
    builds = (worst, mean, volume)
    for pitch in (False, True):
        for name, step in STEPS.items():
            for mountings in (1, 2):
                found = []
                for head in range(asked.heads):
                    rng = np.random.default_rng([asked.seed, head])
                    found.append(ratio(rng, rig, whole, step, mountings, builds[head % 3], pitch))
                print(
                    f"{'both axes' if pitch else 'spindle'}, {name} ({step} deg), {mountings} mountings: "
                    f"median {np.median(found):.3f}, least {np.min(found):.3f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()

"""Plans of random heads against their bounds.

    python benchmarks/plan_heads.py --heads 1000 --seed 1 [--first 0] [--out heads.json]

A head has random spindle steps, pitch settings, mountings, times, repeatability, priors and noise; the plan has a random
number of positions or a random duration, and a random criterion. The efficiency is the bound (white noise, limits of the head)
over the value of the plan; a plan below 95 % has a reason.
"""

import argparse
import json
import time
import tomllib
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

import tumblecal
from tumblecal.chain.head_ability import HeadAbility, Times
from tumblecal.chain.rig_file import rig_of
from tumblecal.design.criteria.criterion import attitudes_in_use, in_use, mean, volume, worst
from tumblecal.design.model.cells import cells_of
from tumblecal.design.model.limits import limits_of
from tumblecal.design.model.one_visit import one_visit
from tumblecal.design.model.responses import responses_of
from tumblecal.design.positions.bounded_search import best_plan
from tumblecal.ground.errors import InputError


STEPS = np.array([15, 30, 30, 45, 45, 60, 90])
PITCH = np.arange(-90.0, 91.0, 15.0)
MOUNTINGS = 10


def everything(rng):
    """A rig with all angles and mountings from which the heads are drawn, and its responses."""
    turns = np.vstack([np.zeros((1, 3)), 90.0 * rng.integers(0, 4, (5, 3)), rng.uniform(-180, 180, (MOUNTINGS - 6, 3))])
    labels = [f"M{k}" for k in range(MOUNTINGS)]
    text = f"""
schema = "tumblecal.rig/1"
[plan]
alpha_deg = {{ start = 0, step = 15, count = 24 }}
beta_deg = {PITCH.tolist()}
mounts = {json.dumps(labels)}
[chain.leaves]
dbeta = {{ by = "mount.pitch" }}
dtheta = {{ by = "mount" }}
[noise]
sd = "0.15 mg"
[head]
alpha_deg = {{ start = 0, step = 15, count = 24 }}
[mounts]
""" + "\n".join(f"{label} = {{ rotation_deg = {turn.tolist()} }}" for label, turn in zip(labels, turns, strict=True))
    rig = rig_of(tomllib.loads(text), Path("heads.toml"))
    return rig, responses_of(rig, cells_of(rig.ability)), responses_of(rig, attitudes_in_use(rig.ability))


def head(rng, whole):
    """Responses and ability of a random head."""
    cells = whole.cells
    step = int(rng.choice(STEPS))
    pitch = np.sort(rng.choice(PITCH, rng.integers(2, 6), replace=False))
    labels = [f"M{k}" for k in rng.choice(MOUNTINGS, rng.choice([1, 2, 2, 3]), replace=False)]
    taken = np.isin(cells.mounts, labels) & np.isin(cells.beta_deg, pitch) & (cells.alpha_deg % step == 0)
    sd = 1e-3 * 10 ** rng.uniform(-2, 0)
    again = rng.choice([0.0, 0.0, 0.03, 0.3]), rng.choice([0.0, 0.0, 0.3, 3.0])
    common = rng.choice([None, 0.0, 0.1, 1.0]), rng.choice([None, None, 3.0])
    few = whole.chosen(np.flatnonzero(taken))
    few = replace(
        few,
        sd=sd,
        pitch=replace(few.pitch, common=common[0], again=again[0]),
        mount=replace(few.mount, common=common[1], again=again[1]),
    )
    times = Times(
        *(float(np.round(one, 0)) for one in 10 ** rng.uniform([1, 0, 0.5, 1, 2, 3], [2.3, 1.3, 1.5, 2.5, 3.3, 4]))
    )
    ability = HeadAbility(tuple(np.arange(0, 360.0, step)), tuple(pitch), tuple(labels), times=times)
    return few, ability


def one(seed, whole, use):
    """Efficiency, reason and time of one head."""
    rng = np.random.default_rng(seed)
    few, ability = head(rng, whole)
    number = int(rng.integers(12, 49))
    times = ability.times
    minutes = (
        number * (times.dwell_s + times.settle_s + times.turn_s) + 5 * times.pitch_change_s + times.remount_s
    ) / 60
    limit = {"count": min(number, len(few.cells))} if rng.random() < 0.5 else {"minutes": round(minutes, 1)}
    build = [worst, mean, volume, None][int(rng.integers(4))]
    found = {"seed": int(seed), "cells": len(few.cells), "mountings": len(ability.mounts), **limit}
    begin = time.process_time()
    try:
        criterion = in_use(use) if build is None else build(few)
        plan = best_plan(one_visit(few), criterion, limits_of(few.cells, ability, **limit), seed=int(seed))
    except InputError as error:
        return found | {"criterion": build.__name__ if build else "in use", "rejected": str(error)}
    return found | {
        "criterion": criterion.name,
        "positions": len(plan.chosen.cells),
        "value": plan.bounds.value,
        "efficiency": plan.bounds.efficiency,
        "own": plan.bounds.own / plan.bounds.value,
        "reason": plan.bounds.reason,
        "seconds": time.process_time() - begin,
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--heads", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    tumblecal.enable_float64()
    _, whole, use = everything(np.random.default_rng(asked.seed))
    seeds = range(asked.first, asked.first + asked.heads)
    found = [one(seed, whole, use) for seed in seeds]
    if asked.out:
        asked.out.write_text(json.dumps(found, indent=1))
    summary(found)


def summary(found):
    """A table on the terminal."""
    made = [each for each in found if "efficiency" in each]
    sizes = np.array([each["efficiency"] for each in made])
    print(f"{len(found)} heads, {len(found) - len(made)} rejected (nothing to determine)")
    print(
        f"efficiency: median {np.median(sizes):.3f}, 5 % quantile {np.quantile(sizes, 0.05):.3f}, least {sizes.min():.3f}"
    )
    print(
        f"at least 95 %: {np.mean(sizes >= 0.95):.1%}; below, with a reason: {sum(bool(each['reason']) for each in made)}"
    )
    for reason, number in Counter(each["reason"].split(":")[0] for each in made if each["reason"]).most_common():
        print(f"  {number}: {reason}")
    print(f"processor time: median {np.median([each['seconds'] for each in made]):.2f} s")


if __name__ == "__main__":
    main()

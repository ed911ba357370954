"""Plans of random heads against the bound of any plan."""

import time
from collections import Counter
from dataclasses import replace

import numpy as np

from plan.promises import head
from tumblecal.chain.head_ability import Times
from tumblecal.ground.errors import InputError
from tumblecal.plan.bound import best_plan
from tumblecal.plan.cells import cells_of
from tumblecal.plan.criterion import attitudes_in_use, in_use, of_parameters
from tumblecal.plan.information import one_visit
from tumblecal.plan.limits import Limits
from tumblecal.plan.responses import responses_of


PITCH = np.arange(-90.0, 91.0, 15.0)
STEPS = np.array([15, 30, 30, 45, 45, 60, 90])
MOUNTINGS = 10


def heads(count: int, seed: int) -> None:
    """Random heads (spindle steps, pitch settings, mountings, times, repeatability, priors, noise) and criteria."""
    rng = np.random.default_rng(seed)
    turns = np.vstack([np.zeros((1, 3)), 90.0 * rng.integers(0, 4, (5, 3)), rng.uniform(-180, 180, (MOUNTINGS - 6, 3))])
    rig = head(15, PITCH, {f"M{k}": turn.tolist() for k, turn in enumerate(turns)})
    whole = responses_of(rig, cells_of(rig.ability))
    use = responses_of(rig, attitudes_in_use(rig.ability))
    made, seconds = [], []
    for number in range(count):
        begin = time.process_time()
        plan = planned(np.random.default_rng(number), number, whole, use)
        seconds.append(time.process_time() - begin)
        made += [plan] if plan is not None else []
    efficiency = np.array([plan.efficiency for plan in made])
    print(f"{count} heads, {count - len(made)} rejected (nothing to determine)")
    print(f"efficiency: median {np.median(efficiency):.3f}, 5 % quantile {np.quantile(efficiency, 0.05):.3f}, "
          f"least {efficiency.min():.3f}; at least 95 %: {np.mean(efficiency >= 0.95):.1%}")  # fmt: skip
    reasons = Counter(plan.reason.split(":")[0] for plan in made if plan.reason)
    print(*(f"  {number}: {reason}" for reason, number in reasons.most_common()), sep="\n")
    print(f"processor time: median {np.median(seconds):.2f} s")


def planned(rng: np.random.Generator, seed: int, whole, use):
    """The bounds of the plan of a random head; None if nothing is to be determined."""
    cells, step = whole.cells, int(rng.choice(STEPS))
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
    times = Times(*np.round(10 ** rng.uniform([1, 0, 0.5, 1, 2, 3], [2.3, 1.3, 1.5, 2.5, 3.3, 4])).tolist())
    number = int(rng.integers(12, 49))
    at_position = times.dwell_s + times.settle_s + times.turn_s
    minutes = round((number * at_position + 5 * times.pitch_change_s + times.remount_s) / 60, 1)
    limit = {"count": min(number, len(few.cells))} if rng.random() < 0.5 else {"seconds": 60 * minutes}
    combine = ("largest", "mean", "volume", "in use")[int(rng.integers(4))]
    try:
        criterion = in_use(use) if combine == "in use" else of_parameters(combine, few)
        model, limits = one_visit(few), Limits(few.cells, times, np.ones(len(few.cells), bool), **limit)
        return best_plan(model, model, criterion, limits, seed=seed)[1]
    except InputError:
        return None

"""Plans against the bound of any plan, and against a published exchange algorithm."""

import time
import tomllib
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from plan.rigs import TURNS, head
from tumblecal.chain.head_ability import HeadAbility, Times
from tumblecal.chain.rig_file import rig_of
from tumblecal.design.criteria.criterion import attitudes_in_use, in_use, mean, volume, worst
from tumblecal.design.criteria.measure import measures
from tumblecal.design.model.cells import cells_of
from tumblecal.design.model.limits import in_order, limits_of
from tumblecal.design.model.one_visit import one_visit
from tumblecal.design.model.responses import responses_of
from tumblecal.design.model.schedule import schedule
from tumblecal.design.positions.bounded_search import best_plan
from tumblecal.design.positions.bounds import bounds
from tumblecal.design.positions.exchange import exchange
from tumblecal.ground.errors import InputError


PITCH = np.arange(-90.0, 91.0, 15.0)
STEPS = np.array([15, 30, 30, 45, 45, 60, 90])
MOUNTINGS = 10
PAPER = Path(__file__).parents[2] / "configs" / "paper24.toml"


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
    efficiency = np.array([plan.bounds.efficiency for plan in made])
    print(f"{count} heads, {count - len(made)} rejected (nothing to determine)")
    print(f"efficiency: median {np.median(efficiency):.3f}, 5 % quantile {np.quantile(efficiency, 0.05):.3f}, "
          f"least {efficiency.min():.3f}; at least 95 %: {np.mean(efficiency >= 0.95):.1%}")  # fmt: skip
    reasons = Counter(plan.bounds.reason.split(":")[0] for plan in made if plan.bounds.reason)
    print(*(f"  {number}: {reason}" for reason, number in reasons.most_common()), sep="\n")
    print(f"processor time: median {np.median(seconds):.2f} s")


def planned(rng: np.random.Generator, seed: int, whole, use):
    """The plan of a random head; None if nothing is to be determined."""
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
    ability = HeadAbility(tuple(np.arange(0, 360.0, step)), tuple(pitch), tuple(labels), times=times)
    number = int(rng.integers(12, 49))
    at_position = times.dwell_s + times.settle_s + times.turn_s
    minutes = round((number * at_position + 5 * times.pitch_change_s + times.remount_s) / 60, 1)
    limit = {"count": min(number, len(few.cells))} if rng.random() < 0.5 else {"minutes": minutes}
    criterion = (worst, mean, volume, lambda own: in_use(use))[int(rng.integers(4))]
    try:
        return best_plan(one_visit(few), criterion(few), limits_of(few.cells, ability, **limit), seed=seed)
    except InputError:
        return None


def speed() -> None:
    """24 and 240 positions out of 24 spindle angles x 7 pitch settings x 3 mountings, each at most once."""
    rig, begin = head(15, range(-90, 91, 30), TURNS), time.process_time()
    responses = responses_of(rig, cells_of(rig.ability))
    compiled = time.process_time()
    responses = responses_of(rig, responses.cells)
    print(f"derivatives: {compiled - begin:.2f} s, after compilation {time.process_time() - compiled:.3f} s\n")
    model = one_visit(responses)
    measures(model, worst(responses))(range(24)).if_added()
    print("| positions | criterion | method | restarts | processor time, s | value, mg | bound / value |")
    print("|---|---|---|---|---|---|---|")
    for count, restarts in ((24, 4), (240, 2)):
        limits = limits_of(responses.cells, rig.ability, count=count)

        def own(criterion, limits=limits, restarts=restarts):
            return exchange(limits, measures(model, criterion), restarts=restarts).cells

        methods = {"`exchange`": (own, restarts)}
        published = {"Cook and Nachtsheim": (lambda _, count=count: cook_nachtsheim(model, count), 1)}
        for criterion, listed in ((volume(responses), methods | published), (worst(responses), methods)):
            for name, (method, starts) in listed.items():
                begin = time.process_time()
                cells = method(criterion)
                took = time.process_time() - begin
                bound = bounds(model, criterion, limits, cells)
                print(f"| {count} | {criterion.name} | {name} | {starts} | {took:.2f} | {bound.value:.5f} "
                      f"| {bound.efficiency:.3f} |")  # fmt: skip


def cook_nachtsheim(model, count: int) -> list[int]:
    """D-optimal positions by the modified Fedorov exchange (1980, Technometrics 22, 315): the best exchange for each
    position in turn, until a pass gains less than 1e-4 of log det."""
    columns, nuisance = model.columns, slice(len(model.names), None)
    taken = list(np.random.default_rng(0).permutation(len(columns))[:count])

    def information(cells):
        rows = columns[cells].reshape(-1, columns.shape[2])
        return 1e-6 * np.eye(columns.shape[2]) + rows.T @ rows

    def gains(total, part):
        block = columns[:, :, part]
        return np.linalg.slogdet(np.eye(3) + block @ np.linalg.inv(total[part, part]) @ block.transpose(0, 2, 1))[1]

    value, before = 0.0, -np.inf
    while value > before + 1e-4:
        before = value if np.isfinite(before) else -1e300
        for k in range(count):
            rest = taken[:k] + taken[k + 1 :]
            total = information(rest)
            gain = gains(total, slice(None)) - gains(total, nuisance)
            gain[rest] = -np.inf
            taken[k] = int(np.argmax(gain))
        total = information(taken)
        value = np.linalg.slogdet(total)[1] - np.linalg.slogdet(total[nuisance, nuisance])[1]
    return taken


def remount() -> None:
    """The paper's head in the minutes of the paper's plan (24 positions in one mounting), with a remount if it pays.

    dbeta is free at every setting, dtheta in every mounting. In N positions gravity acts N times on three axes, so the largest
    uncertainty of a scale factor is at least sd sqrt(3 / N).
    """
    table = tomllib.loads(PAPER.read_text())
    alpha = {"start": 0, "step": 15, "count": 24}
    table["chain"]["leaves"] = {"dbeta": {"by": "mount.pitch"}, "dtheta": {"by": "mount"}}
    table["mounts"] = {"1": {"rotation_deg": [0, 0, 0]}, "2": {"rotation_deg": [0, 0, 90]}}
    table["head"] = {"alpha_deg": alpha, "beta_deg": PITCH.tolist(), "mounts": ["1", "2"]}
    rig = rig_of(table, PAPER)
    responses = responses_of(rig, cells_of(rig.ability))
    cells, model, criterion = responses.cells, one_visit(responses), worst(responses)
    of_paper = np.isin(cells.beta_deg, (0, 45, 90)) & (cells.alpha_deg % 45 == 0) & (np.array(cells.mounts) == "1")
    papers = np.flatnonzero(of_paper)
    value = float(criterion.of(model.covariance(papers)))
    minutes = schedule(cells, in_order(cells, papers), rig.ability.times).minutes
    print(f"The paper's plan: {minutes:.1f} min, largest uncertainty {value:.3f} (mg, mrad or 1e-3)\n")
    print("| pitch settings | minutes | remount, min | mountings | positions | times smaller | bound | sqrt(3/N) |")
    print("|---|---|---|---|---|---|---|---|")
    for lowest in (0, -90):
        for factor, pause in ((1, 30), (1, 5), (1, 0), (2, 30), (4, 30), (5, 30)):
            ability = replace(rig.ability, times=replace(rig.ability.times, remount_s=60.0 * pause))
            limits = limits_of(cells, ability, minutes=factor * minutes, allowed=cells.beta_deg >= lowest)
            found = best_plan(model, criterion, limits, seed=1)
            taken = found.chosen.cells
            least = 1e3 * responses.sd * np.sqrt(3 / len(taken))
            ratios = (value / other for other in (found.chosen.value, found.bounds.white, least))
            mounted = len(np.unique(cells.mounting[taken]))
            print(f"| {lowest} to 90° | {factor * minutes:.1f} | {pause} | {mounted} | {len(taken)} | "
                  f"{' | '.join(f'{ratio:.2f}' for ratio in ratios)} | {found.bounds.reason}", flush=True)  # fmt: skip

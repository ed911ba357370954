"""The paper's head with one remount: worst sensor uncertainty in the minutes of the paper's plan, and the bound of any plan.

    python benchmarks/plan_remount.py

The paper's plan has 24 positions (beta 0, 45, 90 deg; alpha every 45 deg) in one mounting. The minutes are those of its
schedule with the standard times. Other plans have a second mounting, if the remount pays in the minutes; dbeta is free at every
setting, dtheta in every mounting. In N positions gravity acts N times on three axes, so the largest uncertainty of a scale
factor is at least sd sqrt(3 / N) in any number of mountings.
"""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np

import tumblecal
from tumblecal.chain.rig_file import rig_of
from tumblecal.design.criteria.criterion import worst
from tumblecal.design.model.cells import cells_of
from tumblecal.design.model.limits import in_order, limits_of
from tumblecal.design.model.one_visit import one_visit
from tumblecal.design.model.responses import responses_of
from tumblecal.design.model.schedule import schedule
from tumblecal.design.positions.bounded_search import best_plan


RIG = Path(__file__).parents[1] / "configs" / "paper24.toml"
HEAD = """
[mounts]
1 = { rotation_deg = [0, 0, 0] }
2 = { rotation_deg = [0, 0, 90] }
[chain.leaves]
dbeta = { by = "mount.pitch" }
dtheta = { by = "mount" }
[head]
alpha_deg = { start = 0, step = 15, count = 24 }
beta_deg = [-90, -75, -60, -45, -30, -15, 0, 15, 30, 45, 60, 75, 90]
mounts = ["1", "2"]
"""


def main():
    tumblecal.enable_float64()
    table = tomllib.loads(RIG.read_text())
    added = tomllib.loads(HEAD)
    table["chain"] |= added.pop("chain")
    rig = rig_of(table | added, RIG)
    responses = responses_of(rig, cells_of(rig.ability))
    cells = responses.cells
    papers = np.flatnonzero(
        (np.array(cells.mounts) == "1") & np.isin(cells.beta_deg, (0, 45, 90)) & (cells.alpha_deg % 45 == 0)
    )
    assert len(papers) == 24
    criterion, sd = worst(responses), 1e3 * responses.sd
    model = one_visit(responses)
    of_paper = float(criterion.of(model.covariance(papers)))
    minutes = schedule(cells, in_order(cells, papers), rig.ability.times).minutes
    print(f"The paper's plan: {minutes:.1f} min, largest uncertainty {of_paper:.3f} (mg, mrad or 1e-3)")
    print(
        "| pitch, deg | minutes | remount, min | mountings | positions | paper / plan | bound | sqrt(3/N) | efficiency |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    reasons = set()
    for lowest in (0, -90):
        for factor, remount in ((1, 30), (1, 5), (1, 0), (2, 30), (4, 30), (5, 30)):
            ability = replace(rig.ability, times=replace(rig.ability.times, remount_s=60.0 * remount))
            allowed = cells.beta_deg >= lowest
            found = best_plan(
                model, criterion, limits_of(cells, ability, minutes=factor * minutes, allowed=allowed), seed=1
            )
            taken, value, bound = found.chosen.cells, found.chosen.value, found.bounds
            least, mounted = sd * np.sqrt(3 / len(taken)), len(np.unique(cells.mounting[taken]))
            print(
                f"| {lowest} to 90 | {factor * minutes:.1f} | {remount} | {mounted} | {len(taken)} "
                f"| {of_paper / value:.2f} | {of_paper / bound.white:.2f} | {of_paper / least:.2f} | {bound.efficiency:.3f} |",
                flush=True,
            )
            if bound.reason:
                reasons.add(f"{lowest} to 90, {factor * minutes:.1f} min, remount {remount} min: {bound.reason}")
    print(*sorted(reasons), sep="\n")


if __name__ == "__main__":
    main()

"""Time of the choice of positions, next to a published exchange algorithm.

    python benchmarks/plan_speed.py

24 and 240 positions out of 24 spindle angles x 7 pitch settings x 3 mountings (504 cells, each at most once), dbeta and dtheta
free at every setting. Criteria: the volume of the uncertainty ellipsoid of the nine sensor parameters (D), and their
largest uncertainty. The other algorithm is the modified Fedorov exchange of Cook and Nachtsheim (1980, Technometrics 22,
315) for D: for each position in turn the best exchange is made, until a pass gains less than 1e-4 of log det.
"""

import time
import tomllib
from pathlib import Path

import numpy as np

import tumblecal
from tumblecal.chain.rig_file import rig_of
from tumblecal.design.criteria.criterion import volume, worst
from tumblecal.design.criteria.measure import measures
from tumblecal.design.model.cells import cells_of
from tumblecal.design.model.limits import limits_of
from tumblecal.design.model.one_visit import one_visit
from tumblecal.design.model.responses import responses_of
from tumblecal.design.positions.bounds import bounds
from tumblecal.design.positions.exchange import exchange


RIG = """
schema = "tumblecal.rig/1"
[plan]
alpha_deg = { start = 0, step = 15, count = 24 }
beta_deg = [-90, -60, -30, 0, 30, 60, 90]
mounts = ["A", "B", "C"]
[chain.leaves]
dbeta = { by = "mount.pitch" }
dtheta = { by = "mount" }
[mounts]
A = { rotation_deg = [0, 0, 0] }
B = { rotation_deg = [0, 0, 90] }
C = { rotation_deg = [0, 90, 0] }
[noise]
sd = "0.15 mg"
[head]
alpha_deg = { start = 0, step = 15, count = 24 }
"""


def modified_fedorov(columns, shared, count, seed):
    """D-optimal positions for the first `shared` parameters; the others are free. Each cell at most once."""
    rng = np.random.default_rng(seed)
    taken = list(rng.permutation(len(columns))[:count])
    nuisance = slice(shared, None)
    ridge = 1e-6 * np.eye(columns.shape[2])

    def information(cells):
        rows = columns[cells].reshape(-1, columns.shape[2])
        return ridge + rows.T @ rows

    def log_det(total):
        return np.linalg.slogdet(total)[1] - np.linalg.slogdet(total[nuisance, nuisance])[1]

    def gains(total, part):
        block = columns[:, :, part]
        return np.linalg.slogdet(np.eye(3) + block @ np.linalg.inv(total[part, part]) @ block.transpose(0, 2, 1))[1]

    value = log_det(information(taken))
    while True:
        before = value
        for k in range(count):
            rest = taken[:k] + taken[k + 1 :]
            total = information(rest)
            gain = gains(total, slice(None)) - gains(total, nuisance)
            gain[rest] = -np.inf
            taken[k] = int(np.argmax(gain))
            value = log_det(information(taken))
        if value < before + 1e-4:
            return taken


def main():
    tumblecal.enable_float64()
    rig = rig_of(tomllib.loads(RIG), Path("speed.toml"))
    begin = time.process_time()
    responses = responses_of(rig, cells_of(rig.ability))
    print(f"derivatives, compilation included: {time.process_time() - begin:.2f} s; ", end="")
    begin = time.process_time()
    responses = responses_of(rig, responses.cells)
    model = one_visit(responses)
    print(f"after compilation: {time.process_time() - begin:.3f} s")
    measures(model, worst(responses))(range(24)).if_added()
    print("| positions | criterion | method | restarts | processor time, s | value, mg | bound / value |")
    print("|---|---|---|---|---|---|---|")
    for count, restarts in ((24, 4), (240, 2)):
        limits = limits_of(responses.cells, rig.ability, count=count)
        for criterion in (volume(responses), worst(responses)):
            begin = time.process_time()
            found = exchange(limits, measures(model, criterion), restarts=restarts)
            took = time.process_time() - begin
            bound = bounds(model, criterion, limits, found.cells)
            row(count, criterion.name, "`exchange`", restarts, took, found.value, bound)
        begin = time.process_time()
        taken = modified_fedorov(model.columns, len(model.names), count, 0)
        took = time.process_time() - begin
        bound = bounds(model, volume(responses), limits, taken)
        row(count, "volume", "Cook and Nachtsheim, numpy", 1, took, bound.value, bound)


def row(count, criterion, method, restarts, took, value, bound):
    """A line of the table."""
    print(f"| {count} | {criterion} | {method} | {restarts} | {took:.2f} | {value:.5f} | {bound.efficiency:.3f} |")


if __name__ == "__main__":
    main()

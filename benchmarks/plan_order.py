"""Benefit of the order of a plan under drift, random walk and warm-up of the biases, with a simulation in plain numpy.

    python benchmarks/plan_order.py --runs 4000 --seed 1
    python benchmarks/plan_order.py --speed

24 positions on a dividing head: pitch settings 0, 45 and 90 deg with eight spindle angles each (the paper's), or with four in
each of two mountings, the second one turned by 90 deg about z. Orders: sequential, random within the visits, `best_order` in
the minutes of the sequential one, and without a limit. Readings, noise (sampled every second) and the fits are numpy of this
file; only the orders and the standard deviations that they promise come from the program. Errors are root mean squares over the
runs, the largest of the parameters, in mg, 1e-3 or mrad: after a plain fit (white noise), and after a fit with the noise model.
The biases are those at the start of a random walk, at the mean time of a drift, and after the warm-up.
"""

import argparse
import time
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np

import tumblecal
from tumblecal.chain.head_ability import SlowNoise
from tumblecal.chain.rig_file import rig_of
from tumblecal.design.criteria.criterion import worst
from tumblecal.design.model.cells import cells_of
from tumblecal.design.model.limits import in_order
from tumblecal.design.model.responses import responses_of
from tumblecal.design.order.best_order import best_order


RIG = """
schema = "tumblecal.rig/1"
[plan]
alpha_deg = { start = 0, step = 90, count = 4 }
beta_deg = [0, 45, 90]
mounts = ["A", "B"]
[chain.leaves]
dbeta = { by = "mount.pitch" }
dtheta = { by = "mount" }
[mounts]
A = { rotation_deg = [0, 0, 0] }
B = { rotation_deg = [0, 0, 90] }
[noise]
sd = "0.1 mg"
[priors]
dbeta = "1 arcmin"
[head]
alpha_deg = { start = 0, step = 90, count = 4 }
[head.times]
dwell_s = 60
settle_s = 10
turn_s = 15
pitch_change_s = 60
remount_s = 900
[head.repeatability]
pitch = "10 arcsec"
"""
SD_G, PRIOR_RAD, AGAIN_RAD, DWELL_S = 1e-4, np.radians(1 / 60), np.radians(10 / 3600), 60.0
DRIFT_G_PER_H, WALK, WARM_UP_G, WARM_UP_S = 5e-4, 3e-6, 1e-3, 1200.0
NOISES = {
    "linear drift, 0.5 mg/h": SlowNoise(drift_g_per_h=DRIFT_G_PER_H),
    "random walk, 3 ug/sqrt(s)": SlowNoise(random_walk_g_per_rts=WALK),
    "warm-up, 1 mg, 1200 s": SlowNoise(warm_up_g=WARM_UP_G, warm_up_time_s=WARM_UP_S),
    "all three": SlowNoise(
        drift_g_per_h=DRIFT_G_PER_H, random_walk_g_per_rts=WALK, warm_up_g=WARM_UP_G, warm_up_time_s=WARM_UP_S
    ),
}


def columns(cells, planned):
    """Derivatives of the readings (positions, 3, parameters), g by unit: dK, bias, gamma; pitch visits; mountings."""
    a, b = np.radians(cells.alpha_deg[planned.cells]), np.radians(cells.beta_deg[planned.cells])
    turned = np.array([cells.mounts[k] == "B" for k in planned.cells])

    def in_mount(head):
        return np.where(turned[:, None], np.stack([head[:, 1], -head[:, 0], head[:, 2]], axis=1), head)

    force = in_mount(np.stack([-np.sin(b), np.cos(b) * np.sin(a), np.cos(b) * np.cos(a)], axis=1))
    tilt = in_mount(np.stack([-np.cos(b), -np.sin(b) * np.sin(a), -np.sin(b) * np.cos(a)], axis=1))
    x, y, z = np.eye(3)
    made = [force[:, k, None] * np.eye(3)[k] for k in range(3)] + [np.tile(axis, (len(a), 1)) for axis in (x, y, z)]
    made += [force[:, :1] * y, force[:, :1] * z, force[:, 1:2] * z]
    made += [tilt * (planned.pitch_visit == visit)[:, None] for visit in range(planned.pitch_visit[-1] + 1)]
    for visit in range(planned.mount_visit[-1] + 1):
        made += [np.cross(axis, force) * (planned.mount_visit == visit)[:, None] for axis in (x, y, z)]
    return np.stack(made, axis=2)


def prior_of(cells, planned, parameters):
    """Information of the errors of the pitch settings: what visits of one setting share, and what each adds."""
    first = np.unique(planned.pitch_visit, return_index=True)[1]
    beta = cells.beta_deg[planned.cells[first]]
    covariance = PRIOR_RAD**2 * (beta[:, None] == beta) + AGAIN_RAD**2 * np.eye(len(beta))
    information = np.zeros((parameters, parameters))
    information[9 : 9 + len(beta), 9 : 9 + len(beta)] = np.linalg.inv(covariance)
    return information, np.linalg.cholesky(covariance)


def slow_means(rng, noise, start_s, runs):
    """Means over the dwells (runs, positions, 3) of drawn slow noise, sampled every second."""
    dwell = int(DWELL_S)
    seconds = np.rint(start_s - start_s[0]).astype(int)
    at = seconds[:, None] + np.arange(dwell)
    drawn = np.zeros((runs, len(start_s), 3))
    if noise.drift_g_per_h:
        middle = (seconds - seconds.mean()) / 3600
        drawn += noise.drift_g_per_h * rng.standard_normal((runs, 1, 3)) * middle[:, None]
    if noise.warm_up_g:
        fading = np.exp(-(at + 0.5) / noise.warm_up_time_s).mean(axis=1)
        drawn += noise.warm_up_g * rng.standard_normal((runs, 1, 3)) * fading[:, None]
    if noise.random_walk_g_per_rts:
        for run in range(runs):
            steps = noise.random_walk_g_per_rts * rng.standard_normal((int(at.max()) + 1, 3))
            drawn[run] += np.cumsum(steps, axis=0)[at].mean(axis=1)
    return drawn


def slow_model(noise, start_s):
    """Covariance of these means on each axis."""
    since, count = start_s - start_s[0], len(start_s)
    drift = noise.drift_g_per_h * (since - since.mean()) / 3600
    fading = noise.warm_up_g * np.exp(-(since[:, None] + np.arange(600) / 10) / noise.warm_up_time_s).mean(axis=1)
    middle = since + DWELL_S / 2
    walk = noise.random_walk_g_per_rts**2 * (np.minimum.outer(middle, middle) - DWELL_S / 6 * np.eye(count))
    return np.outer(drift, drift) + np.outer(fading, fading) + walk


def errors(rng, cells, planned, noise, runs):
    """Root mean square errors (plain fit, fit with the noise model) of the nine parameters, in thousandths."""
    design = columns(cells, planned)
    count, _, parameters = design.shape
    information, root = prior_of(cells, planned, parameters)
    visits = len(root)
    settings = rng.standard_normal((runs, visits)) @ root.T
    readings = slow_means(rng, noise, planned.start_s, runs) + SD_G * rng.standard_normal((runs, count, 3))
    readings += np.einsum("pav,rv->rpa", design[:, :, 9 : 9 + visits], settings)
    found = []
    for covariance in (SD_G**2 * np.eye(count), SD_G**2 * np.eye(count) + slow_model(noise, planned.start_s)):
        weight = np.linalg.inv(covariance)
        weighted = np.einsum("pq,qak->pak", weight, design)
        total = information + np.einsum("pak,pal->kl", design, weighted)
        estimates = np.linalg.solve(total, np.einsum("pak,rpa->kr", weighted, readings))
        found.append(1e3 * np.sqrt(np.mean(estimates[:9] ** 2, axis=1)))
    return found


def row(name, rng, responses, orders, noise, runs):
    """A row of the table: duration, visits, promise, bound, errors."""
    made = [errors(rng, responses.cells, one.schedule, noise, max(runs // len(orders), 1)) for one in orders]
    plain, modelled = np.sqrt(np.mean(np.square(made), axis=0))
    value, known = np.sqrt(np.mean([[one.value**2, one.drift_known**2] for one in orders], axis=0))
    bias = np.arange(9) // 3 == 1
    minutes = np.mean([one.schedule.minutes for one in orders])
    visits = orders[0].schedule.pitch_visit[-1] + 1
    print(
        f"| {name} | {minutes:.0f} | {visits} | {value:.4f} | {known:.4f} | {plain.max():.4f} | {modelled.max():.4f} | "
        f"{plain[~bias].max():.4f} | {modelled[~bias].max():.4f} |",
        flush=True,
    )


def table(text, runs, seed):
    """Errors for every noise and order."""
    rig = rig_of(tomllib.loads(text), Path("plan_order.toml"))
    responses = responses_of(rig, cells_of(rig.ability))
    criterion, rng = worst(responses), np.random.default_rng(seed)
    listed = in_order(responses.cells, np.arange(len(responses.cells)))
    print(
        "| order | minutes | visits | promised | drift known | plain | with model | plain, no bias | with model, no bias |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for title, noise in NOISES.items():
        print(f"| {title} |||||||||")
        ability = replace(rig.ability, slow_noise=noise)

        def ordered(kind, seed=seed, minutes=None, ability=ability):
            return best_order(responses, ability, criterion, listed, kind=kind, seed=seed, minutes=minutes)

        sequential = ordered("keep")
        row("sequential", rng, responses, [sequential], noise, runs)
        row("random", rng, responses, [ordered("random", seed=seed + k) for k in range(40)], noise, runs)
        row("best, same time", rng, responses, [ordered("best", minutes=sequential.schedule.minutes)], noise, runs)
        row("best", rng, responses, [ordered("best")], noise, runs)


def speed():
    """CPU time of a search for 24 and 240 positions on a head with 24 x 7 x 3 cells."""
    text = RIG.replace("step = 90, count = 4", "step = 15, count = 24").replace(
        "[0, 45, 90]", "[-90, -60, -30, 0, 30, 60, 90]"
    )
    text = text.replace('["A", "B"]', '["A", "B", "C"]').replace(
        "[noise]", "C = { rotation_deg = [0, 90, 0] }\n[noise]"
    )
    rig = rig_of(tomllib.loads(text), Path("plan_order.toml"))
    responses = responses_of(rig, cells_of(rig.ability))
    ability, criterion = replace(rig.ability, slow_noise=NOISES["all three"]), worst(responses)
    for count in (24, 240):
        chosen = np.random.default_rng(0).choice(len(responses.cells), count, replace=False)
        begin = time.process_time()
        found = best_order(responses, ability, criterion, in_order(responses.cells, chosen))
        seconds = time.process_time() - begin
        kept = best_order(responses, ability, criterion, in_order(responses.cells, chosen), kind="keep")
        sizes = f"sequential {kept.value:.4g}, best {found.value:.4g}, drift known {found.drift_known:.4g}"
        print(f"{count} positions: {seconds:.2f} s; {sizes}")


def main():
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=4000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--speed", action="store_true", help="CPU time of the search instead")
    options = parser.parse_args()
    tumblecal.enable_float64()
    if options.speed:
        speed()
    else:
        one = RIG.replace('mounts = ["A", "B"]', 'mounts = ["A"]').replace("B = { rotation_deg = [0, 0, 90] }\n", "")
        for title, text in (
            ("one mounting, eight spindle angles", one.replace("step = 90, count = 4", "step = 45, count = 8")),
            ("two mountings, four spindle angles", RIG),
        ):
            print(title)
            table(text, options.runs, options.seed)


if __name__ == "__main__":
    main()

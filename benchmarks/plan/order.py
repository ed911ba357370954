"""Benefit of the order of a plan under drift, random walk and warm-up of the biases, with a simulation in plain numpy.

24 positions: pitch settings 0, 45 and 90 deg with eight spindle angles each, or with four in each of two mountings.
Readings, noise (drawn every second) and fits are of this file; the orders and their promises are the program's. Errors are
root mean squares, the largest of the parameters, in mg, 1e-3 or mrad. The biases are those at the start of a random walk,
at the mean time of a drift, and after the warm-up.
"""

import time
from dataclasses import replace

import numpy as np

from plan.rigs import TURNS, head
from tumblecal.chain.head_ability import SlowNoise
from tumblecal.design.criteria.criterion import worst
from tumblecal.design.model.cells import cells_of
from tumblecal.design.model.limits import in_order
from tumblecal.design.model.responses import responses_of
from tumblecal.design.order.best_order import best_order


SD_G, PRIOR_RAD, AGAIN_RAD, DWELL_S = 1e-4, np.radians(1 / 60), np.radians(10 / 3600), 60.0
ABILITY = {
    "sd_mg": 0.1,
    "prior": "1 arcmin",
    "times": {"dwell_s": 60, "settle_s": 10, "turn_s": 15, "pitch_change_s": 60, "remount_s": 900},
    "repeatability": {"pitch": "10 arcsec"},
}
DRIFT, WALK = {"drift_g_per_h": 5e-4}, {"random_walk_g_per_rts": 3e-6}
WARM_UP = {"warm_up_g": 1e-3, "warm_up_time_s": 1200.0}
NOISES = {
    "linear drift, 0.5 mg/h": SlowNoise(**DRIFT),
    "random walk, 3 ug/sqrt(s)": SlowNoise(**WALK),
    "warm-up, 1 mg, 1200 s": SlowNoise(**WARM_UP),
    "all three": SlowNoise(**DRIFT, **WALK, **WARM_UP),
}
HEADS = {
    "one mounting, eight spindle angles": (45, {"A": TURNS["A"]}),
    "two mountings, four spindle angles": (90, {"A": TURNS["A"], "B": TURNS["B"]}),
}


def derivatives(cells, planned) -> np.ndarray:
    """Derivatives of the readings (positions, 3, parameters): dK, bias, gamma; pitch visits; mountings."""
    a, b = np.radians(cells.alpha_deg[planned.cells]), np.radians(cells.beta_deg[planned.cells])
    turned = np.array([cells.mounts[k] == "B" for k in planned.cells])[:, None]

    def in_mount(vectors):
        return np.where(turned, np.stack([vectors[:, 1], -vectors[:, 0], vectors[:, 2]], axis=1), vectors)

    force = in_mount(np.stack([-np.sin(b), np.cos(b) * np.sin(a), np.cos(b) * np.cos(a)], axis=1))
    tilt = in_mount(np.stack([-np.cos(b), -np.sin(b) * np.sin(a), -np.sin(b) * np.cos(a)], axis=1))
    axes = np.eye(3)
    made = [force * axis for axis in axes] + [np.tile(axis, (len(a), 1)) for axis in axes]
    made += [force[:, :1] * axes[1], force[:, :1] * axes[2], force[:, 1:2] * axes[2]]
    made += [tilt * (planned.pitch_visit == visit)[:, None] for visit in range(planned.pitch_visit[-1] + 1)]
    for visit in range(planned.mount_visit[-1] + 1):
        made += [np.cross(axis, force) * (planned.mount_visit == visit)[:, None] for axis in axes]
    return np.stack(made, axis=2)


def slow_means(rng: np.random.Generator, noise: SlowNoise, start_s: np.ndarray, runs: int) -> np.ndarray:
    """Means over the dwells (runs, positions, 3) of slow noise, drawn every second."""
    seconds = np.rint(start_s - start_s[0]).astype(int)
    at = seconds[:, None] + np.arange(int(DWELL_S))
    middle = (seconds - seconds.mean()) / 3600
    drawn = noise.drift_g_per_h * rng.standard_normal((runs, 1, 3)) * middle[:, None]
    fading = np.exp(-(at + 0.5) / (noise.warm_up_time_s or np.inf)).mean(axis=1)
    drawn += noise.warm_up_g * rng.standard_normal((runs, 1, 3)) * fading[:, None]
    for run in range(runs if noise.random_walk_g_per_rts else 0):
        steps = noise.random_walk_g_per_rts * rng.standard_normal((int(at.max()) + 1, 3))
        drawn[run] += np.cumsum(steps, axis=0)[at].mean(axis=1)
    return drawn


def slow_covariance(noise: SlowNoise, start_s: np.ndarray) -> np.ndarray:
    """Covariance of these means on each axis."""
    since, count = start_s - start_s[0], len(start_s)
    drift = noise.drift_g_per_h * (since - since.mean()) / 3600
    within = since[:, None] + np.arange(600) / 10
    fading = noise.warm_up_g * np.exp(-within / (noise.warm_up_time_s or np.inf)).mean(axis=1)
    middle = since + DWELL_S / 2
    walk = noise.random_walk_g_per_rts**2 * (np.minimum.outer(middle, middle) - DWELL_S / 6 * np.eye(count))
    return np.outer(drift, drift) + np.outer(fading, fading) + walk


def errors(rng: np.random.Generator, cells, planned, noise: SlowNoise, runs: int) -> list[np.ndarray]:
    """Rms errors of the nine parameters, in thousandths: fit with white noise, and with the noise model."""
    design = derivatives(cells, planned)
    count, _, parameters = design.shape
    first = np.unique(planned.pitch_visit, return_index=True)[1]
    beta = cells.beta_deg[planned.cells[first]]
    # Visits of one setting share an error, and each adds one.
    settings, part = PRIOR_RAD**2 * (beta[:, None] == beta) + AGAIN_RAD**2 * np.eye(len(beta)), slice(9, 9 + len(beta))
    information = np.zeros((parameters, parameters))
    information[part, part] = np.linalg.inv(settings)
    readings = slow_means(rng, noise, planned.start_s, runs) + SD_G * rng.standard_normal((runs, count, 3))
    drawn = rng.standard_normal((runs, len(beta))) @ np.linalg.cholesky(settings).T
    readings += np.einsum("pav,rv->rpa", design[:, :, part], drawn)
    white, found = SD_G**2 * np.eye(count), []
    for covariance in (white, white + slow_covariance(noise, planned.start_s)):
        weighted = np.einsum("pq,qak->pak", np.linalg.inv(covariance), design)
        total = information + np.einsum("pak,pal->kl", design, weighted)
        estimates = np.linalg.solve(total, np.einsum("pak,rpa->kr", weighted, readings))
        found.append(1e3 * np.sqrt(np.mean(estimates[:9] ** 2, axis=1)))
    return found


def order(runs: int, seed: int) -> None:
    """A row for each head, noise and order; random orders are 40."""
    heads = ("order", "minutes", "visits of a pitch setting", "promised", "drift known", "fit with the noise model")
    heads = (*heads, "fit with white noise", "the same, without biases")
    print(f"| {' | '.join(heads)} |\n{'|---' * len(heads)}|")
    for title, (step, turns) in HEADS.items():
        rig, rng = head(step, (0, 45, 90), turns, **ABILITY), np.random.default_rng(seed)
        responses = responses_of(rig, cells_of(rig.ability))
        listed = in_order(responses.cells, np.arange(len(responses.cells)))
        for words, noise in NOISES.items():
            print(f"| **{title}**, *{words}* |||||||")
            ability = replace(rig.ability, slow_noise=noise)

            def ordered(kind, seed=seed, minutes=None, ability=ability, responses=responses, listed=listed):
                return best_order(responses, ability, worst(responses), listed, kind=kind, seed=seed, minutes=minutes)

            sequential = ordered("keep")
            orders = {
                "sequential": [sequential],
                "random": [ordered("random", seed=seed + k) for k in range(40)],
                "best, same time": [ordered("best", minutes=sequential.schedule.minutes)],
                "best": [ordered("best")],
            }
            for name, made in orders.items():
                each = [errors(rng, responses.cells, one.schedule, noise, max(runs // len(made), 1)) for one in made]
                plain, modelled = np.sqrt(np.mean(np.square(each), axis=0))
                value, known = np.sqrt(np.mean([(one.value**2, one.drift_known**2) for one in made], axis=0))
                minutes = np.mean([one.schedule.minutes for one in made])
                without = plain[np.arange(9) // 3 != 1].max()
                numbers = (value, known, modelled.max(), plain.max(), without)
                print(f"| {name} | {minutes:.0f} | {made[0].schedule.pitch_visit[-1] + 1} | "
                      f"{' | '.join(f'{number:.3f}' for number in numbers)} |", flush=True)  # fmt: skip


def speed() -> None:
    """Processor time of a search for 24 and 240 positions on a head with 24 x 7 x 3 cells."""
    rig = head(15, range(-90, 91, 30), TURNS, **ABILITY)
    responses = responses_of(rig, cells_of(rig.ability))
    ability, criterion = replace(rig.ability, slow_noise=NOISES["all three"]), worst(responses)
    for count in (24, 240):
        cells = np.random.default_rng(0).choice(len(responses.cells), count, replace=False)
        listed, begin = in_order(responses.cells, cells), time.process_time()
        found = best_order(responses, ability, criterion, listed)
        seconds = time.process_time() - begin
        kept = best_order(responses, ability, criterion, listed, kind="keep")
        print(f"{count} positions: {seconds:.2f} s; sequential {kept.value:.4g}, best {found.value:.4g}")

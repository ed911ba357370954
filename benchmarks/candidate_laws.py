"""Errors that no entry of the catalogue describes: is the stated region the true one, and the candidate law the right one?

    python benchmarks/candidate_laws.py --seeds 11 19

Products of inputs, decays with a harmonic, knees of another input, harmonics of the index and errors in a part of the angles,
of 20 sigma, in 4 x 12 positions of the blind instrument; an error that an entry describes to within 7 sigma is drawn again.
"""

import argparse
from collections import Counter
from dataclasses import replace

import numpy as np

import blind_instrument as blind
from blind_noise import position_set
from blind_sized import inputs
from tumblecal.diagnosis import Diagnoser


PLAN, SIZE, LEAST_VISIBLE, UNLIKE_ENTRIES = (4, 12), 20.0, 0.3, 7.0
POWERS = [(1, 2, 0), (0, 1, 2), (2, 0, 1), (1, 1, 1), (2, 1, 0), (0, 2, 1), (1, 0, 2), (2, 2, 0), (1, 3, 0), (2, 1, 1)]


def product(setup, u, t, rng):
    axis, powers = rng.integers(3), POWERS[rng.integers(len(POWERS))]
    words = " ".join(f"u_{a}{f'^{n}' if n > 1 else ''}" for a, n in zip(blind.AXES, powers, strict=True) if n)
    return on(axis, np.prod(u ** np.array(powers), axis=1)), (blind.AXES[axis], words)


def decay(setup, u, t, rng):
    axis, order, tau = rng.integers(3), rng.integers(1, 4), rng.uniform(0.1, 0.5) * t[-1]
    wave = np.cos(order * setup.alpha - rng.uniform(0, 2 * np.pi))
    return on(axis, np.exp(-t / tau) * wave), (
        blind.AXES[axis],
        f"({order} alpha) exp(-t" if order > 1 else "(alpha) exp(-t",
    )


def knee(setup, u, t, rng):
    axis, other = rng.choice(3, 2, replace=False)
    return on(axis, np.maximum(u[:, other] - rng.uniform(-0.5, 0.5), 0)), (
        blind.AXES[axis],
        f"max(u_{blind.AXES[other]}",
    )


def index(setup, u, t, rng):
    order = rng.integers(3, 6)
    error = 1e-4 * np.cos(order * setup.alpha - rng.uniform(0, 2 * np.pi))
    moved = blind.readings(replace(setup, alpha=setup.alpha + error), setup.nominal, {})
    return moved - blind.readings(setup, setup.nominal, {}), ("alpha", f"({order} alpha)")


def local(setup, u, t, rng):
    settings, angles = PLAN
    columns = (rng.integers(angles) + np.arange(rng.integers(2, 5))) % angles
    first, count = rng.integers(settings - 1), rng.integers(1, 3)
    inside = np.isin(np.tile(np.arange(angles), settings), columns) & (setup.pitch >= first)
    inside &= setup.pitch < first + count
    shape = inside * rng.uniform(0.6, 1.4, len(u))
    chosen = rng.choice(3, rng.integers(1, 3), replace=False)
    return sum(on(axis, shape * rng.choice([-1, 1]) * rng.uniform(0.5, 1)) for axis in chosen), ("", "[alpha")


def on(axis, values):
    return values[:, None] * np.eye(3)[axis]


KINDS = {"product": product, "decay": decay, "knee": knee, "index": index, "local": local}


def case(kind, seed):
    """Setup, readings, the error added, where it acts and words of its law."""
    rng = np.random.default_rng([4343, seed, list(KINDS).index(kind)])
    while True:
        setup = blind.random_setup(rng, *PLAN)
        projector = blind.unreachable(setup)
        added, truth = KINDS[kind](setup, inputs(setup), setup.time_s - setup.time_s[0], rng)
        seen = projector @ added.ravel()
        if not np.linalg.norm(seen) > LEAST_VISIBLE * np.linalg.norm(added):
            continue
        scale = SIZE / np.linalg.norm(seen)
        if blind.resembles_none(setup, projector, seen * scale, UNLIKE_ENTRIES):
            added *= scale * blind.SIGMA
            noise = blind.SIGMA * rng.normal(size=added.shape)
            return setup, blind.readings(setup, setup.nominal, {}) + added + noise, added, truth


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, nargs=2, default=(11, 19))
    parser.add_argument("--unknown", action="store_true", help="the noise is not stated")
    args, diagnoser = parser.parse_args(), Diagnoser(nested=False)
    counts, errors = Counter(), []
    for kind in KINDS:
        for seed in range(*args.seeds):
            setup, measured, added, (acts_on, words) = case(kind, seed)
            diagnosis = diagnoser(position_set(setup, measured, not args.unknown))
            own = diagnosis.unnamed
            counts[kind, diagnosis.verdict] += 1
            print(kind, seed, diagnosis.verdict, diagnosis.best.labels, own and own.excess.words, flush=True)
            if own is None:
                continue
            inside = np.any(added != 0, axis=1)
            both, either = np.sum(own.excess.positions & inside), np.sum(own.excess.positions | inside)
            counts[kind, "region"] += bool(both >= 0.5 * either)
            if own.law is not None:
                first = own.law.terms[0]
                right = words in first.form.words[0] and (not acts_on or first.acts_on == acts_on)
                counts[kind, "law"] += 1
                counts[kind, "right law"] += right and (kind == "local" or len(own.law.terms) == 1)
                errors.append((1e3 * own.law.before_g, 1e3 * own.law.after_g))
                print(
                    "   ",
                    right,
                    [(term.acts_on, *term.form.words) for term in own.law.terms],
                    errors[-1],
                    acts_on,
                    words,
                )
    for kind in KINDS:
        print(kind, {what: count for (name, what), count in counts.items() if name == kind})
    if errors:
        print("held-out error / mg, medians before and after:", np.median(errors, axis=0))


if __name__ == "__main__":
    main()

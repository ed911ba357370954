"""The population `laws`: errors of 20 sigma without an entry, in a region. Are the region and the candidate law correct?

Products of inputs, decays with a harmonic, knees of another input, harmonics of the index and errors in a part of the
angles, in 4 x 12 positions; an error that an entry describes to within 7 sigma is drawn again. `right`: `unexplained` is in
the class.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

import blind_instrument as blind
import tumblecal


tumblecal.enable_float64()
from blind.acting import inputs  # noqa: E402
from blind.judge import UNEXPLAINED, Answer, Case, answer_of_diagnosis  # noqa: E402
from blind_noise import position_set  # noqa: E402
from tumblecal.diagnosis import Diagnoser  # noqa: E402


PLAN, SIZE, LEAST_VISIBLE, UNLIKE_ENTRIES = (4, 12), 20.0, 0.3, 7.0
POWERS = [(1, 2, 0), (0, 1, 2), (2, 0, 1), (1, 1, 1), (2, 1, 0), (0, 2, 1), (1, 0, 2), (2, 2, 0), (1, 3, 0), (2, 1, 1)]


def product(setup, u, t, rng):
    axis, powers = rng.integers(3), POWERS[rng.integers(len(POWERS))]
    words = " ".join(f"u_{a}{f'^{n}' if n > 1 else ''}" for a, n in zip(blind.AXES, powers, strict=True) if n)
    return on(axis, np.prod(u ** np.array(powers), axis=1)), blind.AXES[axis], words


def decay(setup, u, t, rng):
    axis, order, tau = rng.integers(3), rng.integers(1, 4), rng.uniform(0.1, 0.5) * t[-1]
    wave = np.exp(-t / tau) * np.cos(order * setup.alpha - rng.uniform(0, 2 * np.pi))
    return on(axis, wave), blind.AXES[axis], f"({order} alpha) exp(-t" if order > 1 else "(alpha) exp(-t"


def knee(setup, u, t, rng):
    axis, other = rng.choice(3, 2, replace=False)
    beyond = np.maximum(u[:, other] - rng.uniform(-0.5, 0.5), 0)
    return on(axis, beyond), blind.AXES[axis], f"max(u_{blind.AXES[other]}"


def index(setup, u, t, rng):
    order = rng.integers(3, 6)
    error = 1e-4 * np.cos(order * setup.alpha - rng.uniform(0, 2 * np.pi))
    moved = blind.readings(replace(setup, alpha=setup.alpha + error), setup.nominal, {})
    return moved - blind.readings(setup, setup.nominal, {}), "alpha", f"({order} alpha)"


def local(setup, u, t, rng):
    settings, angles = PLAN
    columns = (rng.integers(angles) + np.arange(rng.integers(2, 5))) % angles
    first, count = rng.integers(settings - 1), rng.integers(1, 3)
    inside = np.isin(np.tile(np.arange(angles), settings), columns) & (setup.pitch >= first)
    shape = inside * (setup.pitch < first + count) * rng.uniform(0.6, 1.4, len(u))
    axes = rng.choice(3, rng.integers(1, 3), replace=False)
    return sum(on(axis, shape * rng.choice([-1, 1]) * rng.uniform(0.5, 1)) for axis in axes), "", "[alpha"


def on(axis, values):
    return values[:, None] * np.eye(3)[axis]


KINDS = {own.__name__: own for own in (product, decay, knee, index, local)}


def cases(kind: str, count: int, seed: int) -> Iterator[Case]:
    """Cases of so many seeds from `seed` on; the noise is stated."""
    for number in range(seed, seed + count):
        rng = np.random.default_rng([4343, number, list(KINDS).index(kind)])
        while True:
            setup = blind.random_setup(rng, *PLAN)
            projector = blind.unreachable(setup)
            added, acts_on, words = KINDS[kind](setup, inputs(setup), setup.time_s - setup.time_s[0], rng)
            visible = projector @ added.ravel()
            if not np.linalg.norm(visible) > LEAST_VISIBLE * np.linalg.norm(added):
                continue
            scale = SIZE / np.linalg.norm(visible)
            if blind.resembles_none(setup, projector, visible * scale, UNLIKE_ENTRIES):
                break
        added *= scale * blind.SIGMA
        noise = blind.SIGMA * rng.normal(size=added.shape)
        data = position_set(setup, blind.readings(setup, setup.nominal, {}) + added + noise, True)
        yield Case(kind, number, "4x12", True, ((UNEXPLAINED,),), data, (added, acts_on, words), SIZE)


def answered(drawn: Iterable[Case]) -> Iterator[tuple[Case, Answer]]:
    """Diagnosed, with region, law and held-out error."""
    diagnoser = Diagnoser(nested=False)
    for case in drawn:
        added, acts_on, words = case.hidden
        diagnosis = diagnoser(case.data)
        own, measures = diagnosis.unnamed, {"region": 0.0, "law": 0.0}
        if own is not None:
            inside = np.any(added != 0, axis=1)
            both, either = np.sum(own.excess.positions & inside), np.sum(own.excess.positions | inside)
            measures["region"] = float(both >= 0.5 * either)
        if own is not None and own.law is not None:
            first, one = own.law.terms[0], len(own.law.terms) == 1
            correct = words in first.form.words[0] and (not acts_on or first.acts_on == acts_on)
            measures["law"] = float(correct and (case.kind == "local" or one))
            measures |= {"error before / mg": 1e3 * own.law.before_g, "error after / mg": 1e3 * own.law.after_g}
        yield case, answer_of_diagnosis(diagnosis, measures=measures)

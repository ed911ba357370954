"""The populations `noise` and `repeats`: noise that is not as assumed, and errors of an attitude that is measured twice.

`repeats`: `axis`, an error of one axis that differs from attitude to attitude; `two`, two attitudes in error; `noise`, one axis
with three times the noise; `null`, nothing. Errors have a visible norm of 14 sigma.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

import blind_instrument as blind
import blind_noise
import tumblecal


tumblecal.enable_float64()
from blind.judge import UNEXPLAINED, Answer, Case, answer_of_diagnosis  # noqa: E402
from blind.plans import twice  # noqa: E402
from tumblecal.diagnosis import Diagnoser  # noqa: E402


KINDS = {
    f"{noise} {words}": (noise, d) for noise in blind_noise.NOISES for words, d in (("d=10", 10.0), ("nothing", 0.0))
}
REPEATED = {"axis": (UNEXPLAINED,), "two": (UNEXPLAINED,), "noise": ("noise_unequal",), "null": ()}


def cases(kind: str, count: int, seed: int) -> Iterator[Case]:
    """A fourth of the cases each for both plans and for noise stated and unknown."""
    number, (noise, d) = 0, KINDS[kind]
    for place, plan in enumerate(blind_noise.PLANS):
        for known in (True, False):
            rng = np.random.default_rng([seed, blind_noise.NOISES.index(noise), place, d > 0])
            for _ in range(max(1, count // 4)):
                setup, readings, name = blind_noise.case(rng, plan, noise, d)
                data, truth = blind_noise.position_set(setup, readings, known), () if name is None else (name,)
                label, excused = blind_noise.LABELS[noise], blind_noise.excused(noise)
                yield Case(kind, number, plan, known, (truth,), data, label, d, excused)
                number += 1


def repeated(kind: str, count: int, seed: int) -> Iterator[Case]:
    """3 x 8 and 4 x 12 positions, twice in one run or in two."""
    rng = np.random.default_rng([seed, 9, len(kind)])
    for number in range(count):
        how, known = ("one run", "two runs")[number % 2], number % 3 > 0
        once = blind.random_setup(rng, *((3, 8), (4, 12))[number // 6 % 2])
        setup, size = twice(once, how), len(once.alpha)
        error, sd = np.zeros((size, 3)), np.ones(3)
        if kind == "axis":
            error[:, rng.integers(3)] = rng.normal(size=size)
        elif kind == "two":
            error[rng.choice(size, 2, replace=False)] = rng.normal(size=(2, 3))
        elif kind == "noise":
            sd[rng.integers(3)] = 3.0
        error = np.vstack([error, error])
        visible = np.linalg.norm(blind.unreachable(setup) @ error.ravel())
        clean = blind.readings(setup, setup.nominal, {})
        noise = sd * rng.normal(size=clean.shape) + error * (14.0 / visible if visible else 0.0)
        data = blind_noise.position_set(setup, clean + blind.SIGMA * noise, known)
        data = replace(data, run=tuple("1" * size + "2" * size) if how == "two runs" else None)
        yield Case(kind, number, f"{len(data)} positions", known, (REPEATED[kind],), data, "", 14.0)


def answered(drawn: Iterable[Case]) -> Iterator[tuple[Case, Answer]]:
    """Diagnosed, with whether the noise is named."""
    diagnoser = Diagnoser(nested=False)
    for case in drawn:
        diagnosis = diagnoser(case.data)
        measures = {"noise named": float(case.hidden in diagnosis.labels)} if case.hidden else {}
        yield case, answer_of_diagnosis(diagnosis, measures=measures)

"""Every attitude measured twice, with an error that belongs to the attitude: is it taken for noise? Of `blind_study.py`.

`axis`: an error of one axis, different at each attitude, the same in both readings of it; `two`: two attitudes with an error on
all axes; `noise`: one axis three times as noisy, which is noise; `null`: nothing. 3 x 8 and 4 x 12 positions in one run and in
two, noise stated and unknown. Errors have a norm of `D` noise sd in the part that the nominal model cannot reach.
"""

from collections.abc import Iterable, Iterator

import numpy as np

import blind_conditions
import blind_instrument as blind
import blind_noise
import tumblecal


tumblecal.enable_float64()
from blind_judge import UNEXPLAINED, Answer, Case, answer_of_diagnosis  # noqa: E402
from tumblecal.data import PositionSet  # noqa: E402
from tumblecal.diagnosis import Diagnoser  # noqa: E402


PLANS = ((3, 8), (4, 12))
D = 14.0
# What is to be named of each.
KINDS = {"axis": (UNEXPLAINED,), "two": (UNEXPLAINED,), "noise": ("noise_unequal",), "null": ()}


def case(rng: np.random.Generator, number: int, what: str) -> PositionSet:
    """One data set."""
    how, known = ("one run", "two runs")[number % 2], number % 3 > 0
    once = blind.random_setup(rng, *PLANS[number // 6 % 2])
    setup, count = blind_conditions.twice(once, how), len(once.alpha)
    own, sd = np.zeros((count, 3)), np.ones(3)
    if what == "axis":
        own[:, rng.integers(3)] = rng.normal(size=count)
    elif what == "two":
        own[rng.choice(count, 2, replace=False)] = rng.normal(size=(2, 3))
    elif what == "noise":
        sd[rng.integers(3)] = 3.0
    error = np.vstack([own, own])
    shown = np.linalg.norm(blind.unreachable(setup) @ error.ravel())
    error *= D / shown if shown else 0.0
    clean = blind.readings(setup, setup.nominal, {})
    readings = clean + blind.SIGMA * (sd * rng.normal(size=clean.shape) + error)
    runs = tuple("1" * count + "2" * count) if how == "two runs" else None
    return PositionSet(**vars(blind_noise.position_set(setup, readings, known)) | {"run": runs})


def cases(kind: str, count: int, seed: int) -> Iterator[Case]:
    """So many data sets."""
    rng = np.random.default_rng([seed, 9, len(kind)])
    for number in range(count):
        data = case(rng, number, kind)
        yield Case(kind, number, f"{len(data)} positions", data.sd is not None, (KINDS[kind],), data, d=D)


def answered(drawn: Iterable[Case]) -> Iterator[tuple[Case, Answer]]:
    """Diagnosed."""
    diagnoser = Diagnoser(nested=False)
    return ((case, answer_of_diagnosis(diagnoser(case.data))) for case in drawn)

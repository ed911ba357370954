"""Cases that an earlier version failed, each by its seed: a simulator of `blind_study.py`.

A kind is a fault that was corrected; its cases are those in which it was seen. `--cases` and `--seed` do not matter.
"""

import zlib
from collections.abc import Callable, Iterable, Iterator
from functools import partial

import numpy as np

import blind_catalogue as catalogue
import blind_instrument as blind
import tumblecal


tumblecal.enable_float64()
from blind_conditions import drawn, positions_of  # noqa: E402
from blind_judge import Answer, Case, answer_of_diagnosis  # noqa: E402
from blind_noise import position_set  # noqa: E402
from tumblecal.diagnosis import Diagnoser  # noqa: E402


Draw = Callable[[str, int], Case]


def jump_with(other: str, seed: int, kind: str, number: int) -> Case:
    """A jump at zero input with another large effect on twelve positions: three causes in place of two led."""

    def names(rng):
        return f"bias_asymmetry.{rng.choice(list('xyz'))}", other

    own = catalogue.hidden(np.random.default_rng([20, seed]), "3x4", names, (300, 300), most_cosine=0.5)
    return _of_catalogue(kind, number, "3x4", own)


def kink(axis: str, index: int, kind: str, number: int) -> Case:
    """A kink at zero of a hundred millig on 6 x 6 positions: the linear screen left 60 sigma of it."""
    rng, name = np.random.default_rng([44, 1]), f"scale_asymmetry.{axis}"
    for _ in range(index + 1):
        setup = blind.random_setup(rng, 6, 6)
        size, *_ = blind.sized(setup, blind.unreachable(setup), name, 1000, rng)
        clean = blind.readings(setup, setup.nominal, {name: size})
        measured = clean + blind.SIGMA * rng.normal(size=clean.shape)
    data = position_set(setup, measured, known=bool(index % 2))
    return Case(kind, number, "6x6", data.sd is not None, ((name,),), data)


def gross(plan: str, outliers: int, effects: int, seed: int, kind: str, number: int) -> Case:
    """Positions off by 8 sigma in unknown noise, which they make look larger."""
    rng = np.random.default_rng([8, seed])
    own = catalogue.hidden(rng, plan, catalogue.several(effects), (8,) * effects)
    labels, projector = [], blind.unreachable(own.setup)
    for position in rng.choice(len(own.measured), outliers, replace=False):
        own.measured, label = blind.knocked(own.setup, projector, own.measured, position, rng)
        labels.append(label)
    own.truth = tuple(sorted([*own.truth, *labels]))
    return _of_catalogue(kind, number, plan, own, known=False)


def of_condition(condition: str, seed: tuple[int, ...], index: int, kind: str, number: int) -> Case:
    """The case of an index of a condition of the stress study."""
    rng = np.random.default_rng(seed)
    case = [drawn(condition, rng) for _ in range(index + 1)][-1]
    return Case(kind, number, case.plan, case.known, case.accepted, positions_of(case.data))


def _of_catalogue(kind: str, number: int, plan: str, own: catalogue.Hidden, known: bool = True) -> Case:
    return Case(kind, number, plan, known, (own.truth,), position_set(own.setup, own.measured, known))


_TWO = zlib.crc32(b"two, d = 100")
KINDS: dict[str, list[Draw]] = {
    "jump with another large effect, 3x4": [
        partial(jump_with, other, seed)
        for other, seed in (("third_order.z", 14), ("cross_coupling.y.xy", 1), ("scale_drift.z", 15))
    ],
    "kink at zero, d=1000, 6x6": [partial(kink, axis, index) for axis in "yz" for index in range(4)],
    "positions off in unknown noise, 4x4": [
        partial(gross, "4x4", outliers, effects, seed) for outliers, effects in ((3, 0), (1, 1)) for seed in range(24)
    ],
    "noise that large effects seem to need": [
        partial(of_condition, "two, d = 100", (seed, _TWO), index) for seed, index in ((93, 17), (121, 24), (106, 2))
    ],
    "strong cause without a name": [
        partial(of_condition, f"independent: {words}, d = 100", (851,), index)
        for words in ("slip ring is sooty", "particle in the cavity", "auto zero droops")
        for index in range(5)
    ],
}


def cases(kind: str, count: int, seed: int) -> Iterator[Case]:
    """Those of a kind."""
    del count, seed
    return (draw(kind, number) for number, draw in enumerate(KINDS[kind]))


def answered(drawn: Iterable[Case]) -> Iterator[tuple[Case, Answer]]:
    """Diagnosed."""
    diagnoser = Diagnoser(nested=False)
    return ((case, answer_of_diagnosis(diagnoser(case.data))) for case in drawn)

"""Position files of three simulators, by kind and number: for `golden_answers.py` and `ablation.py`.

- `stress`: instruments of `blind_instrument.py`, with the kinds of `blind_catalogue.py`, conditions of `blind_stress.py`,
  effects in a part of the data (`located.py`) and noise that is not as stated.
- `second`: the mechanisms of `second_instrument.py`, by the rules of `second_study.py`, also of 60 sigma.
- `in use`: single effects of `in_use_instrument.py` of 7 to 300 sigma, pairs, all at once; and the causes without an entry that
  `blind_independent.py` and `blind_independent_more.py` describe.

A file depends on its kind, its number and the seed only. The accepted answers are those of the studies.
"""

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

import blind_catalogue
import blind_conditions
import blind_noise
import in_use
import in_use_instrument
import located
import second_study
from blind_conditions import CONDITIONS
from blind_instrument import SIGMA
from blind_judge import UNEXPLAINED, Case
from tumblecal.data import PositionSet, write_positions


Labels = tuple[str, ...]
# Sizes of the second study, and one at which linearisation matters.
SECOND_SIZES = (7.0, 15.0, 60.0)
_STRESS = (
    "one, d = 30", "one, d = 100", "one, d = 1000", "two, d = 30", "two, d = 100", "three, d = 30", "two, d = 100 and 8",
    "a jump at zero input, d = 30", "a jump at zero input, d = 100", "a jump at zero input, d = 1000",
    "a jump at zero input and another, d = 30 each", "a jump at zero input and another, d = 300 each",
    "outlier beside one, d = 100", "outlier beside a jump at zero input, d = 100", "swap beside a jump at zero input, d = 100",
    "bias and scale factor in a chamber, d = 10 each", "bias and scale factor in a chamber, d = 100 each",
    "10 deg mount, one d = 8", "0.2 g bias, one d = 8", "on three axes, d = 4 each", "drift on three axes, d = 7 each",
    "two families on three axes, d = 10 each", "two families on three axes, d = 30 each", "2 outlier(s)", "3 outlier(s)",
    "2 outlier(s), one d = 8", "remounted, one, d = 8", "remounted, one, d = 100", "plan twice in two runs, u_x u_y^2",
)  # fmt: skip
# Of each kind of conditions one is drawn by the number of the file.
_ANY_OF = {f"unlisted, d = {d}": ("unlisted: ", f", d = {d}") for d in (10, 30, 100)}
_ANY_OF |= {
    f"remounted, mistake {place}": (f"remounted, mistake{words}: ", "")
    for place, words in (("in all", ""), ("in B", " in B"))
}
_ANY_OF |= {"mistake": ("mistake: ", "")}
_INDEPENDENT = {f"independent, d = {d}": ("independent: ", f", d = {d}") for d in (10, 30, 100)}
# Noise of `blind_noise.py` with an effect and without, and a stated sd that is too small by one factor.
_NOISES = {
    f"{kind} noise{words}": (kind, d) for kind in blind_noise.NOISES for words, d in ((", d = 10", 10.0), ("", 0.0))
}
_LEVELS = {
    "stated sd too small": ((), ()),
    "stated sd too small, one d = 8": (blind_catalogue.one_of(blind_conditions.NAMES), (8,)),
}
# Ids of the catalogue by the names of `in_use_instrument.py`: of the head, and of one axis.
_HEAD = {
    "levelling": "base_levelling", "perpendicularity": "axis_perpendicularity", "eccentricity": "index_eccentricity",
    "ellipticity": "index_ellipticity", "index_gain": "index_gain", "backlash": "index_backlash",
    "wobble_1": "spindle_wobble_1", "wobble_2": "spindle_wobble_2", "flexure": "fixture_flexure",
    "mount_drift": "mount_drift", "mount_temperature": "mount_temperature", "warm_up": "warm_up",
}  # fmt: skip
_AXIS = (
    "second_order", "third_order", "scale_asymmetry", "bias_asymmetry", "cross_axis_square", "bias_drift", "scale_drift",
    "bias_temperature", "scale_temperature", "bias_temperature_square", "temperature_rate", "misalignment_drift",
    "misalignment_temperature", "memory", "hysteresis",
)  # fmt: skip
# Of an effect at least this share of the signal is visible.
_LEAST_SHARE = 0.05
_TRIES = 200


@dataclass(frozen=True)
class Simulated:
    """One position file; `accepted`: the sets of labels that are right; `known`: whether its noise is stated in it."""

    simulator: str
    kind: str
    number: int
    accepted: tuple[Labels, ...]
    write: Callable[[Path], object]

    @property
    def name(self) -> str:
        """A name for the file, without its suffix."""
        return name_of(self.simulator, self.kind, self.number)


def name_of(simulator: str, kind: str, number: int) -> str:
    """The name of a file, without its suffix."""
    return "".join(letter if letter.isalnum() else "_" for letter in f"{simulator}, {kind}, {number}")


Kind = Callable[[int, int], Simulated]


def random_of(seed: int, number: int, kind: str) -> np.random.Generator:
    return np.random.default_rng([seed, number, zlib.crc32(kind.encode())])


def of_set(simulator: str, kind: str, number: int, accepted: Sequence[Labels], data: PositionSet) -> Simulated:
    return Simulated(simulator, kind, number, tuple(map(tuple, accepted)), lambda path: write_positions(path, data))


def of_case(simulator: str, kind: str, number: int, case: Case) -> Simulated:
    return Simulated(simulator, kind, number, case.accepted, lambda path: blind_conditions.write(path, case.data))


def _of_group(kind: str, seed: int, number: int) -> Simulated:
    """A case of a group of the blind study, plan and stated noise in turn."""
    names_of, sizes, options = blind_catalogue.KINDS[kind]
    plan, known = list(blind_catalogue.PLANS)[number % 2], bool(number // 2 % 2)
    case = blind_catalogue.hidden(random_of(seed, number, kind), plan, names_of, sizes, **options)
    accepted = (UNEXPLAINED,) if kind.startswith("unknown") else case.truth
    return of_set("stress", kind, number, [accepted], blind_noise.position_set(case.setup, case.measured, known))


def _of_condition(kind: str, seed: int, number: int) -> Simulated:
    return of_case("stress", kind, number, blind_conditions.drawn(kind, random_of(seed, number, kind)))


def _of_any(simulator: str, kind: str, begin: str, end: str, seed: int, number: int) -> Simulated:
    """A case of one condition of those of these names."""
    rng = random_of(seed, number, kind)
    names = [name for name in CONDITIONS if name.startswith(begin) and name.endswith(end)]
    return of_case(simulator, kind, number, blind_conditions.drawn(names[rng.integers(len(names))], rng))


def _in_a_part(kind: str, seed: int, number: int) -> Simulated:
    """An effect that acts at one pitch setting, or in the second half."""
    plan, known = list(blind_catalogue.PLANS)[number % 2], bool(number // 2 % 2)
    setup, readings, name = located.case(random_of(seed, number, kind), plan, kind.partition(" in ")[2], 15.0)
    return of_set("stress", kind, number, [(name,)], blind_noise.position_set(setup, readings, known))


def _in_other_noise(kind: str, seed: int, number: int) -> Simulated:
    """White noise of one size is stated, or none; the noise is of another kind."""
    plan, known, (noise, d) = list(blind_catalogue.PLANS)[number % 2], bool(number // 2 % 2), _NOISES[kind]
    setup, readings, name = blind_noise.case(random_of(seed, number, kind), plan, noise, d)
    accepted = tuple(sorted([blind_noise.LABELS[noise], *([name] if name else [])]))
    return of_set("stress", kind, number, [accepted], blind_noise.position_set(setup, readings, known))


def _of_wrong_level(kind: str, seed: int, number: int) -> Simulated:
    """The stated sd is too small by a factor of 2 to 5; the size of an effect is in true sigma."""
    rng, (names_of, sizes) = random_of(seed, number, kind), _LEVELS[kind]
    case = blind_catalogue.hidden(rng, list(blind_catalogue.PLANS)[number % 2], names_of or (lambda _: ()), sizes)
    data = blind_noise.position_set(case.setup, case.measured, True)
    data = replace(data, sd=np.full(data.readings.shape, SIGMA / rng.uniform(2, 5)))
    return of_set("stress", kind, number, [tuple(sorted(["noise_level", *case.truth]))], data)


def _second(kind: str, seed: int, number: int) -> Simulated:
    # Instruments far too bad for the mechanism are drawn again.
    with np.errstate(all="ignore"):
        case = second_study.drawn(kind, number, seed, SECOND_SIZES)
    return of_set("second", kind, number, [case.accepted[0]], case.data)


def _in_use(kind: str, sizes: Sequence[float], seed: int, number: int) -> Simulated:
    """An instrument with single effects of these sizes (sigma), each of the head or of one axis."""
    rng, plans = random_of(seed, number, kind), in_use.PLANS[1:]
    plan, turns = in_use_instrument.schedule(plans[number % len(plans)], rng)
    plain = in_use_instrument.instrument(plan, turns, rng, [])
    for _ in range(_TRIES):
        drawn = [_single(plain, plan, turns, d, rng) for d in sizes]
        signals = [own[2] / np.linalg.norm(own[2]) for own in drawn if own is not None]
        apart = all(abs(a @ b) < 0.5 for k, a in enumerate(signals) for b in signals[:k])
        if len(signals) == len(sizes) and apart and len({own[0] for own in drawn if own}) == len(sizes):
            break
    else:
        raise RuntimeError(f"{kind} {number}: nothing drawn")
    own = replace(plain, effects={name: values for found in drawn if found for name, values in found[1].items()})
    measured = in_use_instrument.readings(own, plan)
    measured = measured + in_use.SIGMA * rng.normal(size=measured.shape)
    truth = tuple(sorted(found[0] for found in drawn if found))
    return of_set("in use", kind, number, [truth], _measured(plan, measured, known=bool(number // 3 % 2)))


def _single(plain, plan, turns, d: float, rng) -> tuple[str, dict[str, np.ndarray], np.ndarray] | None:
    """Id, coefficients and visible signal of an effect of size d; None where too little of it is visible."""
    name = str(rng.choice([*_HEAD, *_AXIS]))
    effects, id = in_use_instrument.instrument(plan, turns, rng, [name]).effects, _HEAD.get(name, "")
    if not id:
        axis = rng.integers(3)
        mask = np.zeros(np.shape(effects[name]))
        mask[axis] = 1.0
        effects, id = {name: effects[name] * mask}, f"{name}.{'xyz'[axis]}"
    alone = replace(plain, effects=effects)
    shown, signal = in_use_instrument.shown_share(alone, plan, in_use.SIGMA)
    whole = in_use_instrument.readings(alone, plan) - in_use_instrument.readings(plain, plan)
    if not shown > _LEAST_SHARE * np.linalg.norm(whole) / in_use.SIGMA:
        return None
    return id, {name: effects[name] * (d / shown)}, signal


def _whole(kind: str, effects: str, seed: int, number: int) -> Simulated:
    """A whole instrument of `in_use.py`; with several effects no set of names is expected."""
    offset = len(in_use.PLANS) * 1000 * seed
    _, own, plan, rng = in_use.drawn(offset + number + 1 + number // 3, 17, effects)
    clean = in_use_instrument.readings(own, plan)
    data = _measured(plan, clean + in_use.SIGMA * rng.normal(size=clean.shape), known=bool(number // 3 % 2))
    return of_set("in use", kind, number, [()] if effects == "none" else [], data)


def _measured(plan: in_use_instrument.Schedule, readings: np.ndarray, *, known: bool) -> PositionSet:
    return PositionSet(
        tuple(f"p{k + 1}" for k in range(len(readings))),
        np.degrees(plan.alpha).round(9),
        np.degrees(plan.beta).round(9),
        readings,
        sd=np.full(readings.shape, in_use.SIGMA) if known else None,
        time_s=plan.time_s,
        temperature_degc=plan.temperature_degc,
        approach=plan.approach,
        mount=tuple("AB"[own] for own in plan.mounting) if plan.mounting.max() else None,
    )


SIMULATORS: dict[str, dict[str, Kind]] = {
    "stress": {kind: partial(_of_group, kind) for kind in blind_catalogue.KINDS}
    | {kind: partial(_of_condition, kind) for kind in _STRESS}
    | {kind: partial(_of_any, "stress", kind, *ends) for kind, ends in _ANY_OF.items()}
    | {kind: partial(_in_a_part, kind) for kind in ("one in one setting", "one in second half")}
    | {kind: partial(_in_other_noise, kind) for kind in _NOISES}
    | {kind: partial(_of_wrong_level, kind) for kind in _LEVELS},
    "second": {kind: partial(_second, kind) for kind in second_study.KINDS},
    "in use": {f"one, d = {d}": partial(_in_use, f"one, d = {d}", (d,)) for d in (7, 15, 60, 300)}
    | {f"two, d = {d}": partial(_in_use, f"two, d = {d}", (d, d)) for d in (10, 60)}
    | {
        "nothing": partial(_whole, "nothing", "none"),
        "one with small ones": partial(_whole, "one with small ones", "mixed"),
    }
    | {kind: partial(_of_any, "in use", kind, *ends) for kind, ends in _INDEPENDENT.items()},
}

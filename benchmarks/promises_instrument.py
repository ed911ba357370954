"""Instruments with a hidden cause for `promises_next.py`, whose measurement can be continued: plain numpy, two simulators.

The triad and its head are those of `in_use_instrument.py` or of `second_head.py`. The hidden cause is an effect of that
simulator, or one of the causes below, which both share: functions of order, time, temperature, pitch setting and readings. A
schedule may be continued by any positions: every angle, mounting and pitch setting that may be proposed has its errors from
the beginning. Nothing of the program is imported.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

import in_use_instrument as first
import second_head as second
from in_use_instrument import Schedule
from second_instrument import KINDS


AXES = "xyz"
SIGMA = 1e-4  # g
PLANS = {first: ("3x8", "4x12", "two mountings"), second: tuple(second.PLANS)}
# Mountings of the base plan, then the two turns that may be proposed, about y and z; each once more with a moved fixture.
TURNED_Y, TURNED_Z, MOVED = 2, 3, 4
_SETTINGS = 120
# Effects of the first simulator, by their ids in the catalogue; {a}: an axis.
FIRST_EFFECTS = {
    "levelling": "base_levelling",
    "perpendicularity": "axis_perpendicularity",
    "eccentricity": "index_eccentricity",
    "ellipticity": "index_ellipticity",
    "index_gain": "index_gain",
    "backlash": "index_backlash",
    "wobble_1": "spindle_wobble_1",
    "wobble_2": "spindle_wobble_2",
    "flexure": "fixture_flexure",
    "mount_drift": "mount_drift",
    "mount_temperature": "mount_temperature",
    "second_order": "second_order.{a}",
    "third_order": "third_order.{a}",
    "scale_asymmetry": "scale_asymmetry.{a}",
    "bias_asymmetry": "bias_asymmetry.{a}",
    "cross_coupling": "cross_coupling.{a}.{pair}",
    "scale_drift": "scale_drift.{a}",
    "misalignment_drift": "misalignment_drift.{a}",
    "misalignment_temperature": "misalignment_temperature.{a}",
    "settling": "settling",
    "memory": "memory.{a}",
}
SECOND_EFFECTS = tuple(name for name in KINDS if name not in ("nothing", "flicker and random walk"))
# What is added to the readings (positions, 3), g, by a schedule and the readings without it.
Added = Callable[[Schedule, np.ndarray], np.ndarray]


class Cause(NamedTuple):
    """A hidden cause: accepted sets of ids, and how it acts on an instrument of a size.

    - `added`: to the readings; `mechanism`: on an instrument of the second simulator, for a schedule; `effects`: of the
      first one. `moved`: positions at which the triad is turned in its fixture; `noisier`: factors of their noise.
    """

    names: tuple[frozenset[str], ...]
    added: Added | None = None
    mechanism: Callable[[Schedule], second.Mechanism] | None = None
    effects: Mapping[str, np.ndarray] = MappingProxyType({})
    moved: Callable[[Schedule], np.ndarray] | None = None
    noisier: Callable[[Schedule], np.ndarray] | None = None


@dataclass
class Bench:
    """An instrument on its head, with what is hidden in it.

    `simulator`: module `in_use_instrument` or `second_head`. `settings`: angle of each pitch setting that was set so far.
    """

    simulator: object
    kind: str
    plan_name: str
    plan: Schedule
    own: object
    causes: list[tuple[Cause, float]] = field(default_factory=list)
    settings: list[float] = field(default_factory=list)

    def readings(self, plan: Schedule, causes: list[tuple[Cause, float]] | None = None) -> np.ndarray:
        """Readings without noise, g (positions, 3)."""
        own, mounting = self.own, plan.mounting.copy()
        causes = self.causes if causes is None else causes
        for cause, size in causes:
            if cause.moved is not None:
                turned = cause.moved(plan)
                mounts = own.mounts.copy()
                mounts[MOVED:] = mounts[:MOVED] + size * cause.effects["angles"]
                own, mounting = replace(own, mounts=mounts), np.where(turned, mounting + MOVED, mounting)
            elif cause.mechanism is not None:
                own = cause.mechanism(plan)(own, size)
            elif cause.added is None and cause.effects:
                own = replace(own, effects={**own.effects, **{k: size * v for k, v in cause.effects.items()}})
        clean = self.simulator.readings(own, replace(plan, mounting=mounting))
        return clean + sum(size * cause.added(plan, clean) for cause, size in causes if cause.added is not None)

    def measured(self, plan: Schedule, rng: np.random.Generator) -> np.ndarray:
        """Readings with noise."""
        sd = np.full((len(plan.alpha), 1), SIGMA)
        for cause, size in self.causes:
            if cause.noisier is not None:
                sd = sd * np.where(cause.noisier(plan), size, 1.0)[:, None]
        return self.readings(plan) + sd * rng.normal(size=(len(plan.alpha), 3))

    def continued(
        self,
        cells: list[tuple[float, float, int]],
        time_s: np.ndarray,
        temperature_degc: np.ndarray,
    ) -> Schedule:
        """The schedule with further positions: alpha and beta in deg, and the mounting."""
        plan, numbers = self.plan, []
        for _, beta, _ in cells:
            near = np.flatnonzero(np.abs(np.array(self.settings) - beta) < 1e-6)
            if not len(near):
                self.settings.append(beta)
            numbers.append(int(near[0]) if len(near) else len(self.settings) - 1)
        alpha, beta, mounting = np.array(cells).T
        return Schedule(
            np.append(plan.alpha, np.radians(alpha)),
            np.append(plan.beta, np.radians(beta)),
            np.append(plan.pitch, numbers),
            np.append(plan.mounting, mounting.astype(int)),
            np.append(plan.time_s, time_s),
            np.append(plan.temperature_degc, temperature_degc),
            np.append(plan.approach, np.ones(len(cells))),
        )


def drawn(kind: str, simulator, rng: np.random.Generator) -> Bench:
    """An instrument with a cause of this kind, of 5 to 15 sigma; drawn again until the plan shows it."""
    while True:
        name = str(rng.choice(PLANS[simulator]))
        made = simulator.schedule(name, rng)
        plan = made[0] if simulator is first else made
        plan = replace(plan, temperature_degc=_temperature(plan, rng))
        turns = np.stack([np.eye(3), first._passive("y", np.array([np.pi / 2]))[0]] * 2)
        turns[3] = first._passive("z", np.array([np.pi / 2]))[0]
        turns[2] = turns[1]
        own = first.instrument(plan, turns, rng, []) if simulator is first else second.instrument(plan, rng)
        own = replace(
            own,
            turns=np.concatenate([turns, turns]),
            mounts=np.tile(rng.normal(0, 3e-3, (MOVED, 3)), (2, 1)),
            pitch_errors=np.tile(rng.normal(0, 1.5e-3, (MOVED, _SETTINGS)), (2, 1)),
        )
        settings = [float(np.degrees(plan.beta[plan.pitch == k][0])) for k in range(plan.pitch.max() + 1)]
        bench = Bench(simulator, kind, name, plan, own, settings=settings)
        kinds = rng.choice(MIXED, 2, replace=False).tolist() if kind == "mixed" else [kind]
        causes = [SHARED[one](bench, rng) if one in SHARED else _effect(bench, rng) for one in kinds]
        if sum(cause.moved is not None for cause in causes) > 1:
            continue
        sized = [_size(bench, cause, rng) for cause in causes]
        if all(size is not None for size in sized):
            bench.causes = list(zip(causes, sized, strict=True))
            if len(causes) == 1 or _both_needed(bench):
                return bench


def _temperature(plan: Schedule, rng: np.random.Generator) -> np.ndarray:
    """The room: warms with the time, towards an end, or hardly."""
    since = (plan.time_s - plan.time_s[0]) / np.ptp(plan.time_s)
    share = {0: since, 1: 1 - np.exp(-since / rng.uniform(0.1, 0.5)), 2: 0 * since}[int(rng.integers(3))]
    wander = np.cumsum(rng.normal(0, 0.03, len(since)))
    return 24.0 + rng.normal(0, 1.0) + rng.uniform(1, 5) * share + wander


def _unreachable(bench: Bench) -> np.ndarray:
    """Projector on readings that the nominal parameters cannot make."""
    columns, step, plan = [], 1e-6, bench.plan
    used = {"mounts": plan.mounting, "pitch_errors": (plan.mounting, plan.pitch)}
    for name in ("scale", "bias", "gamma", "mounts", "pitch_errors"):
        values = getattr(bench.own, name)
        there = np.zeros(values.shape, bool)
        there[used.get(name, slice(None))] = True
        for place in zip(*np.nonzero(there), strict=True):
            both = []
            for sign in (1, -1):
                moved = values.copy()
                moved[place] += sign * step
                both.append(bench.simulator.readings(replace(bench.own, **{name: moved}), plan).ravel())
            columns.append((both[0] - both[1]) / (2 * step))
    basis, size, _ = np.linalg.svd(np.stack(columns, axis=1), full_matrices=False)
    basis = basis[:, size > 1e-9 * size[0]]
    return np.eye(len(basis)) - basis @ basis.T


def _size(bench: Bench, cause: Cause, rng: np.random.Generator) -> float | None:
    """The size at which a cause shows by 5 to 15 sigma; None where this is no fair case. Of noise: its factor."""
    if cause.noisier is not None and cause.added is None:
        return float(rng.uniform(3, 8))
    projector, wanted, size = _unreachable(bench), rng.uniform(5, 15), 1e-5
    plain = bench.readings(bench.plan, [])
    for _ in range(6):
        full = (bench.readings(bench.plan, [(cause, size)]) - plain).ravel() / SIGMA
        shown = float(np.linalg.norm(projector @ full))
        if not shown > 0.05 * np.linalg.norm(full) or size > 0.05:
            return None
        size *= wanted / shown
    return size


def _both_needed(bench: Bench) -> bool:
    """Whether each of two causes shows by 5 sigma given the other, whatever the size of that on each axis."""
    projector, plain = _unreachable(bench), bench.readings(bench.plan, [])

    def parts(cause: Cause, size: float) -> list[np.ndarray]:
        if cause.moved is not None:
            turns = (cause._replace(effects={"angles": unit}) for unit in np.eye(3))
            return [bench.readings(bench.plan, [(turn, 1e-4)]) - plain for turn in turns]
        signal = bench.readings(bench.plan, [(cause, size)]) - plain
        return [signal * unit for unit in np.eye(3) if np.any(signal * unit)]

    shown = [own for own in bench.causes if own[0].added is not None or own[0].moved is not None]
    for cause, other in (shown, shown[::-1]) if len(shown) > 1 else ():
        signal = projector @ (bench.readings(bench.plan, [cause]) - plain).ravel() / SIGMA
        span = np.stack([projector @ part.ravel() / SIGMA for part in parts(*other)], axis=1)
        if np.linalg.norm(signal - span @ np.linalg.lstsq(span, signal, rcond=None)[0]) < 5.0:
            return False
    return True


def _effect(bench: Bench, rng: np.random.Generator) -> Cause:
    """An effect of the simulator itself."""
    if bench.simulator is second:
        kind, seed = str(rng.choice(SECOND_EFFECTS)), int(rng.integers(2**31))
        truth = KINDS[kind](bench.plan, np.random.default_rng(seed))[0]
        return Cause((frozenset(truth),), mechanism=lambda plan: KINDS[kind](plan, np.random.default_rng(seed))[1])
    name = str(rng.choice(list(FIRST_EFFECTS)))
    shape, axis = first._shape(name, bench.plan), int(rng.integers(3))
    sizes, pair = rng.normal(size=shape), int(rng.integers(3))
    if "{a}" in FIRST_EFFECTS[name]:
        chosen = np.zeros(shape, bool)
        chosen[(axis, pair) if "{pair}" in FIRST_EFFECTS[name] else axis] = True
        sizes = np.where(chosen, sizes, 0.0)
    id = FIRST_EFFECTS[name].format(a=AXES[axis], pair=("xy", "xz", "yz")[pair])
    return Cause((frozenset([id]),), effects={name: sizes})


def _on(axis: int, values: np.ndarray) -> np.ndarray:
    out = np.zeros((len(values), 3))
    out[:, axis] = values
    return out


def _warm_up(bench: Bench, rng: np.random.Generator) -> Cause:
    amplitudes = rng.normal(size=3) * (rng.uniform(size=3) < 0.6)
    amplitudes[rng.integers(3)] = rng.choice([-1.0, 1.0])
    tau = np.ptp(bench.plan.time_s) * np.exp(rng.uniform(np.log(0.1), np.log(0.6)))
    return Cause(
        (frozenset(["warm_up"]),),
        lambda plan, clean: np.exp(-(plan.time_s - plan.time_s[0]) / tau)[:, None] * amplitudes,
    )


def _drift(bench: Bench, rng: np.random.Generator) -> Cause:
    axis = int(rng.integers(3))
    return Cause(
        (frozenset([f"bias_drift.{AXES[axis]}"]),),
        lambda plan, clean: _on(axis, (plan.time_s - plan.time_s[0]) / 3600.0),
    )


def _temperature_effect(bench: Bench, rng: np.random.Generator) -> Cause:
    axes = rng.choice(3, int(rng.integers(1, 3)), replace=False)
    of_scale, slopes = bool(rng.integers(2)), np.zeros(3)
    slopes[axes] = rng.choice([-1.0, 1.0], len(axes)) * rng.uniform(0.6, 1.0, len(axes))
    word = "scale" if of_scale else "bias"
    return Cause(
        (frozenset(f"{word}_temperature.{AXES[axis]}" for axis in axes),),
        lambda plan, clean: (plan.temperature_degc[:, None] - 25.0) * slopes * (clean if of_scale else 1.0),
    )


def _jump(bench: Bench, rng: np.random.Generator) -> Cause:
    """A bias, or the triad in its fixture, from some position on."""
    at, axis = int(rng.integers(3, len(bench.plan.alpha) - 3)), int(rng.integers(3))
    after = lambda plan: np.arange(len(plan.alpha)) >= at  # noqa: E731
    if rng.uniform() < 0.5:
        return Cause((frozenset([f"bias_jump:p{at + 1}"]),), lambda plan, clean: _on(axis, after(plan).astype(float)))
    # Until the triad is clamped again.
    here = bench.plan.mounting[at]
    return Cause(
        (frozenset([f"mount_slip:p{at + 1}"]),),
        effects={"angles": rng.normal(size=3)},
        moved=lambda plan: after(plan) & (plan.mounting == here),
    )


def _hysteresis(bench: Bench, rng: np.random.Generator) -> Cause:
    axis = int(rng.integers(3))

    def added(plan: Schedule, clean: np.ndarray) -> np.ndarray:
        before = np.maximum(np.arange(len(clean)) - 1, 0)
        before = np.where(plan.mounting[before] == plan.mounting, before, np.arange(len(clean)))
        return _on(axis, np.clip((clean - clean[before])[:, axis] / 0.1, -1, 1))

    return Cause((frozenset([f"hysteresis.{AXES[axis]}"]),), added)


def _at_setting(bench: Bench, rng: np.random.Generator) -> Callable[[Schedule], np.ndarray]:
    number = int(rng.integers(bench.plan.pitch.max() + 1))
    return lambda plan: plan.pitch == number


def _vibration(bench: Bench, rng: np.random.Generator) -> Cause:
    """The table resonates at one pitch setting: more noise there."""
    return Cause((frozenset(["noise_unequal"]),), noisier=_at_setting(bench, rng))


def _rectified(bench: Bench, rng: np.random.Generator) -> Cause:
    """Vibration at one pitch setting, rectified to an offset of an axis."""
    there, axis = _at_setting(bench, rng), int(rng.integers(3))
    return Cause(
        (frozenset([f"bias_by_pitch.{AXES[axis]}"]),), lambda plan, clean: _on(axis, there(plan).astype(float))
    )


def _fixture(bench: Bench, rng: np.random.Generator) -> Cause:
    """The fixture gives way at one pitch setting, whenever that is set."""
    return Cause(
        (frozenset(["mount_by_pitch"]),), effects={"angles": rng.normal(size=3)}, moved=_at_setting(bench, rng)
    )


SHARED = {
    "warm-up": _warm_up,
    "drift": _drift,
    "temperature": _temperature_effect,
    "jump": _jump,
    "hysteresis": _hysteresis,
    "vibration": _vibration,
    "rectified vibration": _rectified,
    "fixture moved": _fixture,
}
MIXED = tuple(SHARED)
# How often each kind is drawn.
SHARES = dict.fromkeys(SHARED, 1.0) | {"an effect": 2.0, "mixed": 2.0}

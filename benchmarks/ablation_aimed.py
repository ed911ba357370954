"""Files of the kinds for which single rules of the diagnosis were made, for `ablation.py --kind aimed`.

- `setting`: one bias that jumps at a change of pitch setting or within one, or that has a value for each pitch setting (two
  different ones for `of two values`). Nothing but the prior separates a jump at a change from two values.
- `local`: the causes without an entry that jumps and outlier positions may imitate, each in turn: of the stress study and the
  independent ones. `cable`: a mount that turns steadily and slips back.
- `level`: the stated sd is in error by a factor of 1.3 to 5, too small in three of four files, with nothing, an effect or an
  outlier position of a size in true sigma.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

import blind_catalogue
import blind_conditions
import blind_instrument as blind
import blind_noise
from simulated_files import Kind, Simulated, of_case, of_set, random_of


_PLANS = tuple(blind_catalogue.PLANS)
_FACTORS = (1.3, 5.0)
_LOCAL = (
    "unlisted: stick at one pitch", "unlisted: clamp gives way", "unlisted: gust", "unlisted: supply falls",
    "unlisted: heater cycles", "unlisted: clamped anew at each pitch", "unlisted: loose screw", "unlisted: door opened",
    "unlisted: somebody leans on the table", "unlisted: neighbour switched on", "unlisted: coupling wears",
    "unlisted: two levels", "unlisted: clamp settles", "independent: chip in the face gear",
    "independent: nearest hole of the plate", "independent: particle in the cavity", "independent: auto zero droops",
    "independent: plate turns on its dowel", "independent: mass clings to its stop", "independent: slip ring is sooty",
    "independent: stale compensation", "independent: two operators take turns",
)  # fmt: skip


def _by_setting(kind: str, place: str, d: float, seed: int, number: int) -> Simulated:
    rng, known = random_of(seed, number, kind), bool(number // 2 % 2)
    setup = blind.random_setup(rng, *blind_catalogue.PLANS[_PLANS[number % 2]])
    axis, settings = int(rng.integers(3)), int(setup.pitch.max()) + 1
    first = int(rng.choice(np.flatnonzero(np.diff(setup.pitch)) + 1))
    begins = first if place != "jump within" else first + int(rng.integers(2, len(setup.pitch) // settings - 2))
    values = {"of two values": np.arange(settings) >= setup.pitch[first]}.get(place, rng.normal(size=settings))
    added = np.zeros((len(setup.pitch), 3))
    added[:, axis] = values[setup.pitch] if place.startswith("of ") else np.arange(len(setup.pitch)) >= begins
    if place == "of a scale factor":
        added[:, axis] *= blind.readings(setup, setup.nominal, {})[:, axis]
    seen = float(np.linalg.norm(blind.unreachable(setup) @ added.ravel()))
    readings = blind.readings(setup, setup.nominal, {}) + added * d * blind.SIGMA / seen
    readings = readings + blind.SIGMA * rng.normal(size=readings.shape)
    by_setting = "scale_by_pitch" if place == "of a scale factor" else "bias_by_pitch"
    accepted = (f"{by_setting}.{'xyz'[axis]}" if place.startswith("of ") else f"bias_jump:{setup.names[begins]}",)
    return of_set("aimed", kind, number, [accepted], blind_noise.position_set(setup, readings, known))


def _imitated(kind: str, names: Sequence[str], d: int, seed: int, number: int) -> Simulated:
    condition = f"{names[number % len(names)]}, d = {d}"
    return of_case("aimed", kind, number, blind_conditions.drawn(condition, random_of(seed, number, kind)))


def _of_level(kind: str, d: float, outlier: float, seed: int, number: int) -> Simulated:
    rng, plan = random_of(seed, number, kind), _PLANS[number % 2]
    names_of: Callable = blind_catalogue.one_of(blind_conditions.NAMES) if d else lambda _: ()
    case = blind_catalogue.hidden(rng, plan, names_of, (d,) if d else ())
    factor = float(np.exp(rng.uniform(*np.log(_FACTORS))))
    stated = blind.SIGMA * (factor if number % 4 == 3 else 1 / factor)
    readings, truth = case.measured, ["noise_level", *case.truth]
    if outlier:
        unit, position = np.zeros_like(readings), int(rng.integers(len(readings)))
        unit[position] = rng.normal(size=3)
        seen = float(np.linalg.norm(blind.unreachable(case.setup) @ unit.ravel()))
        readings = readings + unit * outlier * blind.SIGMA / seen
        truth.append(f"outlier_position:{case.setup.names[position]}")
    data = blind_noise.position_set(case.setup, readings, True)
    data = replace(data, sd=np.full(readings.shape, stated))
    return of_set("aimed", kind, number, [tuple(sorted(truth))], data)


_PLACES = ("jump at", "jump within", "of each value", "of two values", "of a scale factor")
AIMED: dict[str, Kind] = {
    (kind := f"aimed, {words}, d = {d}"): partial(_imitated, kind, names, d)
    for words, names in (("local", _LOCAL), ("cable", ("unlisted: cable winds up",)))
    for d in (10, 30, 100)
} | {
    (kind := f"aimed, setting, {place}, d = {d}"): partial(_by_setting, kind, place, d)
    for place in _PLACES
    for d in (10.0, 30.0, 100.0)
} | {
    (kind := f"aimed, level, {words}"): partial(_of_level, kind, d, outlier)
    for words, d, outlier in (
        ("nothing", 0.0, 0.0), ("one, d = 8", 8.0, 0.0), ("one, d = 30", 30.0, 0.0), ("one, d = 300", 300.0, 0.0),
        ("outlier of 10", 0.0, 10.0), ("outlier of 100", 0.0, 100.0), ("one, d = 10, outlier of 10", 10.0, 10.0),
    )
}  # fmt: skip

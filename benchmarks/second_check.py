"""The statements of `second_instrument.py` in numbers: what each id of the catalogue could make of a mechanism's signal.

The columns of the ids are those of `in_use_instrument.py` (plain numpy), not the program's.
"""

from collections.abc import Collection, Iterator
from dataclasses import replace

import numpy as np

import in_use_instrument as listed
from second_head import Instrument, Schedule


# Least visible part of a signal of norm 1.
_VISIBLE = 0.03
_WHOLE = {*listed.HEAD, "warm_up", "settling"}


def columns(
    own: Instrument, plan: Schedule, projector: np.ndarray, only: Collection[str] = ()
) -> dict[str, np.ndarray]:
    """Of each id (or only of some), an orthonormal basis of what it can add to the readings that the nominal parameters
    cannot make."""
    plain = listed.Instrument(own.scale, own.bias, own.gamma, own.mounts, own.turns, own.pitch_errors, {})
    at_zero = listed.readings(plain, plan)
    found: dict[str, list[np.ndarray]] = {}
    for name, size in listed.SIZES.items():
        whole = listed.instrument(plan, own.turns, np.random.default_rng(0), [name]).effects[name]
        for place in np.ndindex(whole.shape):
            if only and _id(name, place) not in only:
                continue
            unit = np.zeros_like(whole)
            unit[place] = 1e-3 * size
            signal = listed.readings(replace(plain, effects={name: unit}), plan) - at_zero
            found.setdefault(_id(name, place), []).append(signal.ravel() / np.linalg.norm(signal))
    bases = {id: _basis(projector @ np.stack(signals, axis=1)) for id, signals in found.items()}
    return {id: basis for id, basis in bases.items() if basis.shape[1]}


def _id(name: str, place: tuple[int, ...]) -> str:
    if name in _WHOLE:
        return listed.IDS.get(name, name)
    axis = "xyz"[place[-1] if name.endswith("by_pitch") else place[0]]
    return f"{name}.{axis}" + (f".{('xy', 'xz', 'yz')[place[1]]}" if name == "cross_coupling" else "")


def _basis(signals: np.ndarray) -> np.ndarray:
    """Directions of which enough is visible."""
    directions, size, _ = np.linalg.svd(signals, full_matrices=False)
    return directions[:, size > _VISIBLE]


def jumps(own: Instrument, plan: Schedule, projector: np.ndarray) -> Iterator[np.ndarray]:
    """The same of a bias that jumps, and of a mount that slips, at each position."""
    plain = listed.Instrument(own.scale, own.bias, own.gamma, own.mounts, own.turns, own.pitch_errors, {})
    at_zero, step = listed.readings(plain, plan), 1e-5
    slips = [listed.readings(replace(plain, mounts=plain.mounts + step * unit), plan) - at_zero for unit in np.eye(3)]
    for first in range(1, len(at_zero)):
        late = np.arange(len(at_zero)) >= first
        changed = [(slip * late[:, None]).ravel() / step for slip in slips]
        yield _basis(projector @ np.stack(changed, axis=1))
        yield from (_basis(projector @ np.outer(late, unit).ravel()[:, None]) for unit in np.eye(3))


def left(signal: np.ndarray, *bases: np.ndarray) -> float:
    """Norm of what some columns leave of a signal."""
    span = np.linalg.qr(np.concatenate(bases, axis=1))[0] if bases else np.zeros((len(signal), 0))
    return float(np.linalg.norm(signal - span @ (span.T @ signal)))

"""The positions of a plan with an angle in error by one step."""

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.chain import Where
from tumblecal.ground.angle_settings import setting_angle, setting_index


class Step(NamedTuple):
    """The plan with every position moved by one step.

    `source`: the position whose pitch setting each has then; `valid`: for which positions that step exists. `twins`: the
    positions at the angles to which each is moved; None if some angles have no position.
    """

    words: str
    alpha: Float[np.ndarray, " positions"]
    source: Int[np.ndarray, " positions"]
    valid: Bool[np.ndarray, " positions"]
    twins: Int[np.ndarray, " positions"] | None

    def of(self, where: Where) -> Where:
        """The settings, moved."""
        groups = {
            name: np.asarray(index)[self.source] if "pitch" in name else np.asarray(index)
            for name, index in where.groups.items()
        }
        return replace(where, alpha=self.alpha, beta=np.asarray(where.beta)[self.source], groups=groups)


def plan_steps(where: Where) -> tuple[Step, ...]:
    """The steps of a plan: to the next and the previous spindle angle and pitch setting, where there are several."""
    alpha = tuple(np.asarray(where.alpha).tolist())
    pitch, run, mount = (tuple(np.asarray(where.index(name)).tolist()) for name in ("pitch", "run", "mount"))
    return _steps(alpha, pitch, run, mount)


@lru_cache(maxsize=64)
def _steps(
    alphas: tuple[float, ...], pitches: tuple[int, ...], runs: tuple[int, ...], mounts: tuple[int, ...]
) -> tuple[Step, ...]:
    alpha, level, run, mount = (np.array(own) for own in (alphas, pitches, runs, mounts))
    turn = setting_index(alpha, held=False)
    same, options = np.arange(len(alpha)), []
    numbers = {setting: number for number, setting in enumerate(_settings(turn, level, run, mount))}

    def moved(words: str, to: np.ndarray, source: np.ndarray, valid: np.ndarray, reached: np.ndarray) -> Step:
        twins = [numbers.get(setting, -1) for setting in _settings(reached, level[source], run, mount)]
        return Step(words, to, source, valid, np.array(twins) if min(twins) >= 0 else None)

    turns = np.round(setting_angle(alpha, turn)[np.unique(turn, return_index=True)[1]], 9)
    if len(turns) > 1:
        for sign, words in ((1, "next"), (-1, "previous")):
            reached = (turn + sign) % len(turns)
            options.append(moved(f"{words} spindle angle", turns[reached], same, np.ones(len(alpha), bool), reached))
    together = (run[:, None] == run) & (mount[:, None] == mount)
    for sign, words in ((1, "next"), (-1, "previous")):
        # The first position of the same run and mounting at the next level.
        twins = together & (level[None, :] == level[:, None] + sign)
        valid = np.any(twins, axis=1)
        if np.any(valid):
            options.append(
                moved(f"{words} pitch setting", alpha, np.where(valid, np.argmax(twins, axis=1), same), valid, turn)
            )
    return tuple(options)


def _settings(turn: np.ndarray, level: np.ndarray, run: np.ndarray, mount: np.ndarray) -> list[tuple[int, ...]]:
    """Numbers of the spindle angle, the pitch setting, the run and the mounting of every position."""
    return list(zip(turn.tolist(), level.tolist(), run.tolist(), mount.tolist(), strict=True))

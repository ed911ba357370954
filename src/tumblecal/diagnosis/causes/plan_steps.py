"""Where the positions of a plan would have stood with an angle off by one step."""

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.chain import Where


class Step(NamedTuple):
    """The plan with every position moved by one step.

    `source`: the position whose pitch setting each has then; `valid`: for which positions that step exists. `twins`: the
    positions that stand where each is moved to; None where not all do.
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
    alpha, beta = (tuple(np.asarray(own).tolist()) for own in (where.alpha, where.beta))
    run, mount = (tuple(np.asarray(where.index(name)).tolist()) for name in ("run", "mount"))
    return _steps(alpha, beta, run, mount)


@lru_cache(maxsize=64)
def _steps(
    alphas: tuple[float, ...], betas: tuple[float, ...], runs: tuple[int, ...], mounts: tuple[int, ...]
) -> tuple[Step, ...]:
    alpha, beta, run, mount = (np.array(own) for own in (alphas, betas, runs, mounts))
    same, options = np.arange(len(alpha)), []
    numbers = {setting: number for number, setting in enumerate(_settings(alpha, beta, run, mount))}

    def moved(words: str, to: np.ndarray, source: np.ndarray, valid: np.ndarray) -> Step:
        twins = [numbers.get(setting, -1) for setting in _settings(to, beta[source], run, mount)]
        return Step(words, to, source, valid, np.array(twins) if min(twins) >= 0 else None)

    turns = np.unique(np.round(alpha, 9))
    turn = np.searchsorted(turns, np.round(alpha, 9))
    if len(turns) > 1:
        for sign, words in ((1, "next"), (-1, "previous")):
            to = turns[(turn + sign) % len(turns)]
            options.append(moved(f"{words} spindle angle", to, same, np.ones(len(alpha), bool)))
    levels = np.unique(np.round(beta, 9))
    level = np.searchsorted(levels, np.round(beta, 9))
    together = (run[:, None] == run) & (mount[:, None] == mount)
    for sign, words in ((1, "next"), (-1, "previous")):
        # The first position of the same run and mounting at the next level.
        twins = together & (level[None, :] == level[:, None] + sign)
        valid = np.any(twins, axis=1)
        if np.any(valid):
            options.append(
                moved(f"{words} pitch setting", alpha, np.where(valid, np.argmax(twins, axis=1), same), valid)
            )
    return tuple(options)


def _settings(alpha: np.ndarray, beta: np.ndarray, run: np.ndarray, mount: np.ndarray) -> list[tuple]:
    """Angles and groups of every position."""
    return list(zip(np.round(alpha, 9).tolist(), np.round(beta, 9).tolist(), run.tolist(), mount.tolist(), strict=True))

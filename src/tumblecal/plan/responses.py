"""Linear responses of all cells: derivatives of the readings by the parameters of the rig, and by its settings."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from tumblecal.chain.nominal import Leaf
from tumblecal.chain.rig import Rig
from tumblecal.estimation.linearised import linearised
from tumblecal.estimation.priors import prior_of
from tumblecal.estimation.problem import Problem
from tumblecal.ground.errors import InputError
from tumblecal.plan.cells import Cells


# Leaves of a setting: one value for each visit of a pitch setting, and for each mounting.
PITCH, MOUNT = "dbeta", "dtheta"


@dataclass(frozen=True)
class Setting:
    """The errors of a kind of setting, which every visit has again.

    - `columns` (cells, 3, components): readings, g, by a unit of scale.
    - `common`: prior sd of what all visits of one setting share, in scales; None: unknown without bound; 0: exact.
    - `again`: sd of what each visit adds, in scales.
    - `scale`: rad.
    """

    columns: Float[np.ndarray, "cells 3 components"]
    common: float | None
    again: float
    scale: float = 1e-3

    @property
    def exact(self) -> bool:
        """Whether there are no such errors."""
        return self.common == 0.0 and not self.again


@dataclass(frozen=True)
class Responses:
    """Linear responses of cells, at the start of the chain.

    - `names`, `scales`: of the parameters that all positions share. `columns` (cells, 3, shared): readings, g, by these, each
      in its scale. `information` (shared, shared): of their priors.
    - `pitch`, `mount`: the errors of the settings.
    - `sd`: white noise of a dwell, g.
    """

    cells: Cells
    names: tuple[str, ...]
    scales: Float[np.ndarray, " shared"]
    columns: Float[np.ndarray, "cells 3 shared"]
    information: Float[np.ndarray, "shared shared"]
    pitch: Setting
    mount: Setting
    sd: float

    def chosen(self, numbers: Int[np.ndarray, " chosen"]) -> "Responses":
        """The responses of some of the cells, in this order."""
        pitch, mount = (replace(each, columns=each.columns[numbers]) for each in (self.pitch, self.mount))
        columns = self.columns[numbers]
        return replace(self, cells=self.cells.chosen(numbers), columns=columns, pitch=pitch, mount=mount)


def responses_of(rig: Rig, cells: Cells) -> Responses:
    """The responses of a rig.

    **Raises:** `InputError` for a rig whose noise is not stated, or whose settings are indexed by something else.
    """
    if not rig.noise_sd_g:
        raise InputError(f'{rig.source}: noise.sd: the noise of a dwell is needed; write [noise] sd = "0.1 mg"')
    leaves = dict(rig.leaves)
    free = {name: leaves.get(name, Leaf()).free for name in (PITCH, MOUNT)}
    leaves |= {PITCH: Leaf("pitch", free=True), MOUNT: Leaf("mount", free=True)}
    chain = replace(rig, leaves=leaves).chain(cells.where)
    problem = Problem.from_arrays(chain, cells.where, np.zeros((len(cells), 3)), noise_sd=1.0)
    jacobian = np.asarray(linearised(problem, chain.vector)[1]).reshape(len(cells), 3, -1)
    settings, shared, offset = dict[str, tuple[np.ndarray, float]](), list[int](), 0
    for leaf in chain.free:
        here = jacobian[:, :, offset : offset + leaf.value.size]
        if leaf.name in (PITCH, MOUNT):
            settings[leaf.name] = here.reshape(len(cells), 3, *leaf.value.shape).sum(axis=2), leaf.scale
        else:
            shared += range(offset, offset + leaf.value.size)
        offset += leaf.value.size
    names = tuple(chain.names[k] for k in shared)
    again = (None, None) if rig.ability is None else (rig.ability.repeatability.pitch, rig.ability.repeatability.mount)
    of_settings = {
        name: _setting(*settings[name], rig.priors.get(name), sd, free[name])
        for name, sd in zip((PITCH, MOUNT), again, strict=True)
    }
    weights = prior_of(chain, {name: prior for name, prior in rig.priors.items() if name not in (PITCH, MOUNT)})[1]
    return Responses(
        cells,
        names,
        chain.scales[shared],
        jacobian[:, :, shared],
        np.diag((weights * chain.scales)[shared] ** 2),
        of_settings[PITCH],
        of_settings[MOUNT],
        rig.noise_sd_g,
    )


def _setting(
    columns: np.ndarray, scale: float, prior: tuple[float, float] | None, again: float | None, free: bool
) -> Setting:
    """The errors of a kind of setting; fixed ones have none in common, and unstated repeatability adds none if the common part
    has no bound or a prior (that is then the prior of each visit)."""
    common = 0.0 if not free else None if prior is None else prior[1] / scale
    if again is None and common:
        # Without a repeatability visits of one setting may differ as much as two settings.
        common, again = 0.0, prior[1] if prior is not None else None
    return Setting(columns, common, (again or 0.0) / scale, scale)

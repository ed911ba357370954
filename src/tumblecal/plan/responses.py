"""Linear responses of all cells: derivatives of the readings by the parameters of the rig, and by its settings."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from tumblecal.chain.head_ability import Repeatability
from tumblecal.chain.nominal import Leaf
from tumblecal.chain.rig import Rig
from tumblecal.estimation.linearised import linearised
from tumblecal.estimation.priors import prior_of
from tumblecal.estimation.problem import Problem
from tumblecal.ground.errors import InputError
from tumblecal.plan.cells import Cells, Labels, Numbers


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

    @property
    def settings(self) -> tuple[tuple[Setting, Labels], ...]:
        """The errors of both kinds of settings, with the number of the setting of each cell."""
        return (self.pitch, self.cells.pitch), (self.mount, self.cells.mounting)

    def chosen(self, numbers: Numbers) -> "Responses":
        """The responses of some of the cells, in this order."""
        pitch, mount = (replace(each, columns=each.columns[numbers]) for each in (self.pitch, self.mount))
        columns = self.columns[numbers]
        return replace(self, cells=self.cells.chosen(numbers), columns=columns, pitch=pitch, mount=mount)

    def extended(self, columns: Float[np.ndarray, "cells 3 further"]) -> "Responses":
        """With further shared coefficients, by their readings in standard deviations of the noise."""
        further = columns.shape[2]
        return replace(
            self,
            names=(*self.names, *map(str, range(further))),
            scales=np.append(self.scales, np.ones(further)),
            columns=np.concatenate([self.columns, columns * self.sd], axis=2),
            information=np.pad(self.information, (0, further)),
        )


def stated_noise(rig: Rig) -> float:
    """White noise of a dwell, g.

    **Raises:** `InputError` for a rig whose noise is not stated.
    """
    if not rig.noise_sd_g:
        raise InputError(f'{rig.source}: noise.sd: the noise of a dwell is needed; write [noise] sd = "0.1 mg"')
    return rig.noise_sd_g


def responses_of(rig: Rig, cells: Cells) -> Responses:
    """The responses of a rig.

    **Raises:** `InputError` for a rig whose noise is not stated, or whose settings are indexed by something else.
    """
    sd, kinds = stated_noise(rig), {PITCH: "pitch", MOUNT: "mount"}
    spread = Repeatability() if rig.ability is None else rig.ability.repeatability
    leaves = dict(rig.leaves) | {name: Leaf(by, free=True) for name, by in kinds.items()}
    chain = replace(rig, leaves=leaves).chain(cells.where)
    problem = Problem.from_arrays(chain, cells.where, np.zeros((len(cells), 3)), noise_sd=1.0)
    jacobian = np.asarray(linearised(problem, chain.vector)[1]).reshape(len(cells), 3, -1)
    settings, shared, offset = dict[str, Setting](), list[int](), 0
    for leaf in chain.free:
        own = range(offset, offset := offset + leaf.value.size)
        if leaf.name not in kinds:
            shared += own
            continue
        columns = jacobian[:, :, own].reshape(len(cells), 3, *leaf.value.shape).sum(axis=2)
        free, again = rig.leaves.get(leaf.name, Leaf()).free, getattr(spread, kinds[leaf.name])
        settings[leaf.name] = _setting(columns, leaf.scale, rig.priors.get(leaf.name), again, free)
    weights = prior_of(chain, {name: prior for name, prior in rig.priors.items() if name not in kinds})[1]
    information = np.diag((weights * chain.scales)[shared] ** 2)
    names = tuple(chain.names[k] for k in shared)
    of_settings = settings[PITCH], settings[MOUNT]
    return Responses(cells, names, chain.scales[shared], jacobian[:, :, shared], information, *of_settings, sd)


def _setting(
    columns: np.ndarray, scale: float, prior: tuple[float, float] | None, again: float | None, free: bool
) -> Setting:
    """The errors of a kind of setting; fixed ones have none in common, and unstated repeatability adds none if the common part
    has no bound or a prior (that is then the prior of each visit)."""
    common = None if prior is None else prior[1] / scale
    if not free:
        common = 0.0
    elif again is None and prior is not None:
        # Without a repeatability visits of one setting may differ as much as two settings.
        common, again = 0.0, prior[1]
    return Setting(columns, common, (again or 0.0) / scale, scale)

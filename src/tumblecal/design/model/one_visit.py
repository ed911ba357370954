"""The linear model in which a plan is searched: each combination of temperature, mounting and pitch setting is visited once.

A mounting that is the only one stays when the temperature changes. All candidates have one list of parameters then, whichever
of them a plan contains, so information is a sum over positions.

The model of several visits has at least the information of every order with up to so many visits of each setting: the errors of
n visits, each of variance s^2, have at least the covariance of one error of variance s^2 / n that all positions share (the
difference is positive semidefinite by the Cauchy-Schwarz inequality).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from tumblecal.design.model.cells import Cells
from tumblecal.design.model.responses import Responses, Setting


# A parameter without a bound has a prior of so many times the noise of a dwell, seen through its largest response; it is
# undetermined if a plan reduces the variance of that prior by less than a factor of ten.
_FREE = 1e3
_SEEN = 0.1


@dataclass(frozen=True)
class OneVisit:
    """Candidates and priors. Parameters: the shared ones, scaled as in `Responses`, then the errors of the settings.

    - `columns` (cells, 3, all): readings, in standard deviations of the white noise. `prior`: covariance before the plan, of
      positions that are measured already included; `free`: variance that stands for "no bound" on each shared parameter.
    """

    names: tuple[str, ...]
    columns: Float[np.ndarray, "cells 3 all"]
    prior: Float[np.ndarray, "all all"]
    free: Float[np.ndarray, " shared"]

    @cached_property
    def information(self) -> Float[np.ndarray, "all all"]:
        """Inverse of the prior."""
        return inverse(self.prior)

    def information_with(self, cells: Sequence[int] | np.ndarray) -> Float[np.ndarray, "all all"]:
        """Information after positions in these cells; one that is listed twice is measured twice."""
        rows = self.columns[np.asarray(cells, int)].reshape(-1, self.columns.shape[2])
        return self.information + rows.T @ rows

    def covariance(self, cells: Sequence[int] | np.ndarray) -> Float[np.ndarray, "shared shared"]:
        """Covariance of the shared parameters (scaled) after positions in these cells."""
        shared = len(self.names)
        return inverse(self.information_with(cells))[:shared, :shared]

    def free_directions(self, covariance: Float[np.ndarray, "shared shared"]) -> Float[np.ndarray, "shared directions"]:
        """Combinations of the shared parameters, each over its free standard deviation, that a covariance does not bound."""
        size = np.sqrt(self.free)
        variances, directions = np.linalg.eigh(covariance / np.outer(size, size))
        return directions[:, variances > _SEEN]

    def undetermined(self, cells: Sequence[int] | np.ndarray | None = None) -> tuple[str, ...]:
        """Shared parameters that positions in these cells do not determine; `cells` omitted: that no plan determines."""
        taken = np.arange(len(self.columns)) if cells is None else cells
        share = np.linalg.norm(self.free_directions(self.covariance(taken)), axis=1)
        return tuple(name for name, part in zip(self.names, share, strict=True) if part > _SEEN)


def one_visit(
    responses: Responses,
    keep: Sequence[int] | np.ndarray = (),
    *,
    visits: tuple[int, int] | None = None,
) -> OneVisit:
    """The model of a rig's responses.

    **Arguments:**

    - `keep`: cells that are measured already, in visits of their own (one each).
    - `visits`: the model of up to so many visits of each pitch setting in a mounting, and of each mounting, those of `keep`
      included. A change of the temperature sets nothing again, and the last visits of `keep` are continued.
    """
    cells, kept = responses.cells, np.asarray(keep, int)
    columns = [responses.columns / responses.sd]
    size = _size(columns[0])
    free = _FREE**2 / size**2
    covariance = inverse(responses.information + np.diag(1 / free))
    blocks = [covariance]
    of_pitch, of_mount = _visits(cells, several=visits is not None)
    most = (1, 1) if visits is None else visits
    for setting, labels, planned, number in (
        (responses.pitch, cells.pitch, of_pitch, most[0]),
        (responses.mount, cells.mounting, of_mount, most[1]),
    ):
        if setting.exact:
            continue
        setting = replace(setting, again=setting.again / np.sqrt(number))
        # Visits of the plan first, then those of positions that are measured already.
        both = np.concatenate([labels, labels[kept]])
        visit = np.concatenate([planned, int(planned.max()) + 1 + planned[kept]])
        if len(kept) and visits is not None:
            visit[: len(cells)][planned == planned[kept[-1]]] = visit[-1]
        if setting.common and not setting.again:
            visit = both
        number, first, visit = np.unique(visit, return_index=True, return_inverse=True)
        here = visit.ravel()[:, None] == np.arange(len(number))
        of_setting = _visit_covariance(setting, both[first], responses.sd)
        for component in range(setting.columns.shape[2]):
            one = setting.columns[:, :, component] / responses.sd
            columns.append(np.concatenate([one, one[kept]])[:, :, None] * here[:, None, :])
            blocks.append(of_setting)
    columns[0] = np.concatenate([columns[0], columns[0][kept]])
    everything = np.concatenate(columns, axis=2)
    prior = np.zeros((everything.shape[2],) * 2)
    at = 0
    for block in blocks:
        prior[at : at + len(block), at : at + len(block)] = block
        at += len(block)
    if len(kept):
        rows = everything[len(cells) :].reshape(-1, len(prior))
        prior = inverse(inverse(prior) + rows.T @ rows)
    used = np.any(everything[: len(cells)] != 0, axis=(0, 1)) | (np.arange(len(prior)) < len(free))
    return OneVisit(responses.names, everything[: len(cells)][:, :, used], prior[np.ix_(used, used)], free)


def _visits(cells: Cells, *, several: bool) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the visits of the pitch setting and of the mounting; of `several` visits together.

    A mounting that is the only one is not set again when the temperature changes.
    """
    if several:
        both = np.stack([cells.mounting, cells.pitch])
        return np.unique(both, axis=1, return_inverse=True)[1].ravel(), cells.mounting
    if len(np.unique(cells.mounting)) == 1:
        return cells.group, cells.mounting
    both = np.stack([cells.soak, cells.mounting])
    return cells.group, np.unique(both, axis=1, return_inverse=True)[1].ravel()


def _size(columns: np.ndarray) -> np.ndarray:
    """Largest response of any candidate to each parameter; that of the others for a parameter without any."""
    size = np.max(np.linalg.norm(columns, axis=1), axis=0)
    return np.where(size > 0, size, np.max(size, initial=1e-300))


def _visit_covariance(setting: Setting, labels: np.ndarray, sd: float) -> np.ndarray:
    """Prior covariance of one component of the errors of visits of these settings."""
    same = labels[:, None] == labels
    free = _FREE**2 / float(np.max(_size(setting.columns / sd))) ** 2
    if setting.common is None:
        return free * (same if setting.again else np.eye(len(labels))) + setting.again**2 * np.eye(len(labels))
    return setting.common**2 * same + setting.again**2 * np.eye(len(labels))


def inverse(matrix: np.ndarray) -> np.ndarray:
    """Inverse of a symmetric positive definite matrix, scaled to a unit diagonal for accuracy."""
    size = 1 / np.sqrt(np.diag(matrix))
    return np.outer(size, size) * np.linalg.inv(matrix * np.outer(size, size))

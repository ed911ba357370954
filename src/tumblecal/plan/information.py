"""The information of positions on the parameters of a rig: choice, order and uncertainties of positions follow from it.

It has random effects (split plot: Jones and Goos 2007, Applied Statistics 56, 347): the errors of a setting are common to all
positions of one visit, and are parameters with a prior here. A parameter without a prior has a wide one, so every covariance
exists; it is undetermined if the positions reduce the variance of that prior by less than a factor of ten.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.estimation.visits import visit_precision
from tumblecal.noise.of_head import slow_covariance
from tumblecal.plan.limits import Schedule
from tumblecal.plan.responses import Responses


# Standard deviation of a wide prior, in those that one dwell gives: in a search, whose updates must keep digits, in a result.
SEARCHED, EVALUATED = 1e3, 1e6
_SEEN = 0.1
# A parameter with more than this share in a direction without a bound is undetermined, and one with a larger standard
# uncertainty in its scale: 1 rad, 1 g, 100 %.
_SHARE, _MEANINGLESS = 1e-3, 1e3

Square = Float[np.ndarray, "*n all all"]
Covariance = Float[np.ndarray, "*n shared shared"]


@dataclass(frozen=True)
class Information:
    """An information matrix, and what a position in each cell adds.

    - `columns` (cells, 3, all): derivatives of the readings of a cell by the parameters, in standard deviations of the noise.
    - `information`: before these positions.
    """

    columns: Float[np.ndarray, "*n cells 3 all"]
    information: Square

    def rows(self, cells: Sequence[int] | np.ndarray) -> Float[np.ndarray, "*proposals rows all"]:
        """Rows of some cells, one under another, or of each of several lists of cells."""
        chosen = self.columns[np.asarray(cells, int)]
        return chosen.reshape(*chosen.shape[:-3], -1, chosen.shape[-1])

    def information_with(self, cells: Sequence[int] | np.ndarray) -> Square:
        """Information after positions in some cells; one that is listed twice is measured twice."""
        rows = self.rows(cells)
        return self.information + rows.T @ rows


def covariance_of(information: Square) -> Square:
    """Covariance of all parameters, or of each of several; scaled to a unit diagonal for accuracy."""
    size = 1 / np.sqrt(np.diagonal(information, axis1=-2, axis2=-1))
    scale = size[..., :, None] * size[..., None, :]
    return scale * np.linalg.inv(information * scale)


@dataclass(frozen=True)
class LinearModel(Information):
    """Positions and priors. Parameters: the shared ones, `names`, scaled as in `Responses`, then the errors of the settings.

    Several lists of positions (n) have one model, of which `covariance` and what follows from it are not defined. `free`:
    variance of the wide prior of each parameter, "no bound".
    """

    names: tuple[str, ...]
    free: Float[np.ndarray, " all"]

    def shared(self, information: Square) -> Covariance:
        """Covariance of the shared parameters (scaled) for an information matrix, or for each of several."""
        return covariance_of(information)[..., : len(self.names), : len(self.names)]

    def covariance(self, positions: Sequence[int] | np.ndarray) -> Covariance:
        """Covariance of the shared parameters (scaled) after some positions."""
        return self.shared(self.information_with(positions))

    def free_directions(self, covariance: Square) -> Float[np.ndarray, "some directions"]:
        """Combinations of the first parameters, each over its free standard deviation, that their covariance does not bound."""
        size = np.sqrt(self.free[: len(covariance)])
        variances, directions = np.linalg.eigh(covariance / np.outer(size, size))
        return directions[:, variances > _SEEN]

    def unbounded(self, covariance: Covariance) -> tuple[str, ...]:
        """Shared parameters that a covariance does not determine."""
        share = np.linalg.norm(self.free_directions(covariance), axis=1)
        lost = (share > _SHARE) | (np.diag(covariance) > _MEANINGLESS**2)
        return tuple(name for name, one in zip(self.names, lost, strict=True) if one)

    def undetermined(self, positions: Sequence[int] | np.ndarray | None = None) -> tuple[str, ...]:
        """Shared parameters that some positions do not determine; omitted: that all together do not."""
        return self.unbounded(self.covariance(np.arange(len(self.columns)) if positions is None else positions))

    def with_all(self, slow: Float[np.ndarray, "*n positions positions"] | None = None) -> Square:
        """Information after all positions, or after each of several lists of positions.

        **Arguments:** `slow`: covariance of the means on each axis in addition to white noise of one; omitted: none.
        """
        *lead, count, _, parameters = self.columns.shape
        rows = weighted = self.columns.reshape(*lead, count, -1)
        if slow is not None:
            weighted = np.linalg.solve(slow + np.eye(count), rows)
        flat, weighted = (each.reshape(*lead, 3 * count, parameters) for each in (rows, weighted))
        return self.information + flat.swapaxes(-1, -2) @ weighted


def scheduled_model(
    responses: Responses, planned: Schedule, wide: float = EVALUATED, most: Sequence[int] = (1, 1)
) -> LinearModel:
    """The model of the positions of a schedule, or of several.

    **Arguments:**

    - `wide`: standard deviation of a wide prior, in those that one dwell gives.
    - `most`: visits of each setting that one number includes: the errors of n visits, each of variance s^2, have at least the
      covariance of one error of variance s^2 / n that all positions share (by the Cauchy-Schwarz inequality).
    """
    cells, white = planned.cells, responses.columns / responses.sd
    free = [(wide / _largest(white)) ** 2]
    columns, blocks = [white[cells]], [responses.information + np.diag(1 / free[0])]
    visits = planned.pitch_visit, planned.mount_visit
    for (setting, label), visit, number in zip(responses.settings, visits, most, strict=True):
        if setting.exact:
            continue
        again, unit = setting.again / np.sqrt(number), setting.columns / responses.sd
        # Visits of a setting that is repeated exactly have one error.
        visit = label[cells] if setting.common and not again else visit
        count, unbounded = int(visit.max()) + 1, wide / float(np.max(_largest(unit)))
        # Numbers that no visit of a list has are settings of their own.
        of_visit = np.tile(-1 - np.arange(count), (*visit.shape[:-1], 1))
        np.put_along_axis(of_visit, visit, label[cells], axis=-1)
        precision = visit_precision(setting.common, again, of_visit)
        if setting.common is None:
            precision = precision + np.eye(count) / unbounded**2
        here, components = visit[..., None, None] == np.arange(count), np.moveaxis(unit[cells], -1, 0)
        columns += [component[..., None] * here for component in components]
        blocks += [precision] * len(components)
        free += [np.full(count, unbounded**2)] * len(components)
    whole, end = np.concatenate(columns, axis=-1), 0
    information = np.zeros((*cells.shape[:-1], whole.shape[-1], whole.shape[-1]))
    for block in blocks:
        own = np.s_[end : end + block.shape[-1]]
        information[..., own, own], end = block, own.stop
    return LinearModel(whole, information, responses.names, np.concatenate(free))


def one_visit(
    responses: Responses, measured: Sequence[int] | np.ndarray = (), *, most: Sequence[int] | None = None
) -> LinearModel:
    """The model in which a plan is searched: each combination of temperature, mounting and pitch setting is visited once.

    All cells have one list of parameters then, whichever of them a plan contains, so information is a sum over positions. A
    mounting that is the only one is not set again when the temperature changes.

    **Arguments:**

    - `measured`: cells that are measured already, in visits of their own.
    - `most`: the model of up to so many visits of each pitch setting in a mounting, and of each mounting, those of `measured`
      included: a bound of every order. A change of the temperature sets nothing again.
    """
    cells, kept = responses.cells, np.asarray(measured, int)
    labels = (cells.group, cells.sitting if len(set(cells.mounts)) > 1 else cells.mounting)
    labels = labels if most is None else (cells.setting, cells.mounting)
    visits = [np.append(label, label[kept] + (label.max() + 1 if most is None else 0)) for label in labels]
    visits = [np.unique(visit, return_inverse=True)[1] for visit in visits]
    every = np.append(np.arange(len(cells)), kept)
    both = scheduled_model(responses, Schedule(every, 0.0 * every, 0.0, *visits), SEARCHED, most or (1, 1))
    information = both.information_with(np.arange(len(cells), len(every)))
    return replace(both, columns=both.columns[: len(cells)], information=information)


def _largest(columns: Float[np.ndarray, "cells 3 parameters"]) -> Float[np.ndarray, " parameters"]:
    """Largest response of any cell to each parameter; that of the others for a parameter without any."""
    size = np.max(np.linalg.norm(columns, axis=1), axis=0)
    return np.where(size > 0, size, np.max(size, initial=1e-300))


@dataclass(frozen=True)
class Uncertainties:
    """Of the shared parameters of a schedule.

    - `names`, `scales`, `sd`: standard uncertainties, base units (rad, g, 1); infinite for a parameter that is not determined.
    - `covariance`: of the scaled parameters; of those that are not determined it has no meaning.
    - `bounded`: whether the positions, or priors, bound every error of a setting too.
    """

    names: tuple[str, ...]
    scales: Float[np.ndarray, " shared"]
    sd: Float[np.ndarray, " shared"]
    covariance: Covariance
    bounded: bool = True

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Parameters that are not determined."""
        return tuple(name for name, sd in zip(self.names, self.sd, strict=True) if np.isinf(sd))

    @property
    def determined(self) -> tuple[str, ...]:
        """Parameters that are determined."""
        return tuple(name for name in self.names if name not in self.undetermined)


def uncertainties(responses: Responses, schedule: Schedule, ability: HeadAbility) -> Uncertainties:
    """The standard uncertainties that an exact fit of a schedule states, settings set again and slow noise included."""
    model = scheduled_model(responses, schedule)
    slow = slow_covariance(ability.slow_noise, ability.times, schedule.start_s)
    whole = covariance_of(model.with_all(slow[0] / responses.sd**2))
    covariance = whole[: len(model.names), : len(model.names)]
    lost = np.isin(model.names, model.unbounded(covariance))
    sd = np.where(lost, np.inf, np.sqrt(np.diag(covariance)) * responses.scales)
    bounded = not model.free_directions(whole).shape[1]
    return Uncertainties(responses.names, responses.scales, sd, covariance, bounded)

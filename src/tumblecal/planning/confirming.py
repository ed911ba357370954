"""A measurement that tests the named cause: where it and the strongest alternative predict different readings."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from tumblecal.ground.axes import AXES
from tumblecal.planning.alternatives import Alternative
from tumblecal.planning.new_rows import Rows
from tumblecal.planning.proposals import Proposal
from tumblecal.planning.value import LinearPosterior


# Largest number of readings, smallest distance (deg) at one pitch setting, and smallest separation in standard deviations.
MOST = 3
_DISTANCE_DEG = 30.0
LEAST_SD = 1.0


@dataclass(frozen=True)
class Confirmation:
    """One reading that tests the named cause.

    - `alpha_deg`, `beta_deg`, `axis`: where, in the present mounting, and which reading.
    - `expected_g`: reading predicted by the named cause; `rival_g`: by the alternative (refitted to the data).
    - `sd_g`, `expected_sd_g`: standard deviation of the measured reading minus the prediction of the alternative, and minus
      that of the named cause; both include the noise and the uncertainty of the fit.
    - `rival`: labels of the causes of the alternative; empty: the nominal model.
    """

    alpha_deg: float
    beta_deg: float
    axis: str
    expected_g: float
    rival_g: float
    sd_g: float
    expected_sd_g: float
    rival: tuple[str, ...]

    @property
    def sd_apart(self) -> float:
        """Separation of the two predictions in `sd_g`."""
        return abs(self.expected_g - self.rival_g) / self.sd_g


def confirmations(
    rows: Rows,
    listed: Sequence[Proposal],
    nominal: int,
    leader: tuple[Sequence[int], np.ndarray],
    alternative: Alternative,
) -> tuple[Confirmation, ...]:
    """The readings that best separate a cause from its alternative, the largest separation first.

    The alternative is refitted to the data, so only the part of the signal counts that it cannot predict.

    **Arguments:**

    - `rows`: of the data and of all proposals `listed`. Only single positions in the present mounting at measured pitch
      settings are used, as the fit predicts these.
    - `nominal`: number of nominal columns. `leader`: columns of the named causes, and their coefficients (scaled).
    - `alternative`: the strongest one.
    """
    columns, amplitudes = list(leader[0]), leader[1]
    known = LinearPosterior(
        alternative.rows, [*range(nominal), *alternative.columns], rows.old[:, columns] @ amplitudes
    )
    covariance = known.covariance()
    imitated = known.new @ (covariance @ known.towards)
    separation = (rows.new[:, :, columns] @ amplitudes - imitated) / rows.weight
    sd = _sd(known) / rows.weight
    expected_sd = _sd(LinearPosterior(rows, [*range(nominal), *columns])) / rows.weight
    of_new_groups = rows.new[:, :, rows.new.shape[2] - len(rows.group_prior) :]
    settled = ~np.any(of_new_groups, axis=(1, 2))
    candidates: list[Confirmation] = []
    for proposal, cells in zip(listed, rows.cells, strict=True):
        if proposal.side or not settled[cells[0]]:
            continue
        cell, axis = int(cells[0]), int(np.argmax(np.abs(separation[cells[0]]) / sd[cells[0]]))
        expected, difference = float(rows.predicted[cell, axis]), float(separation[cell, axis])
        at = proposal.alpha_deg[0], proposal.beta_deg, AXES[axis]
        each = float(sd[cell, axis]), float(expected_sd[cell, axis])
        candidates.append(Confirmation(*at, expected, expected - difference, *each, alternative.labels))
    candidates.sort(key=lambda reading: -reading.sd_apart)
    chosen: list[Confirmation] = []
    for reading in candidates:
        near = any(
            other.beta_deg == reading.beta_deg
            and abs((other.alpha_deg - reading.alpha_deg + 180.0) % 360.0 - 180.0) < _DISTANCE_DEG
            for other in chosen
        )
        if len(chosen) < MOST and reading.sd_apart > LEAST_SD and not near:
            chosen.append(reading)
    return tuple(chosen)


def _sd(known: LinearPosterior) -> Float[np.ndarray, "cells 3"]:
    """Standard deviation of each new reading minus its prediction, in units of the noise."""
    return np.sqrt(1.0 + np.einsum("cai,ij,caj->ca", known.new, known.covariance(), known.new))

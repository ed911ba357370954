"""A measurement that tests the named cause: where it and the strongest alternative predict different readings."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tumblecal.ground.axes import AXES
from tumblecal.planning.alternatives import Predicted
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


def confirmations(listed: Sequence[Proposal], leader: Predicted, alternative: Predicted) -> tuple[Confirmation, ...]:
    """The readings that best separate a cause from its alternative, the largest separation first.

    **Arguments:**

    - `listed`: the proposals. Only single positions in the present mounting at measured pitch settings are used, as the fit
      predicts these.
    - `leader`, `alternative`: the named causes and the strongest alternative, each fitted to the data.
    """
    rows = leader.rows
    known, other = (LinearPosterior(one.rows, one.columns) for one in (leader, alternative))
    every = np.arange(len(rows.new))[:, None]
    (mean, spread), (other_mean, other_spread) = known.predicted(every), other.predicted(every)
    mean, separation = mean / rows.weight, (mean - other_mean) / rows.weight
    expected_sd, sd = (np.sqrt(np.diagonal(own, axis1=1, axis2=2)) / rows.weight for own in (spread, other_spread))
    candidates: list[Confirmation] = []
    for proposal, cells in zip(listed, rows.cells, strict=True):
        if proposal.side or np.any(rows.of_new_groups(cells)):
            continue
        cell, axis = int(cells[0]), int(np.argmax(np.abs(separation[cells[0]]) / sd[cells[0]]))
        expected, difference = float(mean[cell, axis]), float(separation[cell, axis])
        at = proposal.alpha_deg[0], proposal.beta_deg, AXES[axis]
        each = float(sd[cell, axis]), float(expected_sd[cell, axis])
        candidates.append(Confirmation(*at, expected, expected - difference, *each, alternative.by.labels))
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

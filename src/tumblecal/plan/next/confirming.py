"""A measurement that tests the named cause: where it and the strongest alternative predict different readings."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import computed_field

from tumblecal.ground.axes import AXES
from tumblecal.plan.next.proposals import NextPosition
from tumblecal.plan.next.rows import Posterior, Rows


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

    @computed_field
    @property
    def sd_apart(self) -> float:
        """Separation of the two predictions in `sd_g`."""
        return abs(self.expected_g - self.rival_g) / self.sd_g


def confirmations(
    listed: Sequence[NextPosition],
    rows: Rows,
    settings: Collection[float],
    known: Posterior,
    other: Posterior,
    labels: tuple[str, ...],
) -> tuple[Confirmation, ...]:
    """The readings that best separate a cause from its alternative, the largest separation first.

    **Arguments:**

    - `listed`: the proposals, with their `rows`. Only single positions in the present mounting at measured pitch `settings`
      (deg) are used, as the fit predicts these.
    - `known`, `other`: the named causes and the strongest alternative (`labels`), each fitted to the data.
    """
    every, candidates = np.arange(len(rows.new))[:, None], list[Confirmation]()
    (mean, sd), (other_mean, other_sd) = (
        (own.mean / rows.weight, np.sqrt(np.diagonal(own.spread, axis1=1, axis2=2)) / rows.weight)
        for own in (known.predicted(every), other.predicted(every))
    )
    axes = np.argmax(np.abs(mean - other_mean) / other_sd, axis=1).tolist()
    for proposal, (cell, *_) in zip(listed, rows.cells, strict=True):
        if proposal.mount or proposal.beta_deg not in settings:
            continue
        place, axis = (proposal.alpha_deg, proposal.beta_deg, AXES[axes[cell]]), axes[cell]
        expected, predicted, u, expected_u = (float(own[cell, axis]) for own in (mean, other_mean, other_sd, sd))
        candidates.append(Confirmation(*place, expected, predicted, u, expected_u, labels))
    chosen: list[Confirmation] = []
    for reading in sorted(candidates, key=lambda reading: -reading.sd_apart):
        near = any(
            other.beta_deg == reading.beta_deg
            and abs((other.alpha_deg - reading.alpha_deg + 180.0) % 360.0 - 180.0) < _DISTANCE_DEG
            for other in chosen
        )
        if len(chosen) < MOST and reading.sd_apart > LEAST_SD and not near:
            chosen.append(reading)
    return tuple(chosen)

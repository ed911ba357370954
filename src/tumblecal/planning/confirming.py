"""A measurement that tests what was named: where the cause and its strongest rival predict different readings."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from tumblecal.ground.axes import AXES
from tumblecal.planning.new_rows import Rows
from tumblecal.planning.proposals import Proposal
from tumblecal.planning.rivals import Rival
from tumblecal.planning.value import Known


# At most so many readings, so far apart (deg) at one pitch setting, and each of at least this many sd.
MOST = 3
_APART_DEG = 30.0
LEAST_SD = 1.0


@dataclass(frozen=True)
class Confirmation:
    """One reading that tests the named cause.

    - `alpha_deg`, `beta_deg`, `axis`: where, in the present mounting, and which reading.
    - `expected_g`: reading if the cause is right; `rival_g`: if it is the rival instead (refitted to the data).
    - `sd_g`: of the measured reading less the rival's prediction, noise and the fit's own uncertainty together;
      `expected_sd_g`: less the cause's own, whose size the data know only so well (a drift is counted on in time).
    - `rival`: labels of the rival's causes; empty: nothing beyond the nominal model.
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
        """How far the two predictions are apart, in sd."""
        return abs(self.expected_g - self.rival_g) / self.sd_g


def confirmations(
    rows: Rows,
    listed: Sequence[Proposal],
    nominal: int,
    leader: tuple[Sequence[int], np.ndarray],
    rival: Rival,
) -> tuple[Confirmation, ...]:
    """The readings that best tell a cause from its rival, the clearest first.

    A reading tells as far as the rival, refitted to the data, cannot predict what the cause does there.

    **Arguments:**

    - `rows`: of the data and of all proposals `listed`. Only single positions in the present mounting at the data's own
      settings are taken: what is fitted predicts them.
    - `nominal`: number of nominal columns. `leader`: columns of the named causes, and what is said of them (scaled).
    - `rival`: its strongest rival.
    """
    columns, amplitudes = list(leader[0]), leader[1]
    known = Known(rival.rows, [*range(nominal), *rival.columns], rows.old[:, columns] @ amplitudes)
    covariance = known.covariance()
    made = known.new @ (covariance @ known.towards)
    apart = (rows.new[:, :, columns] @ amplitudes - made) / rows.weight
    sd = _sd(known) / rows.weight
    expected_sd = _sd(Known(rows, [*range(nominal), *columns])) / rows.weight
    own = len(rows.own_prior)
    settled = ~np.any(rows.new[:, :, rows.new.shape[2] - own :], axis=(1, 2))
    chosen: list[Confirmation] = []
    for proposal, cells in zip(listed, rows.cells, strict=True):
        if proposal.side or not settled[cells[0]]:
            continue
        cell, axis = int(cells[0]), int(np.argmax(np.abs(apart[cells[0]]) / sd[cells[0]]))
        expected, difference = float(rows.predicted[cell, axis]), float(apart[cell, axis])
        at = proposal.alpha_deg[0], proposal.beta_deg, AXES[axis]
        each = float(sd[cell, axis]), float(expected_sd[cell, axis])
        chosen.append(Confirmation(*at, expected, expected - difference, *each, rival.labels))
    chosen.sort(key=lambda reading: -reading.sd_apart)
    kept: list[Confirmation] = []
    for reading in chosen:
        near = any(
            other.beta_deg == reading.beta_deg
            and abs((other.alpha_deg - reading.alpha_deg + 180.0) % 360.0 - 180.0) < _APART_DEG
            for other in kept
        )
        if len(kept) < MOST and reading.sd_apart > LEAST_SD and not near:
            kept.append(reading)
    return tuple(kept)


def _sd(known: Known) -> Float[np.ndarray, "cells 3"]:
    """Of each new reading less what is known of it, in units of the noise."""
    return np.sqrt(1.0 + np.einsum("cai,ij,caj->ca", known.new, known.covariance(), known.new))

"""How well the parameters are known if effects that were not found may be there, each of the size it usually has."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.findings.effect_signals import directions_at_typical_size
from tumblecal.diagnosis.refine.insert import directions_of
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.effects import Catalogue
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.identifiability import RANK_TOLERANCE
from tumblecal.ground.showing import brief


# So many effects are listed with a parameter.
_MOST_LISTED = 2


@dataclass(frozen=True)
class Unseen:
    """Sd of a parameter in `unit`: `sd` if the extended model is correct; `sd_with_unseen`, its root mean square error if
    further effects may be present; `effects`: those with the largest contributions."""

    sd: float
    sd_with_unseen: float
    unit: str
    effects: tuple[str, ...]


class Shifts(NamedTuple):
    """Shifts of the nominal parameters (in their scales) by undetected effects: `moved` by each of their directions of typical
    size; `root` of the directions' covariance, given the data; their mean `estimated`; `owners`: whose each is."""

    __repr__ = brief

    moved: Float[np.ndarray, "nominal directions"]
    root: Float[np.ndarray, "directions directions"]
    estimated: Float[np.ndarray, " directions"]
    owners: list[str]

    @property
    def covariance(self) -> Float[np.ndarray, "nominal nominal"]:
        """Mean square of the shifts, about the parameters as they are."""
        spread, mean = self.moved @ self.root, self.moved @ self.estimated
        return spread @ spread.T + np.outer(mean, mean)


def unseen_shifts(
    screened: Screened,
    entries: Catalogue,
    extended: Fit,
    sigma: float,
    ids: Collection[str] | None = None,
) -> Shifts:
    """The shifts by every visible effect that is not in the explanation.

    Its coefficient is drawn from a normal distribution of the catalogue's typical size about zero. Given the data, the mean
    square error of the parameters is then that of the extended model plus the contribution of the conditional mean and
    covariance of the coefficients (Gaussian linear model with random effects; Rasmussen and Williams, Gaussian Processes for
    Machine Learning, 2.7). Their undetectable part is in `invisible`.

    **Arguments:**

    - `sigma`: noise in units of the white rows. `ids`: the effects considered, by default all.
    """
    at, fitted = screened.at, extended.jacobian / sigma
    named = {cause.slot.id for cause in screened.members}
    if ids is not None:
        named |= {id for id in entries if id not in ids}
    listed = directions_at_typical_size(screened, entries, named)
    signals, owners = at.varying @ listed.steps.T, [listed.ids[number] for number in listed.numbers]
    # Excluded positions contribute nothing.
    signals[~fitted.any(axis=1)] = 0.0
    signals /= sigma
    # The fit's first columns are these directions of the full vector.
    free = directions_of(at, screened.members)
    moved = free[: at.model.nominal] @ (np.linalg.pinv(fitted, rcond=RANK_TOLERANCE)[: free.shape[1]] @ signals)
    left = signals - extended.column_space @ (extended.column_space.T @ signals)
    # In typical sizes the coefficients' prior is the unit matrix.
    root = np.linalg.inv(np.linalg.cholesky(np.eye(len(owners)) + left.T @ left)).T
    return Shifts(moved, root, root @ (root.T @ (left.T @ (extended.rows / sigma))), owners)


def unseen(screened: Screened, entries: Catalogue, extended: Fit, sigma: float) -> dict[str, Unseen]:
    """For each nominal parameter (without those of one position each), its uncertainty including undetected effects, by
    `unseen_shifts`; `sigma`: noise in units of the white rows."""
    own, model = unseen_shifts(screened, entries, extended, sigma), screened.at.model
    ids = list(dict.fromkeys(own.owners))
    whose = np.array(own.owners)[:, None] == np.array(ids)
    by_effect = own.moved**2 @ ((np.sum(own.root**2, axis=1) + own.estimated**2)[:, None] * whose)
    most = np.argsort(-by_effect, axis=1)[:, :_MOST_LISTED].tolist()
    sd = extended.sd[: model.nominal]
    wider = np.hypot(sd, model.scales[: model.nominal] * np.sqrt(np.diag(own.covariance)))
    return {
        name: Unseen(float(sd[k]), float(wider[k]), model.units[k], tuple(ids[number] for number in most[k]))
        for k, name in enumerate(model.names)
        if not model.layout.of_positions[k]
    }

"""Three fields that follow one curve: one thing that goes wrong moves all outputs alike, each by its own share.

A process of three fields gives each a curve of its own, and pays for three. Here the fields' shares are a direction in
space, `sum_j b_j signals_j` with |b| = 1 (the intrinsic model of coregionalization, Goovaerts 1997). The best direction is
climbed to, curve and direction in turn, and integrated over by Laplace's method: its two angles cost half the logarithm of
their information each.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.components import Components, components_of, mean_over_sizes, sizes_of


_CLIMBS = 2


class OneCurve(NamedTuple):
    """A process of one curve: the fields' shares as a unit vector, its log evidence, components, and their variances at the
    best size."""

    direction: Float[np.ndarray, " fields"]
    log_evidence: float
    components: Components
    scaled: Float[np.ndarray, " components"]


class _Curve(NamedTuple):
    """The same along one direction: mean log evidence, the curve's coefficients, and the noise variance beside it."""

    log_evidence: float
    components: Components
    scaled: Float[np.ndarray, " components"]
    coefficients: Float[np.ndarray, " signals"]
    variance: float


def one_curve(
    signals: Float[np.ndarray, "nu columns"], fields: int, z: Float[np.ndarray, " nu"], known: bool
) -> OneCurve:
    """The process with its fields in one direction; columns field after field."""
    by_field = signals.reshape(len(z), fields, -1)
    # From the direction in which the curves of each field lie most.
    apart = _curve(signals, z, known).coefficients.reshape(fields, -1)
    direction = np.linalg.svd(apart, full_matrices=False)[0][:, 0]
    for _ in range(_CLIMBS):
        curve = _curve(np.tensordot(by_field, direction, (1, 0)), z, known)
        shares = np.linalg.lstsq(by_field @ curve.coefficients, z, rcond=1e-6)[0]
        size = float(np.linalg.norm(shares))
        # Where nothing is left there is no direction.
        direction = shares / size if size > 0.0 else direction
    curve = _curve(np.tensordot(by_field, direction, (1, 0)), z, known)
    moved = by_field @ curve.coefficients
    beside = np.linalg.svd(direction[:, None])[0][:, 1:]
    information = beside.T @ (moved.T @ moved) @ beside / curve.variance
    cost = 0.5 * float(np.linalg.slogdet(np.eye(fields - 1) + information)[1])
    return OneCurve(direction, curve.log_evidence - cost, curve.components, curve.scaled)


def _curve(signals: Float[np.ndarray, "nu signals"], z: Float[np.ndarray, " nu"], known: bool) -> _Curve:
    """A process of these signals, its size averaged over; its curve at the best size."""
    components, total = components_of(signals), float(z @ z)
    sizes = sizes_of(components.variances[None])
    along = components.directions.T @ z
    scores = sizes.log_evidence((along**2)[None, :, None], np.array([total]), len(z), known)
    best = int(np.argmax(scores[0, :, 0]))
    shares = sizes.shares[0, best]
    coefficients = components.mixed @ (shares * along / np.sqrt(components.variances))
    variance = 1.0 if known else (total - float(shares @ along**2)) / len(z)
    return _Curve(
        float(mean_over_sizes(scores)[0, 0]),
        components,
        sizes.scaled[0, best],
        coefficients,
        max(variance, 1e-12 * total + 1e-300),
    )

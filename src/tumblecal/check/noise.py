"""The noise of the positions of a check: as stated, by their dwells, or that of the calibration."""

from dataclasses import dataclass, replace

import numpy as np

from tumblecal.data.calibration import Calibration
from tumblecal.data.positions import PositionSet
from tumblecal.ground.errors import InputError


@dataclass(frozen=True)
class PositionNoise:
    """Standard deviations of the positions.

    - `data`: the positions with them. `stated_g`: one for all readings in their place, g. `words`: their source.
    - `dof`: degrees of freedom of the noise; infinite for known noise. `shared`: whether it has the unknown factor of the
      noise of the calibration.
    """

    data: PositionSet
    stated_g: float | None
    words: str
    dof: float = np.inf
    shared: bool = False

    @property
    def sd_g(self) -> float:
        """The median standard deviation, g."""
        if self.stated_g is not None:
            return self.stated_g
        return float(np.median(self.data.sd)) if self.data.sd is not None else float("nan")


def noise_of(calibration: Calibration, data: PositionSet, stated_g: float | None) -> PositionNoise:
    """The noise of the positions.

    Noise within a dwell does not show how much positions differ (settling, handling, hysteresis). A calibration whose noise was
    estimated from its residuals does: a position of the check has at least this dispersion. If its noise was stated, the
    dispersion between positions that its residuals showed in addition is added.

    **Arguments:**

    - `stated_g`: stated by the user, g; it takes precedence.

    **Raises:** `InputError` if no noise is known.
    """
    if stated_g is not None:
        return PositionNoise(data, stated_g, f"{stated_g * 1e3:.3g} mg, as stated")
    provenance = calibration.provenance
    dof, sigma = calibration.dof, provenance.get("sigma_g")
    sigma = float(sigma) if isinstance(sigma, int | float) and sigma > 0 else None
    estimated = dof is not None and np.isfinite(dof)
    if data.sd is None:
        if sigma is None:
            raise InputError(
                f"{data.source}: the noise of the means is not known; write the columns ax_sd_g, ay_sd_g, az_sd_g, or give "
                "--noise-sd (for example --noise-sd 0.1mg)"
            )
        words = f"{sigma * 1e3:.3g} mg, the standard deviation of the positions of the calibration"
        return PositionNoise(data, sigma, words, float(dof) if estimated and dof else np.inf, estimated)
    usual = float(np.median(data.sd))
    within = f"{usual * 1e3:.2g} mg by the dwells"
    between = provenance.get("between_position_sd_g")
    if isinstance(between, int | float) and between > 0:
        widened = replace(data, sd=np.hypot(data.sd, float(between)), recorded_noise=None, n=None)
        words = f"{within}, and {between * 1e3:.2g} mg between positions by the calibration"
        return PositionNoise(widened, None, words, float(dof) if estimated and dof else np.inf)
    if estimated and sigma is not None and np.any(data.sd < sigma):
        alone = bool(np.all(data.sd < sigma))
        widened = replace(data, sd=np.maximum(data.sd, sigma), recorded_noise=None, n=None)
        words = f"{sigma * 1e3:.2g} mg, the dispersion of the positions of the calibration ({within})"
        return PositionNoise(widened, None, words, float(dof) if alone and dof else np.inf, alone)
    return PositionNoise(data, None, within)

"""The noise of the positions of a check: as stated, by their dwells, or that of the calibration."""

from dataclasses import dataclass, replace

import numpy as np

from tumblecal.data.calibration import Calibration
from tumblecal.data.positions import PositionSet
from tumblecal.ground.errors import InputError
from tumblecal.words import sentence


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
        return PositionNoise(data, stated_g, sentence("check/noise_stated", mg=stated_g * 1e3))
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
        words = sentence("check/noise_of_calibration", mg=sigma * 1e3)
        return PositionNoise(data, sigma, words, float(dof) if estimated and dof else np.inf, estimated)
    within_mg = float(np.median(data.sd)) * 1e3
    between = provenance.get("between_position_sd_g")
    if isinstance(between, int | float) and between > 0:
        widened = replace(data, sd=np.hypot(data.sd, float(between)), recorded_noise=None, n=None)
        words = sentence("check/noise_of_dwells", mg=within_mg, between=float(between) * 1e3)
        return PositionNoise(widened, None, words, float(dof) if estimated and dof else np.inf)
    if estimated and sigma is not None and np.any(data.sd < sigma):
        alone = bool(np.all(data.sd < sigma))
        widened = replace(data, sd=np.maximum(data.sd, sigma), recorded_noise=None, n=None)
        words = sentence("check/noise_of_dispersion", mg=sigma * 1e3, within=within_mg)
        return PositionNoise(widened, None, words, float(dof) if alone and dof else np.inf, alone)
    return PositionNoise(data, None, sentence("check/noise_of_dwells", mg=within_mg, between=0.0))

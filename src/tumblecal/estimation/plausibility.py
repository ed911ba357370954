"""Plausibility of fitted parameters: a good fit can still have values that no real instrument has."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tumblecal.chain.nominal import PITCH_ERROR
from tumblecal.estimation.fit import Fit
from tumblecal.ground.units import in_words, shown


if TYPE_CHECKING:
    from tumblecal.chain.head_file import MeasuredHead


# The largest usual sizes, base units. A vernier is read and a pitch is set within a degree or two, and a triad is
# mounted within some degrees. Data sheets of MEMS triads (ADXL345, MPU-6050, BMI160) allow up to 10 % of scale, 40 to
# 250 mg of bias and 1 to 2 % between axes. Boards have larger biases: 0.25 to 0.5 g in three of twelve public sets. The
# limit of 0.6 g is above these, and below the 1 g of readings from which gravity was subtracted. At rest, also in the
# hand, means repeat within some milli-g.
USUAL = {
    "levelling": math.radians(2.0),
    "dbeta": math.radians(2.0),
    "dtheta": math.radians(15.0),
    "gamma": math.radians(6.0),
    "dK": 0.1,
    "bias": 0.6,
    "scatter": 0.03,
}
# The same for the coefficients of any other effect, by unit: larger ones would have been noticed during the set-up.
_OF_EFFECTS = {
    "g": 0.3,
    "g/g": 0.3,
    "g/g^2": 0.3,
    "g/g^3": 0.3,
    "g/g^5": 0.3,
    "1": 0.1,
    "rad": math.radians(5.0),
    "rad/g": math.radians(5.0),
}
_WHY = {
    "levelling": "the base is not level, or the pitch angle has another zero",
    "dbeta": "the pitch angle differed from the label of this setting, or the scale was misread",
    "dtheta": "the triad is turned in its fixture or, about x, the spindle has another zero (indistinguishable here): state a "
    "turn in a rig file (mounts)",
    "gamma": "the axes of the file are not those of one triad, or an angle is wrong",
    "dK": "the scale or the unit of the readings, or the range of the device, is wrong",
    "bias": "an offset was added to the readings, or their scale is wrong",
    "scatter": "the residuals are so large that the fit describes none of the readings; check the residuals and the log",
}
_WHY_EFFECT = (
    "implausible for a real instrument: a sign, a column, a unit or an angle is wrong in a part of the rows, or the "
    "cause is not "
    "in the catalogue"
)
_CONTRADICTED = "the stated value belongs to another head or set-up, or the stated value or the data are wrong"
# A parameter must exceed its usual size by so many standard deviations; with a prior the usual size is this multiple of its sd.
_SURE_SD, _PRIOR_SD = 3.0, 5.0


@dataclass(frozen=True)
class Implausible:
    """A parameter outside the usual range: value, sd and the largest usual size, in `unit` as shown.

    - `stated`, `stated_sd`: mean and sd of its prior, which it contradicts; `usual` is then the largest deviation
      from the mean. `stated_in`: the option or file that states the prior; "" if unknown.
    """

    parameter: str
    value: float
    sd: float
    usual: float
    unit: str
    why: str
    stated: float | None = None
    stated_sd: float | None = None
    stated_in: str = ""

    @property
    def times(self) -> float:
        """Size, or deviation from the stated value, over the largest usual one."""
        return abs(self.value - (self.stated or 0.0)) / self.usual

    @property
    def words(self) -> str:
        """Value, and the usual or stated one."""
        size, most = in_words(f"{self.value:.4g}", self.unit), in_words(f"{self.usual:.3g}", self.unit)
        if self.stated is None:
            return f"{self.parameter} = {size} (at most {most} is usual)"
        stated = in_words(f"{self.stated:.4g} +- {self.stated_sd:.2g}", self.unit)
        source = f" by {self.stated_in}" if self.stated_in else ""
        return f"{self.parameter} = {size} from the data, but {stated} as stated{source}"


def implausible_words(listed: Sequence[Implausible]) -> list[str]:
    """Implausible parameters and the possible reason, with one sentence for each reason."""
    by_reason: dict[str, list[str]] = {}
    for unusual in listed:
        by_reason.setdefault(unusual.why, []).append(unusual.words)
    return [f"{', '.join(words)}: {why}" for why, words in by_reason.items()]


def implausible(fit: Fit, stated: Mapping[str, float] | None = None) -> tuple[Implausible, ...]:
    """Parameters of a fit, and its residual sd (`scatter`), that are larger than usual; the most unusual first.

    Parameters of a single position, such as the tilts of an unknown attitude, have no usual size: they absorb the errors of the
    sensor there (a bias of 0.1 g turns the reading by 6 degrees).

    **Arguments:**

    - `fit`: of the nominal or the extended chain.
    - `stated`: the largest usual size by leaf (`dbeta`) or parameter (`dbeta_0`), base units, in place of the defaults. A
      stated prior replaces both: five of its standard deviations.
    """
    limits, problem, rows = USUAL | dict(stated or {}), fit.problem, list[_Row]()
    precision = problem.prior_root.T @ problem.prior_root
    sds = np.where(np.diag(precision) > 0, np.sqrt(np.diag(np.linalg.pinv(precision))), np.inf)
    priors = dict(zip(problem.chain.names, zip(np.asarray(problem.prior_mean), sds, strict=True), strict=True))
    fitted = dict(zip(fit.names, zip(fit.values.tolist(), fit.sd.tolist(), strict=True), strict=True))
    of_positions = problem.chain.of_positions
    for leaf in problem.chain.free:
        for name in set(leaf.names) & fitted.keys():
            mean, prior_sd = map(float, priors.get(name, (0.0, np.inf)))
            if np.isfinite(prior_sd):
                rows.append(_Row(name, leaf.unit, *fitted[name], _PRIOR_SD * prior_sd, _CONTRADICTED, (mean, prior_sd)))
                continue
            unstated = math.inf if name in of_positions else _OF_EFFECTS.get(leaf.unit, math.inf)
            usual = limits.get(name, limits.get(leaf.name, unstated))
            rows.append(_Row(name, leaf.unit, *fitted[name], usual, _WHY.get(leaf.name, _WHY_EFFECT)))
    if fit.dof > 0:
        sd = fit.sigma / math.sqrt(2 * fit.dof)
        rows.append(_Row("scatter", "g", fit.sigma, sd, limits["scatter"], _WHY["scatter"]))
    return _beyond(rows)


def implausible_head(head: "MeasuredHead", stated: Mapping[str, float] | None = None) -> tuple[Implausible, ...]:
    """The errors of a measured head that are larger than usual, the most unusual first. The limit of `dbeta` applies to pitch
    settings.

    **Arguments:**

    - `stated`: as in `implausible`.
    """
    limits, rows = USUAL | dict(stated or {}), list[_Row]()
    for name, unit, value, sd in zip(head.names, head.units, head.values.tolist(), head.sd.tolist(), strict=True):
        of_pitch = name.startswith(PITCH_ERROR)
        usual = limits["dbeta"] if of_pitch else limits.get(name, _OF_EFFECTS.get(unit, math.inf))
        rows.append(_Row(name, unit, value, sd, usual, _WHY["dbeta"] if of_pitch else _WHY_EFFECT))
    return _beyond(rows)


class _Row(NamedTuple):
    """A parameter in its base unit, its largest usual size or deviation from the mean of its prior, and the possible reason."""

    name: str
    unit: str
    value: float
    sd: float
    usual: float
    why: str
    prior: tuple[float, float] | None = None


def _beyond(rows: Sequence[_Row]) -> tuple[Implausible, ...]:
    """The parameters that are surely larger than usual, the most unusual first."""
    listed = []
    for name, base, value, sd, usual, why, prior in rows:
        if abs(value - (prior[0] if prior else 0.0)) - _SURE_SD * sd > usual:
            unit, scale = ("deg", math.degrees(1.0)) if base == "rad" and not prior else shown(base)
            mean, prior_sd = (part * scale for part in prior) if prior else (None, None)
            listed.append(Implausible(name, value * scale, sd * scale, usual * scale, unit, why, mean, prior_sd))
    return tuple(sorted(listed, key=lambda entry: -entry.times))

"""A check: whether a calibration is still valid, what its recording cannot see, and what changed."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from tumblecal.chain import Chain
from tumblecal.check.consistency import Consistency, tested
from tumblecal.check.expected import Expected, expected, require_temperature, responses, without_terms
from tumblecal.check.gravity import LocalSize
from tumblecal.check.moved import Moved, moved
from tumblecal.check.noise import PositionNoise, noise_of
from tumblecal.check.observation import Observation, observed
from tumblecal.check.sensitivity import Sensitivity, sensitivity
from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_use import YES, Use, combined
from tumblecal.data.gravity_size import size_fault
from tumblecal.data.positions import PositionSet
from tumblecal.data.sensor_parameters import SENSOR, triad_of
from tumblecal.estimation.attitudes import slopes
from tumblecal.estimation.position_problem import default_chain, problem_of
from tumblecal.estimation.priors import Priors
from tumblecal.estimation.problem import Problem
from tumblecal.ground.errors import InputError
from tumblecal.ground.record import rows
from tumblecal.words import sentence


Outcome = Literal["agrees", "changed", "repeat"]
# The linearisation is repeated at the changed parameters.
_ROUNDS = 2
# Corrected readings at rest are within this of gravity, g.
_FAR = 0.2


@dataclass(frozen=True)
class Sizes:
    """Size of gravity at each attitude less the expected size, g, and its standard uncertainty without a change."""

    excess: Float[np.ndarray, " positions"]
    sd: Float[np.ndarray, " positions"]


@dataclass(frozen=True)
class CheckResult:
    """A check.

    - `calibration`: read from `path`. `data`: the positions. `expected`, `test`, `sensitivity`: see their classes.
    - `moved`: explanations of a rejected calibration, or of an attitude that was not at rest; otherwise None. `without`: the
      test without that attitude, if the others agree with the calibration; otherwise None.
    - `sizes`: of gravity. `use`: whether the calibration may be used.
    - `outside_degc`: temperatures outside the range of the calibration.
    """

    calibration: Calibration
    path: Path
    data: PositionSet
    expected: Expected
    noise: PositionNoise
    test: Consistency
    sensitivity: Sensitivity
    sizes: Sizes
    moved: Moved | None
    without: Consistency | None
    use: Use
    gravity: LocalSize
    outside_degc: Float[np.ndarray, "2"] | None = None

    @property
    def serial_number(self) -> str | None:
        """Serial number of the unit, as the recording or the calibration states it."""
        return self.data.serial_number or self.calibration.serial_number

    @property
    def attitudes_known(self) -> bool:
        """Whether the angles of the attitudes are known."""
        return not self.data.hand_held

    @property
    def attitudes(self) -> list[dict[str, Any]]:
        """Name, excess of gravity and its standard uncertainty (g) of each attitude."""
        return rows(name=self.data.names, excess_g=self.sizes.excess, u_g=self.sizes.sd)

    @property
    def change_g(self) -> tuple[float, float] | None:
        """`Moved.change_g`; None if the calibration is not rejected."""
        return None if self.moved is None else self.moved.change_g

    @property
    def disturbed(self) -> str:
        """The attitude that was not at rest, while the others agree with the calibration; "" if there is none."""
        named = self.moved.named if self.moved is not None and self.without is not None else None
        return "" if named is None else named.attitude

    @property
    def outcome(self) -> Outcome:
        """`agrees`, `changed`, or `repeat`: an attitude was not at rest, or the attitudes disagree with each other."""
        if self.disturbed:
            return "repeat"
        if self.test.rejected:
            return "changed"
        return "repeat" if self.test.disagree and self.test.noise_factor == 1 else "agrees"


@dataclass(frozen=True)
class Model:
    """The model of attitudes with known angles: `chain` makes it for a position set (default: the nominal one), `priors` of its
    angles."""

    chain: Callable[[PositionSet], Chain] = default_chain
    priors: Priors = field(default_factory=dict)

    def problem(self, data: PositionSet, noise: PositionNoise) -> Problem:
        """The problem of some positions.

        **Raises:** `InputError` for a chain without the sensor's parameters, one for all positions.
        """
        chain = self.chain(data)
        if missing := [name for name in SENSOR if name not in chain.names]:
            raise InputError(
                f"{data.source}: the model has no {missing[0]} for all positions; give a rig that estimates it"
            )
        return problem_of(data, chain, noise_sd=noise.stated_g, priors=self.priors)


def check(
    calibration: Calibration,
    path: Path,
    data: PositionSet,
    *,
    model: Model | None = None,
    noise_sd: float | None = None,
    gravity: LocalSize | None = None,
    extrapolate: bool = False,
    largest_g: float | None = None,
    repeatability: Float[np.ndarray, "9"] | None = None,
) -> CheckResult:
    """Check a calibration.

    **Arguments:**

    - `path`: of the calibration file. `data`: still attitudes, in g of the calibration.
    - `model`: of attitudes with known angles. `noise_sd`: of a reading, g, in place of that of the data.
    - `gravity`: at the place of the recording; by default that of the calibration.
    - `extrapolate`: whether temperatures may be outside the range of the calibration. `largest_g`: largest error of a force
      that is acceptable in use, g. `repeatability`: as of `expected`.

    **Raises:** `InputError` for readings that no attitude explains, temperatures outside, a calibration without uncertainty.
    """
    gravity = gravity or LocalSize()
    outside = require_temperature(calibration, path, data, extrapolate=extrapolate)
    degc = None if data.temperature_degc is None else float(np.mean(data.temperature_degc))
    noise = noise_of(calibration, data, noise_sd)
    noise = replace(noise, data=without_terms(calibration, noise.data, degc))
    before = expected(calibration, path, degc, size=gravity.ratio, size_sd=gravity.u, repeatability=repeatability)
    sizes = _sizes(before, noise)
    _require_gravity(noise.data, before, sizes, gravity)
    problem = (model or Model()).problem(noise.data, noise)

    def test_of(rows: Observation, *, estimate: bool = False) -> Consistency:
        return tested(rows, before, noise_dof=noise.dof, shared=noise.shared, estimate=estimate)

    of_terms = responses(calibration, noise.data, before)
    test = test_of(observed(problem, before.mean, responses=of_terms))
    explained, without = None, None
    if test.rejected or test.disagree:
        for _ in range(_ROUNDS):
            explained = moved(test, noise.sd_g)
            best = explained.named
            change = explained.average[0] if best is None else best.change
            test = test_of(observed(problem, before.mean, before.mean + change, of_terms))
        explained = moved(test, noise.sd_g)
        if explained.named is not None and explained.named.kind == "attitude":
            without = test_of(test.observation.without(explained.named.attitude))
        if without is None or without.rejected or without.disagree:
            test, without = test_of(test.observation, estimate=True), None
            explained = moved(test, noise.sd_g) if test.rejected else None
    result = CheckResult(
        calibration=calibration,
        path=path,
        data=data,
        expected=before,
        noise=noise,
        test=test,
        sensitivity=sensitivity(test),
        sizes=sizes,
        moved=explained,
        without=without,
        use=YES,
        gravity=gravity,
        outside_degc=outside,
    )
    return replace(result, use=_use(result, largest_g))


def _sizes(before: Expected, noise: PositionNoise) -> Sizes:
    """The size of gravity at each position."""
    data = noise.data
    values = before.mean
    force = (data.readings - values[3:6]) @ np.linalg.inv(triad_of(values)).T
    sizes = np.linalg.norm(force, axis=1)
    up = force / sizes[:, None]
    rows, prior = slopes(up), before.of_parameters + before.common
    sd = np.full(data.readings.shape, noise.stated_g) if noise.stated_g or data.sd is None else data.sd
    variance = np.einsum("ri,ij,rj->r", rows, prior, rows) + np.sum((up * sd) ** 2, axis=1)
    return Sizes((sizes - 1) * before.size, np.sqrt(variance))


def _require_gravity(data: PositionSet, before: Expected, sizes: Sizes, gravity: LocalSize) -> None:
    """Check that the readings are gravity.

    **Raises:** `InputError` with the positions that are far from it.
    """
    far = np.flatnonzero(np.abs(sizes.excess) > _FAR)
    if len(far) and (fault := size_fault(data.readings - before.mean[3:6])):
        raise InputError(f"{data.source}: {fault}")
    if len(far):
        worst = int(np.argmax(np.abs(sizes.excess)))
        listed = ", ".join(data.names[k] for k in far[:5]) + (f" and {len(far) - 5} more" if len(far) > 5 else "")
        raise InputError(
            f"{data.source}: position {listed}: the corrected readings are far from gravity "
            f"({gravity.ratio + sizes.excess[worst]:.3g} g at {data.names[worst]}): moving, saturated, or in a different unit; "
            "check --unit and the column names, or record it again"
        )


def _use(result: CheckResult, largest_g: float | None) -> Use:
    """The use that the calibration's statement and the check allow together."""
    stated = result.calibration.use if result.calibration.use.answer else YES
    if result.outcome == "agrees":
        return stated
    if result.outcome == "repeat":
        reason = sentence("check/repeat", name=result.disturbed)
        return combined([stated, Use("yes", reason)], stated.expanded_g)
    reason = sentence("check/changed", acceptable=False)
    if result.change_g is None:
        return combined([stated, Use("no", reason)])
    size, expanded = result.change_g
    if largest_g is not None and size + expanded <= largest_g:
        together = size + expanded + (stated.expanded_g or 0.0)
        return combined([stated, Use("yes", sentence("check/changed", acceptable=True))], together)
    return combined([stated, Use("no", reason)])

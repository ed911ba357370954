"""One attempt at one position: the head at rest, at the right angles, its samples as they arrive, and their summary."""

from typing import NamedTuple

import numpy as np

from tumblecal.capture.capture_plan import CapturePlan, LimitsTable
from tumblecal.capture.decoding.losses import Losses, losses_of
from tumblecal.capture.decoding.samples import Entry, Floats, joined, usable
from tumblecal.capture.port.live import Arrived, collected
from tumblecal.capture.protocols import Protocol
from tumblecal.ground.axes import AXES
from tumblecal.ground.frames import angle_between_deg
from tumblecal.ground.numbers_shown import counted


_KNOCK_Z, _SHAKEN, _CREEP_U = 5.0, 2.0, 5.0
NOT_TURNED, WRONG_POSITION = "not_turned", "wrong_position"


class Stationarity(NamedTuple):
    """Stationarity of a dwell.

    **Arguments:**

    - `knocks`: blocks that are outliers from the baseline. `creep`: the last block, if the drift is significant.
    - `drift_g`: end minus beginning of a straight line through the block means, per axis.
    - `tilt_arcsec`: the tilt that would cause that drift (by the axes that are sensitive to it).
    """

    knocks: list[int]
    creep: list[int]
    drift_g: Floats
    tilt_arcsec: float


class Blocks:
    """Blocks of about a second of samples.

    **Arguments:**

    - `rate_hz`: sample rate. `most`: number of blocks to keep, the last ones; 0 for all.

    `size`: samples in a block. `mean_g`, `sd_g`: mean of each block, and standard deviation of its samples, shape (k, 3).
    """

    mean_g: Floats
    sd_g: Floats

    def __init__(self, rate_hz: float, most: int = 0):
        self.size, self._most = max(4, round(rate_hz)), most
        self.forget()

    def forget(self) -> None:
        """Begin again: the head turns."""
        self._unfinished = self.mean_g = self.sd_g = np.zeros((0, 3))

    def forget_unfinished(self) -> None:
        """After a gap: the samples of a block must belong together."""
        self._unfinished = np.zeros((0, 3))

    def add(self, force: Floats) -> int:
        """Add samples (n, 3); returns the number of blocks that they complete."""
        data = np.vstack([self._unfinished, force])
        count = len(data) // self.size
        blocks, self._unfinished = np.split(data, [count * self.size])
        blocks = blocks.reshape(count, self.size, 3)
        self.mean_g = np.concatenate([self.mean_g, blocks.mean(1)])[-self._most :]
        self.sd_g = np.concatenate([self.sd_g, blocks.std(1, ddof=1)])[-self._most :]
        return count

    def still(self, limit_g: float) -> bool:
        """Whether the head is at rest: two steady means, and no more noise than the quieter block explains."""
        means, noise = self.mean_g[-2:], self.sd_g[-2:]
        if len(means) < 2:
            return False
        quiet = noise.min(0)
        allowed = np.maximum(limit_g, 6 * quiet / np.sqrt(self.size))
        return bool((np.ptp(means, axis=0) < allowed).all() and (noise < np.maximum(3 * quiet, limit_g)).all())

    def stationarity(self) -> Stationarity:
        """Judge the blocks of a dwell.

        The baseline of each axis is the median and the median absolute deviation of the block means; with few blocks the
        noise of the samples is used.
        """
        means, noise = self.mean_g, self.sd_g
        if (n := len(means)) < 3:
            return Stationarity([], [], np.zeros(3), 0.0)
        quiet, centre = np.median(noise, axis=0), np.median(means, axis=0)
        scatter = 1.4826 * np.median(np.abs(np.diff(means, axis=0)), axis=0) / np.sqrt(2)
        scale = np.maximum(np.maximum(scatter, quiet / np.sqrt(self.size)), 1e-9)
        outlier = (np.abs(means - centre) > _KNOCK_Z * scale) | (noise > _SHAKEN * quiet)
        line = np.polyfit(np.arange(n), means, 1)[0] * (n - 1)
        # Its standard uncertainty for independent blocks is scale sqrt(12/n).
        creep = [n - 1] if (np.abs(line) > _CREEP_U * scale * np.sqrt(12 / n)).any() else []
        across = line - line @ centre / max(centre @ centre, 1e-9) * centre
        tilt_arcsec = np.linalg.norm(across) * (180 / np.pi * 3600)
        return Stationarity(np.flatnonzero(outlier.any(1)).tolist(), creep, line, float(tilt_arcsec))


class Verdict(NamedTuple):
    """The result for a mean.

    **Arguments:**

    - `fault`: entry of the journal: `NOT_TURNED` or `WRONG_POSITION`; empty if it fits.
    - `text`: message for the operator; empty if it fits.
    - `off_deg`: angle between the measured and the expected direction.
    """

    fault: str
    text: str
    off_deg: float


def judge(plan: CapturePlan, position: int, mean_g: Floats, previous: int | None = None) -> Verdict:
    """Compare a mean with the nominal chain; the first explanation within the tolerance is the verdict.

    **Arguments:**

    - `plan`: the positions.
    - `position`: the prompted position. `previous`: the position measured before.
    - `mean_g`: mean specific force in units of local gravity, shape (3,).
    """
    named = [f"alpha {step.alpha_deg:g}, beta {step.beta_deg:g}" for step in plan.steps]
    expected, wanted, nearest = plan.expected(position), named[position], int(np.argmax(plan.directions @ mean_g))
    size, off_deg = float(np.linalg.norm(mean_g)), angle_between_deg(mean_g, expected)
    if abs(size - 1) > plan.limits.magnitude:
        return Verdict(WRONG_POSITION, f"the readings add up to {size:.3f} g, not 1 g: check range and unit", off_deg)
    if off_deg <= plan.tolerance_deg:
        return Verdict("", "", off_deg)
    if previous is not None and angle_between_deg(mean_g, plan.expected(previous)) <= plan.tolerance_deg:
        return Verdict(NOT_TURNED, f"still at {named[previous]}: turn to {wanted}", off_deg)
    # The angles at which an ideal instrument has this direction.
    x, y, z = (mean_g if plan.mount is None else plan.mount.T @ mean_g) / size
    alpha, beta = np.degrees(np.arctan2(y, z)) % 360, -np.degrees(np.arcsin(np.clip(x, -1, 1)))
    signs = {
        f"the sign of axis {axis} seems reversed": expected * (1 - 2 * np.eye(3)[k]) for k, axis in enumerate(AXES)
    }
    explanations = {
        f"this looks like {named[nearest]}, not {wanted}": plan.expected(nearest),
        **signs,
        "all signs seem reversed": -expected,
        "axes x and y seem exchanged": expected[[1, 0, 2]],
        "axes x and z seem exchanged": expected[[2, 1, 0]],
        "axes y and z seem exchanged": expected[[0, 2, 1]],
        f"this looks like alpha {alpha:.1f}, beta {beta:.1f}, not {wanted}": mean_g,
    }
    found = (text for text, force in explanations.items() if angle_between_deg(mean_g, force) <= plan.tolerance_deg)
    return Verdict(WRONG_POSITION, next(found), off_deg)


class Dwell:
    """Samples of one attempt.

    **Arguments:**

    - `number`: number of the attempt. `needed`: required good samples. `rate_hz`: the device's sample rate.
    - `to_local_g`: factor from standard g to local g. `before`: the samples just before it: a late frame may belong there.

    `parts`: its samples. `blocks`: of the good ones. `good`: number of samples without a status bit; only these are used.
    `count`: number of all samples.
    """

    def __init__(self, number: int, needed: int, rate_hz: float, to_local_g: float, before: list[Arrived]):
        self.number, self.needed, self.before, self.parts = number, needed, before, list[Arrived]()
        self._rate_hz, self._to_local_g = rate_hz, to_local_g
        self.blocks, self.good, self.count = Blocks(rate_hz), 0, 0

    def take(self, part: Arrived) -> None:
        """Add new samples."""
        if len(part.samples):
            force = part.samples.force[usable(part.samples)]
            self.parts.append(part)
            self.good += len(force)
            self.count += len(part.samples)
            self.blocks.add(force * self._to_local_g)

    def losses(self, protocol: Protocol, after: list[Arrived]) -> Losses:
        """Samples lost during the attempt; `after` are the samples after it, which resolve a late gap."""
        parts, start = [*self.before, *self.parts, *after], sum(len(part.samples) for part in self.before)
        specials = [event.stop for part in parts for event in part.events if event.counted]
        return losses_of(protocol, *collected(parts), self._rate_hz, range(start, start + self.count), specials)

    def refusal(self, losses: Losses, limits: LimitsTable) -> str:
        """Why the attempt must be repeated; empty if it is good."""
        if (lost := losses.lost) > limits.lost_fraction * self.needed:
            sent = self.count + lost
            return (
                f"{lost} of {sent} samples lost ({100 * lost / sent:.1f} %), {counted(len(losses.gaps), 'gap')}; "
                f"limits.lost_fraction allows {100 * limits.lost_fraction:g} %"
            )
        if self.count - self.good > limits.flagged_fraction * self.needed:
            return f"{self._flagged_words}; limits.flagged_fraction allows {100 * limits.flagged_fraction:g} %"
        return ""

    def warning(self, limits: LimitsTable) -> str:
        """Faults so far, in words; empty for none."""
        found, words = self.blocks.stationarity(), []
        if found.knocks:
            words.append(f"knock: {len(found.knocks)} outlier block(s)")
        elif found.creep:
            words.append(f"creeping: {found.tilt_arcsec:.0f} arcsec so far")
        if self.count - self.good > max(limits.flagged_fraction * self.needed, 1):
            words.append(self._flagged_words)
        noise_mg = 1e3 * self.blocks.sd_g.mean(0).max()
        if limits.noise_mg is not None and noise_mg > 3 * limits.noise_mg:
            words.append(f"noise {noise_mg:.2f} mg, expected {limits.noise_mg:g} mg")
        return "; ".join(words)

    @property
    def _flagged_words(self) -> str:
        flagged = self.count - self.good
        return f"{flagged} of {self.count} samples without a number or flagged by the device (overload, error)"

    def summary(self, losses: Losses) -> Entry:
        """The summary for the journal."""
        found, samples = self.blocks.stationarity(), joined(part.samples for part in self.parts)
        force, degc = samples.force[usable(samples)] * self._to_local_g, samples.temperature
        degc = degc[np.isfinite(degc)]
        return {
            "mean_g": force.mean(0).tolist(),
            "sd_g": force.std(0, ddof=min(1, len(force) - 1)).tolist(),
            "n": self.good,
            "flagged": self.count - self.good,
            "lost": losses.lost,
            "lost_unresolved": losses.unresolved,
            "lost_counted": losses.counted,
            "replaced_by_replies": losses.replaced,
            "rate_hz": losses.rate_hz,
            **found._asdict(),
            "drift_g": found.drift_g.tolist(),
            "temperature_degc": float(degc.mean()) if len(degc) else None,
        }

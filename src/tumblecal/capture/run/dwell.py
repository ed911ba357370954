"""One attempt at one position: the samples as they arrive, intermediate statistics, and the summary at the end."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.capture_plan import LimitsTable
from tumblecal.capture.decoding.losses import Losses, count_losses, losses_from_time
from tumblecal.capture.decoding.samples import Samples, Status
from tumblecal.capture.port.live import Arrived, collected
from tumblecal.capture.protocols import Protocol
from tumblecal.capture.run.rest import BlockCutter, Blocks, Stationarity, mean_variance, stationarity
from tumblecal.ground.counted import counted


# Half a wrap of the STIM300's counter: shorter pauses cannot contain a whole wrap.
_PAUSE_S = 0.06


@dataclass
class Dwell:
    """Samples of one attempt.

    **Arguments:**

    - `number`: number of the attempt. `needed`: required good samples. `size`: samples in a block of about a second.
    - `to_local_g`: factor from standard g to local g. `before`: the samples just before it: a late frame may belong there.

    `good`, `flagged`: number of samples without and with a status bit; `blocks`: of the good ones.
    """

    number: int
    needed: int
    size: int
    to_local_g: float
    before: list[Arrived]
    parts: list[Arrived] = field(default_factory=list)
    blocks: Blocks = field(default_factory=lambda: np.zeros((0, 2, 3)))
    good: int = 0
    flagged: int = 0

    def __post_init__(self) -> None:
        self._cutter = BlockCutter(self.size)
        # Sums of the samples minus the first one, and of their squares.
        self._first, self._sums = np.full(3, np.nan), np.zeros((2, 3))

    def take(self, part: Arrived) -> None:
        """Add new samples; samples with a status bit are counted but not used."""
        if not len(part.samples):
            return
        self.parts.append(part)
        use = (part.samples.status == 0) & np.isfinite(part.samples.force).all(1)
        force = part.samples.force[use] * self.to_local_g
        if not self.good and len(force):
            self._first = force[0]
        self.flagged += int((~use).sum())
        self.good += len(force)
        if len(force):
            self._sums += [(force - self._first).sum(0), ((force - self._first) ** 2).sum(0)]
        self.blocks = np.concatenate([self.blocks, self._cutter.add(force)])

    @property
    def mean(self) -> NDArray[np.float64]:
        """Mean specific force so far, local g; NaN before the first sample."""
        return self._first + self._sums[0] / max(self.good, 1)

    @property
    def sd(self) -> NDArray[np.float64]:
        """Standard deviation of a sample so far."""
        if self.good < 2:
            return np.full(3, np.nan)
        return np.sqrt(np.maximum(self._sums[1] - self._sums[0] ** 2 / self.good, 0) / (self.good - 1))

    @property
    def log_range(self) -> tuple[int, int]:
        """The records of the raw log with this attempt."""
        return int(self.parts[0].log_start[0]), int(self.parts[-1].log_stop[-1])

    def paused_lately(self, seconds: float) -> bool:
        """Whether nothing arrived for a while near the end, so that later samples must show the loss."""
        stamps = np.concatenate([p.host_s for p in self.parts])
        return bool((np.diff(stamps[stamps > stamps[-1] - seconds]) > _PAUSE_S).any())

    def losses(self, protocol: Protocol, rate_hz: float | None, after: list[Arrived]) -> Losses:
        """Samples lost during the attempt; `after` are the samples after it, which resolve a late gap."""
        samples, host_s = collected([*self.before, *self.parts, *after])
        start = sum(len(p.samples) for p in self.before)
        inside = range(start, start + sum(len(p.samples) for p in self.parts))
        specials = [event.stop for part in (*self.before, *self.parts) for event in part.events if event.counted]
        return losses_of(protocol, samples, host_s, rate_hz, inside, specials)

    def summary(self, losses: Losses) -> dict[str, Any]:
        """The summary for the journal."""
        found = stationarity(self.blocks, self.size)
        degc = np.concatenate([p.samples.temperature for p in self.parts])
        degc = degc[np.isfinite(degc)]
        return {
            "mean_g": self.mean.tolist(),
            "sd_g": self.sd.tolist(),
            "sd_of_mean_g": (np.sqrt(mean_variance(self.blocks, self.size)) if len(self.blocks) else self.sd).tolist(),
            "n": self.good,
            "flagged": self.flagged,
            "lost": losses.lost,
            "lost_unresolved": losses.unresolved,
            "lost_counted": losses.counted,
            "replaced_by_replies": losses.replaced,
            "rate_hz": losses.rate_hz,
            **found._asdict(),
            "drift_g": found.drift_g.tolist(),
            "temperature_degc": float(degc.mean()) if len(degc) else None,
        }


def losses_of(
    protocol: Protocol,
    samples: Samples,
    host_s: NDArray[np.float64],
    rate_hz: float | None,
    attempt: range,
    special_stops: list[int],
) -> Losses:
    """Losses among the samples of `attempt`, by the counter if there is one, otherwise by time; the others are context."""
    counter, inside = protocol.counter, slice(attempt.start, attempt.stop)
    if counter is None or not len(samples) or samples.counter[0] < 0:
        return losses_from_time(host_s[inside], None).by_device(samples.clock[inside], host_s[inside])
    step = max(1, round(counter.ticks_per_s / rate_hz)) if counter.ticks_per_s is not None and rate_hz else None
    specials = np.searchsorted(samples.stop, np.array(special_stops, np.int64)) - 1
    starting = (samples.status & Status.STARTING) != 0
    restarts = np.flatnonzero(~starting[:-1] & starting[1:])
    found = count_losses(samples.counter, host_s, counter.modulus, step, specials, restarts, samples.content)
    found = found.by_device(samples.clock, host_s)
    gaps = [gap for gap in found.gaps if attempt.start <= gap.after < attempt.stop - 1]
    return replace(found, lost=sum(g.lost for g in gaps), unresolved=sum(not g.resolved for g in gaps), gaps=gaps)


def warning(dwell: Dwell, found: Stationarity, limits: LimitsTable) -> str:
    """Faults of a dwell so far, in words; empty for none."""
    words = []
    if found.knocks:
        words.append(f"knock: {len(found.knocks)} outlier block(s)")
    elif found.creep:
        words.append(f"creeping: {found.tilt_arcsec:.0f} arcsec or {abs(found.drift_g).max() * 1e6:.0f} ug so far")
    if dwell.flagged > max(limits.flagged_fraction * dwell.needed, 1):
        words.append(f"{dwell.flagged} samples without a number or flagged by the device (overload, error)")
    if limits.noise_mg is not None and dwell.sd.max() > 3e-3 * limits.noise_mg:
        words.append(f"noise {dwell.sd.max() * 1e3:.2f} mg, expected {limits.noise_mg:g} mg")
    return "; ".join(words)


def refusal(dwell: Dwell, losses: Losses, limits: LimitsTable) -> str:
    """Why an attempt must be repeated; empty if it is good."""
    received = dwell.good + dwell.flagged
    if losses.lost > limits.lost_fraction * dwell.needed:
        sent = received + losses.lost
        return (
            f"{losses.lost} of {sent} samples lost ({100 * losses.lost / sent:.1f} %) in {counted(len(losses.gaps), 'gap')}; "
            f"limits.lost_fraction allows {100 * limits.lost_fraction:g} %"
        )
    if dwell.flagged > limits.flagged_fraction * dwell.needed:
        return (
            f"{dwell.flagged} of {received} samples without a number or flagged by the device (overload, error); "
            f"limits.flagged_fraction allows {100 * limits.flagged_fraction:g} %"
        )
    return ""

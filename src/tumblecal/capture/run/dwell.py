"""One attempt at one position: the samples as they arrive, their losses, and the summary at the end."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.capture_plan import LimitsTable
from tumblecal.capture.decoding.losses import Losses, count_losses, losses_from_time
from tumblecal.capture.decoding.samples import Samples, usable
from tumblecal.capture.port.live import Arrived, collected
from tumblecal.capture.protocols import Protocol
from tumblecal.capture.run.rest import Blocks
from tumblecal.ground.numbers_shown import counted


class Dwell:
    """Samples of one attempt.

    **Arguments:**

    - `number`: number of the attempt. `needed`: required good samples. `rate_hz`: the device's sample rate.
    - `to_local_g`: factor from standard g to local g. `before`: the samples just before it: a late frame may belong there.

    `parts`: its samples. `blocks`: of the good ones. `good`: number of samples without a status bit; only these are used.
    `flagged`: number of the others.
    """

    def __init__(self, number: int, needed: int, rate_hz: float, to_local_g: float, before: list[Arrived]):
        self.number, self.needed, self.before, self.parts = number, needed, before, list[Arrived]()
        self._rate_hz, self._to_local_g, self._force = rate_hz, to_local_g, list[NDArray[np.float64]]()
        self.blocks, self.good, self.flagged = Blocks(rate_hz), 0, 0

    def take(self, part: Arrived) -> None:
        """Add new samples."""
        if count := len(part.samples):
            force = part.samples.force[usable(part.samples)]
            self.parts.append(part)
            self._force.append(force * self._to_local_g)
            self.good += len(force)
            self.flagged += count - len(force)
            self.blocks.add(self._force[-1])

    def losses(self, protocol: Protocol, after: list[Arrived]) -> Losses:
        """Samples lost during the attempt; `after` are the samples after it, which resolve a late gap."""
        parts, start = [*self.before, *self.parts, *after], sum(len(part.samples) for part in self.before)
        samples, host_s = collected(parts)
        specials = [event.stop for part in parts for event in part.events if event.counted]
        inside = range(start, start + self.good + self.flagged)
        return losses_of(protocol, samples, host_s, self._rate_hz, inside, specials)

    def refusal(self, losses: Losses, limits: LimitsTable) -> str:
        """Why the attempt must be repeated; empty if it is good."""
        if losses.lost > limits.lost_fraction * self.needed:
            sent = self.good + self.flagged + losses.lost
            return (
                f"{losses.lost} of {sent} samples lost ({100 * losses.lost / sent:.1f} %), {counted(len(losses.gaps), 'gap')}; "
                f"limits.lost_fraction allows {100 * limits.lost_fraction:g} %"
            )
        if self.flagged > limits.flagged_fraction * self.needed:
            return f"{self._flagged_words}; limits.flagged_fraction allows {100 * limits.flagged_fraction:g} %"
        return ""

    def warning(self, limits: LimitsTable) -> str:
        """Faults so far, in words; empty for none."""
        found, words = self.blocks.stationarity(), []
        if found.knocks:
            words.append(f"knock: {len(found.knocks)} outlier block(s)")
        elif found.creep:
            words.append(f"creeping: {found.tilt_arcsec:.0f} arcsec so far")
        if self.flagged > max(limits.flagged_fraction * self.needed, 1):
            words.append(self._flagged_words)
        noise_mg = 1e3 * self.blocks.sd_g.mean(0).max()
        if limits.noise_mg is not None and noise_mg > 3 * limits.noise_mg:
            words.append(f"noise {noise_mg:.2f} mg, expected {limits.noise_mg:g} mg")
        return "; ".join(words)

    @property
    def _flagged_words(self) -> str:
        of = self.good + self.flagged
        return f"{self.flagged} of {of} samples without a number or flagged by the device (overload, error)"

    def summary(self, losses: Losses) -> dict[str, Any]:
        """The summary for the journal."""
        found, force = self.blocks.stationarity(), np.concatenate(self._force)
        degc = np.concatenate([p.samples.temperature for p in self.parts])
        degc = degc[np.isfinite(degc)]
        return {
            "mean_g": force.mean(0).tolist(),
            "sd_g": force.std(0, ddof=min(1, len(force) - 1)).tolist(),
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
        return losses_from_time(host_s[inside]).by_device(samples.clock[inside], host_s[inside])
    step = max(1, round(counter.ticks_per_s / rate_hz)) if counter.ticks_per_s is not None and rate_hz else None
    specials = np.searchsorted(samples.stop, np.array(special_stops, np.int64)) - 1
    found = count_losses(samples, host_s, counter.modulus, step, specials)
    found = found.by_device(samples.clock, host_s)
    gaps = [gap for gap in found.gaps if attempt.start <= gap.after < attempt.stop - 1]
    return replace(found, lost=sum(g.lost for g in gaps), unresolved=sum(not g.resolved for g in gaps), gaps=gaps)

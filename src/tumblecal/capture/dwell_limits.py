"""Checks of an attempt against the limits of a plan: warnings while it is recorded, and reasons to reject it."""

from tumblecal.capture.capture_plan import LimitsTable
from tumblecal.capture.dwell import Dwell
from tumblecal.capture.losses import Losses
from tumblecal.capture.stationarity import Stationarity
from tumblecal.ground.counted import counted


_LONG_ENOUGH_S = 20.0


def warning(dwell: Dwell, seen: Stationarity, limits: LimitsTable) -> str:
    """Faults of a dwell so far, in words; empty for none."""
    words = []
    if seen.knocks:
        words.append(f"knock: {len(seen.knocks)} outlier block(s)")
    if seen.creep and not seen.knocks:
        words.append(f"creeping: {seen.tilt_arcsec:.0f} arcsec or {abs(seen.drift_g).max() * 1e6:.0f} ug so far")
    if dwell.flagged > max(limits.flagged_fraction * dwell.needed, 1):
        words.append(f"{dwell.flagged} samples without a number or flagged by the device (overload, error)")
    if limits.noise_mg is not None and dwell.sd.max() > 3e-3 * limits.noise_mg:
        words.append(f"noise {dwell.sd.max() * 1e3:.2f} mg, expected {limits.noise_mg:g} mg")
    return "; ".join(words)


def rate_warning(measured_hz: float, samples: int, wanted_hz: float) -> str:
    """A warning if the rate by the host's clock is too low: a device skips samples silently if the line is too slow."""
    if samples / wanted_hz <= _LONG_ENOUGH_S or abs(measured_hz / wanted_hz - 1) <= 0.01:
        return ""
    return f"the device sends {measured_hz:.2f} samples/s, {wanted_hz:g} are configured: baud rate too low?"


def refusal(dwell: Dwell, losses: Losses, limits: LimitsTable) -> str:
    """Why an attempt must be repeated; empty if it is good."""
    if losses.lost > limits.lost_fraction * dwell.needed:
        sent = dwell.good + dwell.flagged + losses.lost
        return (
            f"{losses.lost} of {sent} samples lost ({100 * losses.lost / sent:.1f} %) in {counted(len(losses.gaps), 'gap')}; "
            f"limits.lost_fraction allows {100 * limits.lost_fraction:g} %"
        )
    if dwell.flagged > limits.flagged_fraction * dwell.needed:
        return (
            f"{dwell.flagged} of {dwell.good + dwell.flagged} samples without a number or flagged by the device (overload, "
            f"error); limits.flagged_fraction allows {100 * limits.flagged_fraction:g} %"
        )
    return ""

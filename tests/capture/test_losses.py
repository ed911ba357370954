"""Loss counting against streams whose losses are known: flips, unplugs, stalls, late reads, a skewed clock."""

import numpy as np
import pytest
from streams import counted_samples

from tumblecal.capture.decoding.losses import count_losses
from tumblecal.capture.decoding.samples import Status


def stream(
    seed: int, rate: float, duration: float, unplugs: int, stalls: int = 10, loss: float = 0.004, skew: float = 3e-5
):
    """Numbers of the samples that arrive, and the stamp of the read that brought each."""
    random = np.random.default_rng(seed)
    n = int(duration * rate)
    times = np.arange(n) / rate * (1 + skew)
    kept = random.random(n) > loss
    for start in random.uniform(3, duration - 6, unplugs):
        kept[(times > start) & (times < start + random.uniform(0.3, 1.5))] = False
    arrival = times + 0.001 + random.exponential(0.0008, n)
    for start in random.uniform(1, duration - 5, stalls):
        stop = start + random.uniform(0.02, 0.4)
        held = (times > start) & (times < stop)
        arrival[held] = np.maximum(arrival[held], stop)
    arrival = np.maximum.accumulate(arrival)
    read = np.ceil(arrival / 0.01) * 0.01
    numbers = np.flatnonzero(kept)
    return numbers, read[numbers]


@pytest.mark.parametrize(("rate", "duration", "unplugs"), [(125.0, 60.0, 9), (2000.0, 30.0, 7), (500.0, 40.0, 3)])
@pytest.mark.parametrize("seed", range(2))
def test_lost_samples_are_counted_exactly(rate: float, duration: float, unplugs: int, seed: int) -> None:
    numbers, host_s = stream(seed, rate, duration, unplugs)
    step = round(2000 / rate)
    found = count_losses(counted_samples(numbers * step % 256), host_s, 256, step)
    assert found.lost == numbers[-1] - numbers[0] + 1 - len(numbers)
    assert found.unresolved == 0 and found.duplicates == 0
    assert sum(g.lost for g in found.gaps) == found.lost
    # The device's clock is 30 ppm slow.
    assert found.rate_hz == pytest.approx(rate / (1 + 3e-5), rel=3e-4)


def test_a_gap_at_the_end_is_called_unresolved() -> None:
    numbers = np.concatenate([np.arange(1000), np.arange(1100, 1105)])
    host_s = np.ceil(numbers / 125.0 / 0.01) * 0.01
    found = count_losses(counted_samples(numbers * 16 % 256), host_s, 256, 16)
    assert found.unresolved == 1 and not found.gaps[-1].resolved
    assert found.lost % 16 == 100 % 16


def test_duplicates_and_restarts() -> None:
    counter = np.array([0, 16, 32, 32, 48, 0, 16, 32])
    host_s = np.arange(8) / 125.0
    samples = counted_samples(counter, np.array([0, 1, 2, 2, 3, 4, 5, 6]))
    samples.status[5:] = Status.STARTING
    found = count_losses(samples, host_s, 256, 16)
    assert found.duplicates == 1 and found.lost == 0 and found.unresolved == 1


def test_clock_counters_with_jitter() -> None:
    random = np.random.default_rng(0)
    numbers = np.delete(np.arange(2000), [50, 51, 700])
    counter = numbers * 10_000_000 + random.integers(-20_000, 20_000, len(numbers))
    found = count_losses(counted_samples(counter), numbers / 100.0, 2**62)
    assert found.lost == 3

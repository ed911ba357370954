"""Samples and damaged streams that several tests of the protocols use."""

import numpy as np

from tumblecal.capture.decoding.samples import Samples, blank


def some_samples(n: int, seed: int = 0) -> Samples:
    """Plausible samples with a running counter."""
    random = np.random.default_rng(seed)
    samples = blank(n)
    samples.force[:] = random.normal(size=(n, 3)) * 0.02 + [0.0, 0.6, -0.8]
    samples.rate[:] = random.normal(size=(n, 3))
    samples.temperature[:] = 30 + random.normal(size=n)
    samples.counter[:] = np.arange(n)
    return samples


def counted_samples(counter: np.ndarray, content: np.ndarray | None = None) -> Samples:
    """Samples with these counters, and with different contents unless `content` has equal ones."""
    samples = blank(len(counter))
    samples.counter[:] = counter
    samples.temperature[:] = np.arange(len(counter)) if content is None else content
    return samples

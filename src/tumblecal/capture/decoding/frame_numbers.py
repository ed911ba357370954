"""Frames of a stream in the order of sending, from a counter that wraps and a stream that may reorder.

A frame whose number is missing among the last few is a late one; a frame with the number and content of one of the last few
is a repeat. Every other step of the counter is forward (modular arithmetic); whole wraps need the host's stamps
(`losses`).
"""

from itertools import pairwise

import numpy as np

from tumblecal.capture.decoding.samples import Integers, Mask, Samples, Status


# Number of later frames that may arrive before a frame that they overtook.
WINDOW = 8
# A counter with a larger forward step was reset: counters of 64 bits do not wrap.
_MOST_TICKS = 1 << 53


def commonest_step(counter: Integers, modulus: int) -> int:
    """The usual step of a counter: exact if it counts samples, the median if it is a clock."""
    steps = np.diff(counter) % modulus
    # Steps of more than half the counter are backwards.
    values, counts = np.unique(steps[(steps > 0) & (steps <= modulus // 2)], return_counts=True)
    if not len(values):
        return 1
    return int(values[np.argmax(counts)] if counts.max() > counts.sum() / 4 else np.median(values.repeat(counts)))


def window_of(modulus: int, step: int) -> int:
    """Number of later frames that may arrive before a frame, for a counter with this modulus and ticks a frame."""
    return min(WINDOW, modulus // step // 4)


def frame_numbers(samples: Samples, modulus: int, step: int) -> tuple[Integers, Mask, Mask]:
    """The numbers of frames from 0 for the first that arrived (late frames have smaller ones than the frame before), whether
    the same frame had arrived before, and whether the device restarted before it, shape (n,) each.

    **Arguments:**

    - `samples`: as they arrived, n > 0. `modulus`: value at which the counter wraps. `step`: ticks from one frame to the next.
    """
    n, window, floor = len(samples), window_of(modulus, step), -WINDOW
    starting = (samples.status & Status.STARTING) > 0
    restarted = np.append(False, starting[1:] & ~starting[:-1])
    steps, number = np.diff(samples.counter, prepend=samples.counter[0] - step) % modulus, np.arange(n)
    odd = np.flatnonzero((np.abs(steps - step) >= step / 2) | restarted)
    for k, stop in pairwise([*odd.tolist(), n]):
        recent, forward = number[max(0, k - 4 * WINDOW) : k], int(steps[k])
        last, top, ahead = int(recent[-1]), int(recent.max()), round(forward / step)
        # Without a step the frame is a repeat, or whole wraps are missing, which only stamps can show.
        late = last - round((modulus - forward) / step) if ahead else last
        known = k - len(recent) + np.flatnonzero(recent == late)
        if restarted[k] or (forward > _MOST_TICKS and late < top - window):
            floor = first = top + 1
        elif not ahead or (max(floor, top - window) <= late and (not len(known) or _equal(samples, known[0], k))):
            first = late
        else:
            first = last + ahead
        number[k:stop] = first + np.arange(stop - k)
    order = np.argsort(number, kind="stable")
    repeated = np.zeros(n, bool)
    for k in np.flatnonzero(np.diff(number[order]) == 0):
        repeated[order[k + 1]] = repeated[order[k]] or _equal(samples, order[k], order[k + 1])
    return number, repeated, restarted


def _equal(samples: Samples, one: int, other: int) -> bool:
    """Whether two frames have equal contents."""
    columns = samples.force, samples.rate, samples.temperature, samples.status
    return all(np.array_equal(column[one], column[other], equal_nan=True) for column in columns)

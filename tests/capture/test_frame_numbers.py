"""Losses of streams that reorder, repeat and drop, in counters of any width: the truth comes from the lists themselves."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from streams import counted_samples, some_samples

from tumblecal.capture.decoding.byte_file import FileContents
from tumblecal.capture.decoding.frame_numbers import WINDOW
from tumblecal.capture.decoding.framing import decode_all
from tumblecal.capture.decoding.losses import count_losses
from tumblecal.capture.decoding.samples import Settings
from tumblecal.capture.protocols import protocol


@st.composite
def disturbed(draw: st.DrawFn) -> tuple[int, int, int, np.ndarray]:
    """Ticks a wrap, ticks a frame, the first counter, and the frames' numbers as they arrive."""
    step = draw(st.sampled_from([1, 3, 16, 1000]))
    per_wrap = draw(st.sampled_from([4, 7, 16, 100, 256, 65536]))
    window = min(WINDOW, per_wrap // 4)
    # A jump forward must not look like a frame that was overtaken by a few.
    longest = per_wrap - 2 * window - 1
    sent = np.cumsum(draw(st.lists(st.sampled_from([1] * 20 + [2, 3, 9, 90]), min_size=30, max_size=120)))
    sent = np.cumsum(np.diff(sent, prepend=0).clip(1, max(longest, 1)))
    late = {k: draw(st.integers(1, window)) for k in draw(st.sets(st.integers(1, len(sent) - 1), max_size=12))}
    twice = {k: draw(st.integers(1, window)) for k in draw(st.sets(st.integers(1, len(sent) - 1), max_size=12))}
    # A frame arrives before any frame that was sent `window` or more numbers after it.
    arrivals = [(number, number) for number in sent.tolist()]
    arrivals += [(int(sent[k]) + delay + 0.5, int(sent[k])) for k, delay in twice.items()]
    arrivals = [
        (at + late[k] + 0.25 if (k := int(np.searchsorted(sent, number))) in late and at == number else at, number)
        for at, number in arrivals
    ]
    return per_wrap * step, step, draw(st.integers(0, per_wrap * step - 1)), np.array([n for _, n in sorted(arrivals)])


@given(disturbed())
@settings(max_examples=100)
def test_the_true_loss_of_any_swaps_repeats_and_drops(case: tuple[int, int, int, np.ndarray]) -> None:
    modulus, step, first, numbers = case
    counter = (first + numbers * step) % modulus
    found = count_losses(counted_samples(counter, numbers), np.zeros(len(numbers)), modulus, step)
    distinct = len(set(numbers.tolist()))
    assert found.lost == np.ptp(numbers) + 1 - distinct
    assert found.duplicates == len(numbers) - distinct
    assert sum(gap.lost for gap in found.gaps) == found.lost and found.unresolved == 0


def exchanged(count: int, pairs: np.ndarray) -> np.ndarray:
    """0, 1, 2, ... with the numbers at `pairs` and behind exchanged."""
    numbers = np.arange(count)
    numbers[pairs], numbers[pairs + 1] = pairs + 1, pairs
    return numbers


def test_a_file_of_exchanged_frames_has_lost_none_however_it_is_cut() -> None:
    stim300 = protocol("stim300")
    settings_ = Settings((10.0,) * 3, "acceleration", 125.0)
    samples = some_samples(2000)
    samples.counter[:] = np.arange(2000) * 16 % 256
    order = np.delete(exchanged(2000, np.arange(3, 1990, 9)), [500, 501, 1200])
    frames = stim300.encode(samples[order], settings_)
    for size in (len(frames), 38 * 9 + 5):
        contents, decoder = FileContents(stim300, 125.0), stim300.decoder(settings_)
        for start in range(0, len(frames), size):
            contents.add(decoder.feed(frames[start : start + size]))
        contents.add(decoder.finish())
        assert contents.losses().startswith("lost by the counter: 3 in 2 gaps, 0 replaced"), size
    assert len(decode_all(stim300.decoder(settings_), frames).samples) == 1997

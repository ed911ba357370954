"""Streams of every protocol: round trips, any cut, garbage anywhere, damage; nothing false, nothing more lost."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from streams import some_samples

from tumblecal.capture.decoding.framing import decode_all
from tumblecal.capture.decoding.samples import Counts, Samples, Settings, blank, joined
from tumblecal.capture.protocols import protocol, protocols
from tumblecal.capture.protocols.stim300 import PLACES, encode, encode_configuration, encode_special


NAMES = sorted(protocols())
# How finely each protocol sends: force in g, rate in deg/s, temperature in degC.
STEPS = {
    "stim300": (2.0**-19, 2.0**-14, 2.0**-8),
    "witmotion": (16 / 32768, 2000 / 32768, 0.01),
    "xsens": (1e-6, 1e-4, 1e-4),
    "vectornav": (1e-6, 1e-4, 1e-4),
    "mip": (1e-6, 1e-4, np.inf),
    "inertial_labs": (1e-6, 1e-5, 0.1),
    "text": (2e-6, 1e-4, 0.01),
}


def bitwise_crc32(data: bytes) -> int:
    """CRC-32/MPEG-2 straight from its definition."""
    register = 0xFFFFFFFF
    for byte in data:
        register ^= byte << 24
        for _ in range(8):
            register = ((register << 1) ^ 0x04C11DB7 if register & 0x80000000 else register << 1) & 0xFFFFFFFF
    return register


def settings_for(name: str) -> Settings:
    how = protocol(name)
    return how.settings((10.0 if name == "stim300" else 16.0) if how.ranges_g else None, 125.0)


def decoder_for(name: str):
    return protocol(name).decoder(replace(settings_for(name), whole=True))


def in_pieces(decoder, data: bytes, sizes: list[int]) -> tuple[Samples, Counts]:
    parts, counts, at = [], Counts(), 0
    k = 0
    while at < len(data):
        size = sizes[k % len(sizes)]
        found = decoder.feed(data[at : at + size])
        parts.append(found.samples)
        counts.add(found.counts)
        at, k = at + size, k + 1
    last = decoder.finish()
    counts.add(last.counts)
    return joined([*parts, last.samples]), counts


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=8)
@given(seed=st.integers(0, 2**32), n=st.integers(30, 40), cuts=st.lists(st.integers(1, 90), min_size=4, max_size=8))
def test_round_trip_however_it_is_cut(name: str, seed: int, n: int, cuts: list[int]) -> None:
    samples = some_samples(n, seed)
    data = protocol(name).encode(samples, settings_for(name))
    found, counts = in_pieces(decoder_for(name), data, cuts)
    assert len(found) == n and counts.discarded == 0 and counts.resyncs == 0
    force, rate, temperature = STEPS[name]
    assert np.abs(found.force - samples.force).max() <= force
    assert np.abs(found.rate - samples.rate).max() <= rate
    if np.isfinite(found.temperature).all():
        assert np.abs(found.temperature - samples.temperature).max() <= temperature
    modulus = protocol(name).counter.modulus if protocol(name).counter else None
    if modulus and found.counter[0] >= 0:
        np.testing.assert_array_equal(found.counter, samples.counter % modulus)
    whole = decode_all(decoder_for(name), data)
    np.testing.assert_array_equal(whole.samples.stop, found.stop)


@pytest.mark.parametrize("identifier", sorted(PLACES))
@pytest.mark.parametrize("crlf", [False, True])
def test_every_stim300_datagram(identifier: int, crlf: bool) -> None:
    samples = some_samples(20)
    data = encode(samples, settings_for("stim300"), identifier, crlf)
    found = decode_all(decoder_for("stim300"), data)
    assert len(found.samples) == 20 and found.counts.discarded == 0
    places = PLACES[identifier]
    size = len(data) // 20 - 2 * crlf
    assert size == places["size"]
    # Against the definition: the check over the frame with its dummy bytes.
    frame = data[:size]
    assert bitwise_crc32(frame[:-4] + bytes(-size % 4)) == int.from_bytes(frame[-4:], "big")
    if "a" in places:
        assert np.abs(found.samples.force - samples.force).max() < 2.0**-19
    if "a temperature" in places:
        assert np.abs(found.samples.temperature - samples.temperature).max() < 2.0**-8


@pytest.mark.parametrize("output", ["increment", "integrated"])
def test_stim300_velocity_outputs(output: str) -> None:
    """Increments and integrated velocities of a steady force give that force, also across the 24-bit wrap."""
    n, rate, force = 3000, 125.0, np.array([0.5, -0.25, 0.8])
    scale = 2.0**22
    per_sample = force * 9.80665 / rate * scale
    number = np.arange(n)[:, None]
    raw = np.repeat(np.rint(per_sample)[None], n, 0) if output == "increment" else np.rint(per_sample * number)
    raw = (raw + 2**23) % 2**24 - 2**23
    samples = blank(n)
    samples.force[:] = raw * 2.0**-19
    samples.counter[:] = 16 * np.arange(n)
    ten_g = settings_for("stim300")
    body = bytearray(bytes.fromhex(encode_configuration(ten_g).hex())[1:22])
    body[7] = 0x70 | {"increment": 1, "integrated": 4}[output]
    data = encode_special("configuration", bytes(body)) + encode(samples, ten_g)
    found = decode_all(protocol("stim300").decoder(), data).samples.force
    np.testing.assert_allclose(found[1:], np.tile(force, (n - 1, 1)), atol=2e-5)


def test_damage_costs_only_the_damaged_frames() -> None:
    """Flips, lost and inserted bytes in a fifth of the frames."""
    n, random, samples = 3000, np.random.default_rng(3), some_samples(3000, 3)
    pieces, whole = [], np.ones(n, bool)
    for k, row in enumerate(np.frombuffer(encode(samples, settings_for("stim300")), np.uint8).reshape(n, 38)):
        kind, at, frame = random.integers(15), int(random.integers(38)), bytearray(row)
        if kind == 0:
            frame[at] ^= 1 << int(random.integers(8))
        elif kind == 1:
            del frame[at]
        elif kind == 2:
            frame = random.bytes(at + 1) + frame
        whole[k] = kind > 1
        pieces.append(bytes(frame))
    found, _ = in_pieces(decoder_for("stim300"), b"".join(pieces), [997, 64, 4096])
    assert len(found) == whole.sum() < n
    assert np.abs(found.force - samples.force[whole]).max() <= 2.0**-19

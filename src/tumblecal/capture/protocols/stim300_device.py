"""The output of a STIM300 from samples and settings, for the virtual instrument and the tests."""

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.decoding.checks import crc32_mpeg2
from tumblecal.capture.decoding.samples import Samples, Settings
from tumblecal.capture.protocols.stim300_datagrams import (
    ACCELERATION_BITS,
    BAUDS,
    CRLF,
    LAYOUTS,
    OUTPUTS,
    RANGE_CODES,
    RATES_HZ,
    SPECIAL_PAIRS,
    STATUS_BITS,
)


# The latency field, and the bits of a configuration with acceleration and inclination, and with temperatures.
_LATENCY_US, _CLUSTERS, _TEMPERATURES = 506, 0x06, 0x08


def _sealed(rows: NDArray[np.uint8], padding: int, crlf: bool) -> bytes:
    """Rows of frames without CRC to bytes with CRC (and CR LF)."""
    check = crc32_mpeg2(rows, padding).astype(">u4").view(np.uint8).reshape(-1, 4)
    ending = np.tile(np.frombuffer(CRLF, np.uint8), (len(rows), 1))[:, : 2 * crlf]
    return np.concatenate([rows, check, ending], axis=1).tobytes()


def _put24(rows: NDArray[np.uint8], at: int, values: NDArray[np.float64]) -> None:
    words = np.clip(np.rint(values), -(2**23), 2**23 - 1).astype(">i4").view(np.uint8).reshape(len(rows), 3, 4)
    rows[:, at : at + 9] = words[:, :, 1:].reshape(len(rows), 9)


def _put16(rows: NDArray[np.uint8], at: int, values: NDArray[np.float64]) -> None:
    words = np.clip(np.rint(values * 256), -(2**15), 2**15 - 1).astype(">i2")
    rows[:, at : at + 6] = np.repeat(words[:, None], 3, 1).view(np.uint8).reshape(len(rows), 6)


def encode(samples: Samples, settings: Settings, identifier: int | None = None, crlf: bool = False) -> bytes:
    """Normal frames of one kind, as a STIM300 with output "acceleration" sends them.

    **Arguments:**

    - `samples`: the samples; `status` goes into the accelerometers' status byte (the gyros' without them).
    - `settings`: the range gives the scale.
    - `identifier`: kind of frame; by default all clusters, with temperatures if the settings have them.
    - `crlf`: CR LF after every frame.
    """
    identifier = identifier or (0xA7 if settings.temperatures else 0x93)
    layout = LAYOUTS[identifier]
    n = len(samples)
    rows = np.zeros((n, layout.size - 4), np.uint8)
    rows[:, 0] = identifier
    _put24(rows, 1, np.nan_to_num(samples.rate) * 2.0**14)
    status_at = 10
    if layout.acceleration is not None:
        scale = np.array([2.0 ** ACCELERATION_BITS[r] for r in settings.range_g or (10.0,) * 3])
        _put24(rows, layout.acceleration, samples.force * scale)
        status_at = layout.acceleration + 9
    if layout.inclination is not None:
        _put24(rows, layout.inclination, np.clip(np.nan_to_num(samples.force), -1.7, 1.7) * 2.0**22)
    temperature = np.nan_to_num(samples.temperature)
    for at in (layout.gyro_temperature, layout.acceleration_temperature, layout.inclination_temperature):
        if at is not None:
            _put16(rows, at, temperature)
    for flag, bits in STATUS_BITS.items():
        rows[:, status_at] |= np.where(samples.status & flag, bits & 0xF0, 0).astype(np.uint8)
    rows[:, layout.counter] = samples.counter % 256
    rows[:, layout.counter + 1 : layout.counter + 3] = divmod(_LATENCY_US, 256)
    return _sealed(rows, layout.padding, crlf)


def encode_special(kind: str, body: bytes) -> bytes:
    """A special frame: `body` fills the bytes after the identifier, followed by zeros."""
    identifier, _, size, padding = SPECIAL_PAIRS[kind]
    row = bytes([identifier]) + body.ljust(size - 5, b"\0")
    return _sealed(np.frombuffer(row, np.uint8)[None, :], padding, crlf=False)


def encode_serial_number(serial: str) -> bytes:
    """The reply to "I": a letter and 14 digits."""
    return encode_special("serial_number", serial[:1].encode() + bytes.fromhex(serial[1:].zfill(14)))


def encode_configuration(settings: Settings) -> bytes:
    """The reply to "C" for a device with these settings that sends both clusters, all low-pass filters at 16 Hz."""
    rate = RATES_HZ.index(settings.rate_hz or 125.0) << 5
    codes = [RANGE_CODES[r] for r in settings.range_g or (10.0,) * 3]
    unit = next(code for code, name in OUTPUTS.items() if name == settings.output)
    body = bytearray(21)
    clusters = _CLUSTERS | (_TEMPERATURES if settings.temperatures else 0)
    body[0:4] = bytes([0x2D, 5, rate | clusters, BAUDS.index(921600) << 4])
    body[4], body[7], body[10] = 0x70, 0x70 | unit, 0x70
    body[16], body[17] = codes[0] << 4 | codes[1], codes[2] << 4
    return encode_special("configuration", bytes(body))


def answer(command: bytes, settings: Settings, serial: str) -> bytes:
    """The reply of the device; empty for a command without a reply."""
    replies = {
        b"I": lambda: encode_serial_number(serial),
        b"N": lambda: encode_special("part_number", bytes.fromhex("8516710000002600") + b"\x01\x00"),
        b"C": lambda: encode_configuration(settings),
        b"E": lambda: encode_special("error", b""),
        b"T": lambda: encode_special("bias_trim", b""),
    }
    return replies.get(command.strip(), lambda: b"")()

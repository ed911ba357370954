"""Bytes with known content: from real devices, manuals, and an independent CRC."""

import struct

import numpy as np
import pytest

from tumblecal.capture.decoding.checks import crc16_xmodem, exclusive_or
from tumblecal.capture.decoding.framing import decode_all
from tumblecal.capture.decoding.samples import Decoded, Settings, Status
from tumblecal.capture.protocols import protocol


TEN_G = Settings((10.0, 10.0, 10.0), "acceleration", 125.0)
_CLUSTERS = "00 01 24 ff fa d6 00 03 5b 00"
_FORCE = "ff e7 a6 ff dd 36 08 1c 52 00"
_INCLINATION = "ff 7e 70 fe ba 0c 3f fa 1d 00"
_TEMPERATURES = "23 a0 23 c0 23 a0 00", "23 19 23 0a 23 1c 00", "23 95 23 b6 23 95 00"
STIM300 = {
    # A real device's frame, with its own CRC.
    0xAF: f"af {_CLUSTERS} {_FORCE} {_INCLINATION} {' '.join(_TEMPERATURES)} ff ef 02 00 e1 01 fa c6 49 42 c6 0d 0a",
    0x93: f"93 {_CLUSTERS} {_FORCE} {_INCLINATION} e1 01 fa 57 70 66 ea",
    0x91: f"91 {_CLUSTERS} {_FORCE} e1 01 fa 04 5f f2 ed",
    0xA5: f"a5 {_CLUSTERS} {_FORCE} {_TEMPERATURES[0]} {_TEMPERATURES[1]} e1 01 fa d3 0f ee b5",
    0xA7: f"a7 {_CLUSTERS} {_FORCE} {_INCLINATION} {' '.join(_TEMPERATURES)} e1 01 fa 33 87 fc 8d",
}


def decoded(name: str, text: str, *arguments: Settings) -> Decoded:
    return decode_all(protocol(name).decoder(*arguments), bytes.fromhex(text))


@pytest.mark.parametrize("identifier", STIM300)
def test_stim300_real_values(identifier: int) -> None:
    found = decoded("stim300", STIM300[identifier], TEN_G)
    assert len(found.samples) == 1 and found.counts.discarded == 0
    np.testing.assert_array_equal(found.samples.rate[0], [0.017822265625, -0.0806884765625, 0.05242919921875])
    np.testing.assert_array_equal(
        found.samples.force[0], [-0.011890411376953125, -0.016986846923828125, 1.0138282775878906]
    )
    assert found.samples.counter[0] == 225 and found.samples.status[0] == 0
    if identifier in (0xAF, 0xA5, 0xA7):
        assert found.samples.temperature[0] == np.mean([35.09765625, 35.0390625, 35.109375])


def test_stim300_corners() -> None:
    corner = (
        "93 7f ff ff 80 00 00 ff ff ff 14 50 00 00 b0 00 00 ff ff ff 48 40 00 00 c0 00 00 00 00 01 00 "
        "ff ff ff d0 3f 42 a7"
    )
    samples = decoded("stim300", corner, TEN_G).samples
    np.testing.assert_array_equal(samples.force[0], [10.0, -10.0, -(2.0**-19)])
    np.testing.assert_array_equal(samples.rate[0], [(2**23 - 1) / 2**14, -512.0, -(2.0**-14)])
    assert samples.counter[0] == 255
    # Status 0x14 of the gyros: overload of z; 0x48 of the accelerometers: start-up and a channel error.
    assert samples.status[0] == Status.OVERLOAD | Status.STARTING | Status.ERROR


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "bc 2d 05 06 20 70 00 00 70 00 00 70 00 00 00 00 00 00 00 00 00 00 11 6b ba d2",
            {"rate_hz": 125.0, "clusters": "gai", "baud": 921600, "crlf": False, "range_g": [10.0] * 3},
        ),
        (
            "bd 2d 05 8f 30 70 00 00 70 00 00 70 00 00 00 00 00 33 30 00 00 00 a0 33 b3 80 0d 0a",
            {"rate_hz": 2000.0, "temperatures": True, "baud": 1843200, "crlf": True, "range_g": [5.0] * 3},
        ),
    ],
)
def test_stim300_configuration(text: str, expected: dict) -> None:
    (event,) = decoded("stim300", text).events
    assert event.kind == "configuration"
    assert {k: event.content[k] for k in expected} == expected


def test_stim300_never_assumes_a_range() -> None:
    assert np.isnan(decoded("stim300", STIM300[0x93]).samples.force).all()
    with_configuration = (
        "bd 2d 05 8f 30 70 00 00 70 00 00 70 00 00 00 00 00 33 30 00 00 00 a0 33 b3 80 0d 0a " + STIM300[0x93]
    )
    force = decoded("stim300", with_configuration).samples.force[0]
    np.testing.assert_allclose(force, np.array([-0.011890411376953125, -0.016986846923828125, 1.0138282775878906]) / 2)


def test_witmotion() -> None:
    burst = (
        "55 51 16 00 3D FF FA 07 CF 0A D2 55 52 00 00 00 00 00 00 CF 0A 80 "
        "55 53 1B FC 95 FF FF F9 45 38 C8 55 54 00 00 00 00 00 00 CF 0A 82"
    )
    found = decoded("witmotion", burst)
    np.testing.assert_array_equal(found.samples.force[0], [0.0107421875, -0.09521484375, 0.9970703125])
    np.testing.assert_array_equal(found.samples.rate[0], [0.0, 0.0, 0.0])
    assert found.samples.temperature[0] == 27.67
    assert (found.counts.frames, found.counts.special, found.counts.discarded) == (1, 3, 0)


XSENS_CLIPPING = (
    "FA FF 36 8B 10 20 02 FB 85 10 60 04 01 A4 98 DE 20 10 10 3F 2A 14 63 BE D7 EF A7 3C DE E5 08 3F 1D CE C9 "
    "40 20 0C C1 F2 46 C3 C1 EC E0 76 C2 8F 85 3F 40 10 0C BD 93 2C CC BD 92 0A 16 BE 3A 6E EC "
    "40 30 0C 42 51 94 64 C2 7B 5A 5A C1 CC C0 AE 80 20 0C 40 85 4D 6D C1 25 55 9E C0 90 8E 1F "
    "80 30 10 3F 7F F8 98 3B AA 9E E5 BC 53 9E C0 BB B9 06 0C C0 20 0C 3E DC 74 39 BE 75 2B 48 3F AF 9A 3F "
    "30 10 04 00 01 86 DE E0 20 04 00 48 14 01 8E"
)


def test_xsens_clipping() -> None:
    # An 8-bit sum is believed only in company: the same message three times.
    samples = decoded("xsens", " ".join([XSENS_CLIPPING] * 3)).samples
    assert len(samples) == 3 and samples.counter[0] == 64389
    np.testing.assert_allclose(samples.force[0] * 9.80665, [-30.28455162, -29.60960007, -71.76024628], rtol=1e-9)
    np.testing.assert_allclose(np.radians(samples.rate[0]), [4.16570139, -10.33340263, -4.51734877], rtol=1e-8)
    assert samples.status[0] == Status.OVERLOAD


@pytest.mark.parametrize(
    ("code", "content"),
    [
        (0, struct.pack(">3f", 0.5, -9.8125, 2.0)),
        (1, struct.pack(">3i", *(round(v * 2**20) for v in (0.5, -9.8125, 2.0)))),
        # 16.32: the fraction comes before the whole part.
        (2, struct.pack(">IhIhIh", 2**31, 0, 3 * 2**28, -10, 0, 2)),
        (3, struct.pack(">3d", 0.5, -9.8125, 2.0)),
    ],
)
def test_xsens_number_formats(code: int, content: bytes) -> None:
    body = bytes([0xFF, 0x36, len(content) + 3, 0x40, 0x20 | code, len(content)]) + content
    found = decode_all(protocol("xsens").decoder(), 3 * (b"\xfa" + body + bytes([-sum(body) % 256])))
    np.testing.assert_allclose(found.samples.force[2] * 9.80665, [0.5, -9.8125, 2.0], rtol=1e-15)


VECTORNAV = [
    "$VNACC,+00.105,-00.250,-10.148*4F",
    "$VNIMU,-00.0350,+00.4222,-00.6643,-00.015,+00.019,+09.948,+00.002066,-00.008442,-00.044656,+20.7,+084.322*66",
    "$VNYMR,+100.949,-007.330,+000.715,-00.0049,-00.2449,+00.5397,-01.258,-00.100,-09.701,"
    "-00.000018,+00.001122,-00.000551*69",
    "$VNRRG,18,+00.013,+00.354,-09.801*65",
    "$VNERR,12*72",
]


def test_vectornav_lines() -> None:
    text = "\r\n".join(VECTORNAV) + "\r\n"
    found = decode_all(protocol("vectornav").decoder(), text.encode())
    np.testing.assert_allclose(
        found.samples.force * 9.80665, [[0.105, -0.25, -10.148], [-0.015, 0.019, 9.948], [-1.258, -0.1, -9.701]]
    )
    np.testing.assert_allclose(np.radians(found.samples.rate[1]), [0.002066, -0.008442, -0.044656])
    assert found.samples.temperature[1] == 20.7
    assert [e.kind for e in found.events] == ["reply", "error"] and found.counts.discarded == 0


def sealed_line(body: str) -> bytes:
    return f"${body}*{exclusive_or(body.encode()):02X}\r\n".encode()


@pytest.mark.parametrize("name", ["VNYIA", "VNICM", "VNYBA", "VNISL", "VNISE", "VNRAW", "VNDTV"])
def test_vectornav_refuses_what_is_no_specific_force(name: str) -> None:
    """The vendor's library calls them accelerationInertial, accelerationBody (true) and so on: no sensor's reading."""
    line = sealed_line(f"{name},-170.94,+007.34,+000.70,+00.085,+00.005,-09.847,+0.0003,-0.0012,-0.0001,+1.0,+2.0,+3.0")
    found = decode_all(protocol("vectornav").decoder(), 5 * line)
    assert len(found.samples) == 0 and found.counts.special == 5 and found.counts.discarded == 0
    (refused,) = found.events
    assert refused.kind == "refused" and refused.content["text"].startswith(f"{name} has ")
    assert "VNIMU" in refused.content["text"]


def test_vectornav_binary_with_fields_of_all_groups() -> None:
    """Satellites, attitude and position beside the raw specific force: sizes after the vendor's library."""
    head = bytes([0x7D]) + b"".join(w.to_bytes(2, "little") for w in (0x0001, 0x000C, 0x2003, 0x1402, 0x0603, 0x2000))
    force, rate = np.array([0.1, -0.2, 9.8], "<f4"), np.array([0.01, 0.02, 0.03], "<f4")
    others = (8 + 8 + 28) + (12 + 28 + 12) + (2 + 24 + 4 + 4) + 28
    row = head + (5000).to_bytes(8, "little") + force.tobytes() + rate.tobytes() + bytes(others)
    found = decode_all(protocol("vectornav").decoder(), b"\xfa" + row + crc16_xmodem(row).to_bytes(2, "big"))
    np.testing.assert_allclose(found.samples.force[0] * 9.80665, force, rtol=1e-6)
    assert found.samples.counter[0] == 5000 and found.counts.discarded == 0


def test_vectornav_crc16_line() -> None:
    body = VECTORNAV[1][1:-3].encode()
    assert crc16_xmodem(body) == 0xA157 and crc16_xmodem(b"123456789") == 0x31C3
    for check, count in (("A157", 1), ("A156", 0)):
        assert len(decode_all(protocol("vectornav").decoder(), b"$%s*%s\r\n" % (body, check.encode())).samples) == count


def test_mip() -> None:
    found = decoded("mip", "75 65 80 0E 0E 04 3E 7A 63 A0 BB 8E 3B 29 7F E5 BF 7F 84 EE")
    np.testing.assert_allclose(found.samples.force[0, :2], [0.24452066, -0.00434055], rtol=1e-6)
    # The manual's own example has a NaN on the third axis: it is flagged, not averaged.
    assert np.isnan(found.samples.force[0, 2]) and found.samples.status[0] == Status.NOT_A_NUMBER


@pytest.mark.parametrize("text", ["AA 55 00 00 07 00 71 78 00", "AA 55 00 00 07 00 FE 05 01"])
def test_inertial_labs(text: str) -> None:
    counts = decoded("inertial_labs", text).counts
    assert counts.special == 1 and counts.discarded == 0

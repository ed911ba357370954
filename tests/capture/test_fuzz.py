"""A short run of the fuzz: benchmarks/fuzz_decoders.py does it with many more files."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from tumblecal.capture.decoding.framing import decode_all
from tumblecal.capture.protocols import protocol, protocols


_SCRIPT = Path(__file__).parents[2] / "benchmarks" / "fuzz_decoders.py"
_SPEC = importlib.util.spec_from_file_location("fuzz_decoders", _SCRIPT)
assert _SPEC is not None and _SPEC.loader is not None
fuzz = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(fuzz)


@pytest.mark.parametrize("files", [70, pytest.param(280, marks=pytest.mark.long)])
def test_hostile_files_of_all_protocols(files: int) -> None:
    tried = fuzz.run(files=files, seed=20)
    assert all(tried[f"{name} files"] == files // 7 and tried[f"{name} samples"] > 0 for name in protocols())


def xsens(*fields: tuple[int, bytes]) -> bytes:
    payload = b"".join(name.to_bytes(2, "big") + bytes([len(content)]) + content for name, content in fields)
    body = bytes([0xFF, 0x36, len(payload)]) + payload
    return b"\xfa" + body + bytes([-sum(body) % 256])


FORCE = np.array([0.5, -1.0, 9.75], ">f4").tobytes()


@pytest.mark.parametrize("size", [1, 11, 94])
@pytest.mark.parametrize("name", [0x7010, 0x4010, 0x8020, 0x0810, 0x1020, 0xE020, 0x4041])
def test_xsens_fields_that_do_not_fit_are_skipped(name: int, size: int) -> None:
    message = xsens((name, bytes(range(size))), (0x4020, FORCE))
    found = decode_all(protocol("xsens").decoder(), 5 * message)
    np.testing.assert_allclose(found.samples.force * 9.80665, np.tile([0.5, -1.0, 9.75], (5, 1)))
    assert found.counts.discarded == 0


def test_an_xsens_force_that_does_not_fit_is_told() -> None:
    found = decode_all(protocol("xsens").decoder(), 5 * xsens((0x4020, FORCE[:7])))
    assert len(found.samples) == 0
    assert [e.content["text"] for e in found.events if e.kind == "refused"] == [
        "a specific force 0x4020 of 7 bytes does not fit its number format: not read"
    ]


def test_frames_of_one_size_and_another_content_are_not_mixed_up() -> None:
    """The field lengths end early in the first packet; the second is whole."""

    def packet(payload: bytes) -> bytes:
        body = b"\x75\x65\x80" + bytes([len(payload)]) + payload
        running = np.cumsum(np.frombuffer(body, np.uint8), dtype=np.int64)
        return body + bytes([int(running[-1] % 256), int(running.sum() % 256)])

    broken, whole = packet(b"\x00\x04" + FORCE), packet(b"\x0e\x04" + FORCE)
    found = decode_all(protocol("mip").decoder(), broken + whole + broken + whole)
    assert len(found.samples) == 2

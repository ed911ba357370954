"""The record log: whole or absent, whatever happens to its end or its middle."""

from contextlib import closing
from pathlib import Path

import numpy as np

from tumblecal.capture.log import LogReader, LogWriter, RecordKind, read_log


def write(path: Path, payloads: list[bytes]) -> list[int]:
    writer = LogWriter(path)
    stops = [writer.append(RecordKind.BYTES, payload, 1000 + k) for k, payload in enumerate(payloads)]
    writer.close()
    return stops


def test_every_torn_tail_is_cut(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    payloads = [bytes([k]) * (17 * k + 1) for k in range(6)]
    stops = write(path, payloads)
    whole = path.read_bytes()
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        kept = sum(stop <= length for stop in stops)
        writer = LogWriter(path)
        assert writer.position == ([0, *stops][kept]) and writer.cut == length - writer.position
        writer.append(RecordKind.EVENT, b"after", 5)
        writer.close()
        assert [r.payload for r in read_log(path)] == [*payloads[:kept], b"after"]


def test_damage_in_the_middle_costs_only_that_record(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    payloads = [bytes([65 + k]) * 50 for k in range(5)]
    stops = write(path, payloads)
    random = np.random.default_rng(0)
    whole = path.read_bytes()
    for _ in range(200):
        data = bytearray(whole)
        at = int(random.integers(len(data)))
        data[at] ^= 1 << int(random.integers(8))
        path.write_bytes(data)
        hit = sum(stop <= at for stop in stops)
        with closing(LogReader(path)) as reader:
            found = [r.payload for r in reader.records()]
        assert found == payloads[:hit] + payloads[hit + 1 :]
        if hit < 4:
            assert reader.damaged == [([0, *stops][hit], stops[hit])]

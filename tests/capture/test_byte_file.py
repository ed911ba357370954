"""Byte logs made elsewhere: decoded in pieces, written whole or not at all, refused in words."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from streams import some_samples

from tumblecal.capture.decoding import byte_file
from tumblecal.capture.decoding.byte_file import decode_file, pieces_of
from tumblecal.capture.decoding.framing import decode_all
from tumblecal.capture.decoding.samples import Settings, Stated, blank
from tumblecal.capture.log import LogWriter, RecordKind
from tumblecal.capture.protocols import protocol
from tumblecal.capture.protocols.stim300 import encode, encode_configuration
from tumblecal.ground.errors import InputError


TEN_G = Settings((10.0,) * 3, "acceleration", 125.0)


def stim300(n: int, seed: int = 0) -> bytes:
    samples = some_samples(n, seed)
    samples.counter[:] *= 16
    return encode(samples, TEN_G)


def test_decoding_files(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(stim300(300))
    found = decode_file(tmp_path / "a.bin")
    assert found.protocol.name == "stim300" and "do not guess" in found.statistics()
    assert decode_file(tmp_path / "a.bin", "stim300", stated=Stated(range_g=10.0)).samples == 300
    with pytest.raises(InputError, match="range of stim300; its ranges: 5, 10, 30, 80"):
        decode_file(tmp_path / "a.bin", stated=Stated(range_g=11.0))
    with pytest.raises(InputError, match=r"must end in \.csv or \.parquet"):
        decode_file(tmp_path / "a.bin", out=tmp_path / "a.txt")


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_pieces_give_what_the_whole_gives(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str) -> None:
    """Range and rate come in the middle, a gap and a reply before: as if everything had been known at once."""
    monkeypatch.setattr(byte_file, "_PIECE", 2000)
    first, second = stim300(400), stim300(800)
    data = first[: 38 * 100] + first[38 * 103 :] + encode_configuration(TEN_G) + second[38 * 401 :]
    (tmp_path / "a.bin").write_bytes(data)
    found = decode_file(tmp_path / "a.bin", out=tmp_path / f"a{suffix}")
    whole = decode_all(protocol("stim300").decoder(TEN_G), data).samples
    table = pl.read_csv(tmp_path / f"a{suffix}") if suffix == ".csv" else pl.read_parquet(tmp_path / f"a{suffix}")
    np.testing.assert_allclose(table.select("ax_g", "ay_g", "az_g").to_numpy(), whole.force, atol=1e-15)
    np.testing.assert_array_equal(table["counter"], whole.counter)
    np.testing.assert_allclose(table["time_s"], np.arange(len(whole)) / 125.0)
    assert found.samples == len(whole) and found.rate_hz == 125.0
    assert found.losses().startswith("lost by the counter: 3 in 1 gaps, 1 replaced")
    mean, sd = whole.force.mean(0), whole.force.std(0) * 1e3
    assert " ".join(f"{v:+.6f}" for v in mean) in found.statistics()
    assert " ".join(f"{v:.3f}" for v in sd) in found.statistics()


# The peak of this program's own memory (getrusage would tell that of the process which started it, too).
_PEAK = "[print(line.split()[1]) for line in open('/proc/self/status') if line.startswith('VmHWM')]"


def printed_and_peak_kb(code: str, *arguments: Path) -> tuple[str, int]:
    command = [sys.executable, "-c", f"import sys\nfrom pathlib import Path\n{code}\n{_PEAK}", *map(str, arguments)]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return printed, int(printed.split()[-1])


_DECODE = """from tumblecal.capture.decoding.samples import Stated
from tumblecal.cli.commands.decode import decode
decode(Path(sys.argv[1]), protocol="stim300", stated=Stated(range_g=10.0), out=Path(sys.argv[2]))"""


@pytest.mark.long
def test_memory_does_not_grow_with_the_file(tmp_path: Path) -> None:
    """11 MB more of the log: as arrays they would take 60 MB; what is under way between reading and writing takes 30 MB."""
    n, peaks = 60_000, []
    samples = blank(n)
    samples.force[:] = samples.rate[:] = 0.1
    data = encode(samples, TEN_G)
    for times in (1, 6):
        (tmp_path / "a.bin").write_bytes(data * times)
        peaks.append(printed_and_peak_kb(_DECODE, tmp_path / "a.bin", tmp_path / f"{times}.parquet")[1])
        assert pl.scan_parquet(tmp_path / f"{times}.parquet").select(pl.len()).collect().item() == times * n
    assert peaks[1] - peaks[0] < 45_000


@pytest.mark.long
def test_sniff_reads_the_beginning_only(tmp_path: Path) -> None:
    with (tmp_path / "a.bin").open("wb") as file:
        file.write(stim300(40_000))
        file.truncate(600 << 20)
    code = "from tumblecal.cli.commands.sniff import sniff\nsniff(sys.argv[1])"
    printed, peak_kb = printed_and_peak_kb(code, tmp_path / "a.bin")
    assert peak_kb < 300_000
    assert "stim300: 100% of the bytes, 27594 samples" in printed


def test_raw_log_of_a_capture(tmp_path: Path) -> None:
    data = stim300(500)
    log = LogWriter(tmp_path / "raw.log")
    for at in range(0, len(data), 1000):
        log.append(RecordKind.BYTES, data[at : at + 1000], at)
        log.append(RecordKind.EVENT, b"{}", at)
    log.close()
    assert b"".join(pieces_of(tmp_path / "raw.log")) == data
    assert decode_file(tmp_path / "raw.log").samples == 500

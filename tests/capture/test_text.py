"""Lines of numbers as boards print them: names are required, checks are required once seen, nonsense is refused."""

import numpy as np
import pytest

from tumblecal.capture.decoding.checks import exclusive_or
from tumblecal.capture.decoding.framing import decode_all
from tumblecal.capture.decoding.samples import Decoded, Settings, Status
from tumblecal.capture.protocols.text import TextDecoder
from tumblecal.ground.errors import InputError


def decoded(lines: list[str], ending: str = "\r\n") -> Decoded:
    return decode_all(TextDecoder(Settings(whole=True)), "".join(line + ending for line in lines).encode())


# Lines with {k} and {j} (k modulo 7), what is learned of them, and the force in g that line 5 states.
LAYOUTS = {
    "a six-axis board": (
        ["ax ay az gx gy temp", "{j} -50 16384 5 -3 21"],
        {"unit": "LSB 16384/g", "columns": ("ax", "ay", "az", "gx", "gy", "t"), "unprotected": True, "separator": " "},
        [5 / 16384, -50 / 16384, 1],
    ),
    "tabs, a leading word and a header": (
        ["MPU ready", "a/g:\tax\tay\taz", "a/g:\t0.0{j}\t0.02\t9.81"],
        {"separator": "\t", "unit": "m/s2"},
        [0.05 / 9.80665, 0.02 / 9.80665, 9.81 / 9.80665],
    ),
    "counter, time and temperature": (
        ["seq, t_ms, ax, ay, az, temp", "{k}, {k}08, 12, -7, 1001, 25.{j}"],
        {"columns": ("counter", "time", "ax", "ay", "az", "t"), "unit": "mg"},
        [0.012, -0.007, 1.001],
    ),
    "decimal commas": (
        ["ax;ay;az", "0,0{j};-0,981;0,10"],
        {"separator": ";", "decimal_comma": True, "unit": "g"},
        [0.05, -0.981, 0.1],
    ),
    "names of recordings": (
        [
            "Timestamp (ms);Acceleration X [g];Acceleration Y [g];Acceleration Z [g];Temperatur;LinAccX",
            "{k};1;0.2;1.{j};21.5;0",
        ],
        {"columns": ("time", "ax", "ay", "az", "t", "-"), "unit": "g"},
        [1, 0.2, 1.5],
    ),
}


@pytest.mark.parametrize("name", LAYOUTS)
def test_layouts_are_learned(name: str) -> None:
    (*above, row), layout, force = LAYOUTS[name]
    found = decoded([*above, *(row.format(k=k, j=k % 7) for k in range(40))])
    content = found.events[0].content
    assert len(found.samples) == 40 and {key: content[key] for key in layout} == layout
    np.testing.assert_allclose(found.samples.force[5], force)
    if "counter" in name:
        np.testing.assert_array_equal(found.samples.counter, np.arange(40))
        assert found.samples.temperature[0] == 25.0


def test_columns_without_names_are_asked_for_and_never_guessed() -> None:
    text = [f"{k},{k}08,12,-7,1001,25.{k % 7}" for k in range(40)]
    found = decoded(text)
    assert len(found.samples) == 0 and found.counts.special == 40 and found.counts.discarded == 0
    (words,) = (event.content["text"] for event in found.events if event.kind == "refused")
    assert "give --columns counter,time,ax,ay,az,- --unit 'mg'" in words
    pasted = TextDecoder(Settings(columns="counter,time,ax,ay,az,-", unit="mg", whole=True))
    assert len(decode_all(pasted, "".join(f"{line}\n" for line in text).encode()).samples) == 40


def with_check(body: str) -> str:
    return f"${body}*{exclusive_or(body.encode()):02X}"


def test_checks_are_required_once_seen() -> None:
    lines = ["seq,ax,ay,az", *(with_check(f"IMU,{k},0.01,0.02,9.80{k % 10}") for k in range(60))]
    lines[31] = lines[31].replace("9.80", ".80")
    lines[41] = "IMU,40,0.01,0.02,9.800"
    found = decoded(lines)
    assert not found.events[0].content["unprotected"]
    assert len(found.samples) == 58 and found.counts.check_failures == 2 and found.counts.resyncs == 2
    assert np.abs(found.samples.force[:, 2] * 9.80665 - 9.8045).max() < 0.01


@pytest.mark.parametrize(("word", "at"), [("nan", 0), ("-inf", 1), ("ovf", 2)])
def test_a_line_without_a_number_is_a_sample_that_counts_as_bad(word: str, at: int) -> None:
    """A third of all lines: left out they were no loss, and no samples at all where the protocol is to be guessed."""
    words = ["0.0", "0.1", "1.0"]
    words[at] = word
    rows = [",".join(words) if k % 3 == 1 else "0.0,0.1,1.0" for k in range(90)]
    found = decoded(["ax,ay,az", *rows])
    assert len(found.samples) == 90 and found.counts.discarded == found.counts.resyncs == 0
    assert np.flatnonzero(found.samples.status == Status.NOT_A_NUMBER).tolist() == list(range(1, 90, 3))
    assert np.isnan(found.samples.force[1]).tolist() == [k == at for k in range(3)]


def test_the_cut_first_line_of_a_port_is_dropped() -> None:
    data = "".join(f"{k % 3},-2,1000\n" for k in range(60)).encode()[3:]
    found = decode_all(TextDecoder(Settings(columns="ax,ay,az")), data)
    assert len(found.samples) == 59 and found.samples.force[0].tolist() == [0.001, -0.002, 1.0]


def test_given_layout() -> None:
    with pytest.raises(InputError, match="give ax, ay and az"):
        TextDecoder(Settings(columns="ax,ay"))
    with pytest.raises(InputError, match="unit"):
        TextDecoder(Settings(columns="ax,ay,az", unit="stone"))
    found = decode_all(TextDecoder(Settings(columns="-,az,ay,ax", unit="mg", whole=True)), b"7 1000 0 1\n8 1000 0 2\n")
    assert found.samples.force.tolist() == [[0.001, 0.0, 1.0], [0.002, 0.0, 1.0]]


TURNED = ["ax,ay,az"] + ["0.1,0.2,0.97"] * 40 + ["az [mg],ay [mg],ax [mg]"] + ["970,200,100"] * 30 + ["0.5,0.5,0.7"]


def test_each_header_holds_from_its_line_on() -> None:
    found = decoded(TURNED)
    layouts = [e for e in found.events if e.kind == "layout"]
    assert [e.content["columns"] for e in layouts] == [("ax", "ay", "az"), ("az", "ay", "ax")]
    assert [e.content["unit"] for e in layouts] == ["g", "mg"]
    np.testing.assert_allclose(found.samples.force[:-1], np.tile([0.1, 0.2, 0.97], (70, 1)))
    # Said with the place: the second layout begins at the line that names it.
    first = sum(len(line) + 2 for line in TURNED[:42])
    assert layouts[1].stop == first and (found.samples.stop[40:] > first).all()


def test_an_overlong_line_costs_no_other() -> None:
    lines = ["ax,ay,az", *["1,2,1000"] * 40]
    data = ("\n".join(lines) + "\n" + "9" * 3000 + "\n" + "1,2,1000\n" * 5 + "7" * 2000).encode()
    whole = decode_all(TextDecoder(Settings(whole=True)), data)
    assert len(whole.samples) == 45 == len(decode_all(TextDecoder(Settings(whole=True)), data, chunk=500).samples)
    assert whole.counts.discarded == 3001 + 2000

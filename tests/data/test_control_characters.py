"""No control character of a file, a device, a recording or the command line reaches a terminal, a page or an XML file."""

import json
import re
import unicodedata
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import polars as pl
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tumblecal.capture.decoding.samples import Event
from tumblecal.capture.port.transport import Identity
from tumblecal.data import read_positions, write_positions
from tumblecal.data.raw import opened_raw, read_raw
from tumblecal.ground.atomic import write_text
from tumblecal.ground.errors import InputError
from tumblecal.ground.json_file import read_json
from tumblecal.ground.strict_toml import read_toml
from tumblecal.recordings.table import Table


TURNING = {"LRE", "RLE", "PDF", "LRO", "RLO", "LRI", "RLI", "FSI", "PDI"}  # Unicode TR 9


def is_control(letter):
    """By Unicode's own tables: controls but for ends of lines and tabs, and what turns the direction of a text."""
    return (unicodedata.category(letter) in ("Cc", "Zl", "Zp") and letter not in "\t\n\r") or (
        unicodedata.bidirectional(letter) in TURNING
    )


CONTROLS = [chr(code) for code in range(0x10000) if is_control(chr(code))]
TEXTS = st.text(st.characters(exclude_categories=("Cs",)), max_size=8)
HOSTILE = st.tuples(TEXTS, st.sampled_from(CONTROLS), TEXTS).map("".join)
SETTINGS = settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture])
READERS = {
    "comment": lambda path, text: read_positions(csv(path, comment=text)),
    "key of a comment": lambda path, text: read_positions(csv(path, key=text)),
    "position": lambda path, text: read_positions(csv(path, position=text)),
    "run": lambda path, text: read_positions(csv(path, run=text)),
    "column": lambda path, text: read_positions(csv(path, column=text)),
    "comment of samples": lambda path, text: read_raw(csv(path, comment=text)),
    "label of samples": lambda path, text: read_raw(csv(path, position=text)),
    "Parquet comment": lambda path, text: read_positions(parquet(path, {"serial_number": text})),
    "Parquet position": lambda path, text: read_positions(parquet(path, position=text)),
    "Parquet label": lambda path, text: read_raw(parquet(path, position=text)),
    "Parquet column": lambda path, text: opened_raw(parquet(path, column=text)),
    "TOML": lambda path, text: read_toml(written(path, f"title = {json.dumps(text)}\n")),
    "TOML key": lambda path, text: read_toml(written(path, f"[{json.dumps(text)}]\nvalue = 1\n")),
    "JSON": lambda path, text: read_json(written(path, json.dumps({"a": [{"serial": text}]}))),
    "JSON key": lambda path, text: read_json(written(path, json.dumps({text: 1}, ensure_ascii=False))),
}


def written(path, text):
    path.write_text(text, encoding="utf-8", newline="")
    return path


def csv(path, comment="A-17", key="serial_number", position="p1", run="1", column="operator"):
    head = f"# {key}: {comment}\nposition,run,alpha_deg,beta_deg,ax_g,ay_g,az_g,{column}\n"
    return written(path, f"{head}{position},{run},0,0,0.0,0.0,1.0,\np2,1,90,0,0.0,1.0,0.0,\n")


def parquet(path, metadata=None, position="p1", column="operator"):
    path = path.with_suffix(".parquet")
    columns = {"position": [position, "p2"], "alpha_deg": [0.0, 90.0], "beta_deg": [0.0, 0.0]}
    columns |= {"ax_g": [0.0, 0.0], "ay_g": [0.0, 1.0], "az_g": [1.0, 0.0], column: ["a", "b"]}
    pl.DataFrame(columns).write_parquet(path, metadata=metadata or {})
    return path


@pytest.mark.parametrize("reader", READERS.values(), ids=READERS)
@given(text=HOSTILE)
@SETTINGS
def test_files_with_control_characters_are_refused_in_plain_lines(tmp_path, reader, text):
    with pytest.raises(InputError) as refused:
        reader(tmp_path / "file.csv", text)
    for fault in refused.value.faults:
        assert not any(map(is_control, fault)) and "\n" not in fault


@given(text=st.one_of(TEXTS, HOSTILE))
@SETTINGS
def test_what_devices_and_recordings_say_is_kept_with_escapes(text):
    said = [
        *(Event(0, "reply", {"text": text}).content.values()),
        str(Identity("/dev/ttyUSB0", serial_number=text, description=text).serial_number),
    ]
    table = Table(text, ("ax", text), lambda names: iter(()), stated={text: text}, words=text).plain()
    said += [table.name, *table.columns, *table.stated, *table.stated.values(), table.words]
    for one in said:
        assert not any(map(is_control, one))
    if not any(map(is_control, text)) and "\ufeff" not in text and "\ufffe" not in text and "\uffff" not in text:
        assert table.name == text.replace("\u200e", r"\u200e").replace("\u200f", r"\u200f").replace("\u061c", r"\u061c")


@given(text=st.one_of(TEXTS, HOSTILE))
@SETTINGS
def test_whatever_is_written_as_text_has_none_and_xml_parses(tmp_path, text):
    """The second fence: what did not come through a reader, such as a set made in Python."""
    root = ElementTree.Element("dcc", serial=text)
    root.text = text
    write_text(tmp_path / "dcc.xml", ElementTree.tostring(root, encoding="unicode"))
    content = (tmp_path / "dcc.xml").read_text(encoding="utf-8")
    assert not any(map(is_control, content)) and ElementTree.parse(tmp_path / "dcc.xml").getroot().tag == "dcc"


def test_a_serial_number_that_a_terminal_would_obey_is_refused_before_anything_is_written(tumblecal, tmp_path, table1):
    write_positions(tmp_path / "good.csv", replace(table1, comments={"serial_number": "A-17"}))
    text = (tmp_path / "good.csv").read_text()
    (tmp_path / "bad.csv").write_text(text.replace("A-17", "A\x1b[31m17"))
    outcome = tumblecal("calibrate", tmp_path / "bad.csv", "--out", tmp_path / "out")
    assert outcome.code == 2 and not (tmp_path / "out").exists()
    assert re.fullmatch(
        r"tumblecal: \S*bad.csv:line 1, column \d+: a control character \(\\x1b\); remove it", *outcome.lines
    )
    for word in ("A\x1b17", "A\u202e17", "A\n17", "A\x9b17"):
        outcome = tumblecal("history", tmp_path / "lab.db", word)
        assert outcome.code == 2 and not any(is_control(c) for line in outcome.lines for c in line)
        assert "has control characters" in outcome.lines[0] and len(outcome.lines) == 1
    assert not Path(tmp_path / "lab.db").exists()

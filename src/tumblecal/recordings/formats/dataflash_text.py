"""ArduPilot's dataflash logs as text (.log): messages of many kinds in one file, whose FMT lines name their fields.

Fields and their units: ArduPilot's documentation of log messages (IMU: rad/s, m/s^2 and degC; times in microseconds or
milliseconds). A message with an instance `I` is a table for each instance.
"""

import re

from tumblecal.data.line_form import LineForm
from tumblecal.data.text_cells import pieces_of
from tumblecal.data.text_layout import TextLayout
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import shown
from tumblecal.recordings.formats.already_corrected import ardupilot_correction
from tumblecal.recordings.formats.dataflash import FORCE, ROLES, instance_of
from tumblecal.recordings.formats.text import text_table
from tumblecal.recordings.table import Reader, Source, Table


_FORMAT = re.compile(rb"^FMT, *\d+, *\d+, *(\w+), *\w+, *([\w,]+)", re.MULTILINE)
# A parameter follows the time, which older logs do not have.
_CORRECTION = re.compile(rb"^PARM,(?:[^,\n]*,)? *INS_TCAL(\d)_ENABLE, *1(?:\.0*)? *(?:[,\r\n]|$)", re.MULTILINE)


def _read(source: Source) -> list[Table]:
    fields, found, enabled = dict[bytes, list[bytes]](), dict[tuple[bytes, bytes], None](), set[int]()
    for piece in pieces_of(source.path):
        fields |= {name: names.split(b",") for name, names in _FORMAT.findall(piece)}
        enabled |= {*map(int, _CORRECTION.findall(piece))}
        for name in fields:
            if {*map(bytes.decode, fields[name])} >= FORCE:
                instances = {*re.findall(_message(name, fields[name], rb"(\d+)"), piece, re.MULTILINE)}
                found |= {(name, instance): None for instance in sorted(instances)}
    if not found:
        raise InputError(f"{source.path}: no accelerations among its messages {shown(b', '.join(fields).decode())}")
    return [_table(source, name, fields[name], instance, enabled) for name, instance in found]


def _message(name: bytes, fields: list[bytes], instance: bytes) -> bytes:
    """The pattern of a message to its instance; messages without one have the instance ""."""
    before = rb"(?:[^,\n]*,){%d} *%s," % (fields.index(b"I"), instance) if b"I" in fields else b"()"
    return b"^%s,%s" % (name, before)


def _table(source: Source, name: bytes, fields: list[bytes], instance: bytes, enabled: set[int]) -> Table:
    names, title = tuple(map(bytes.decode, fields)), name.decode()
    others = b"^(?!%s).*$" % _message(name, fields, instance)[1:]
    form = LineForm(re.compile(b"^%s, *" % name, re.MULTILINE), b"", names, re.compile(others, re.MULTILINE))
    layout = TextLayout(source.path, names, ",", ("",) * len(names), None, 1, form)
    stated = ardupilot_correction(enabled, int(instance) if instance else instance_of(title))
    return text_table(source, layout, stated, f"{title}[{instance.decode()}]" if instance else title, ROLES)


READER = Reader("ArduPilot dataflash text", lambda path, head: bool(_FORMAT.search(head[:8192])), _read, rank=1)

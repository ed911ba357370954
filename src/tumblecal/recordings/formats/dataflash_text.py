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
from tumblecal.recordings.formats.dataflash import FORCE, ROLES
from tumblecal.recordings.formats.text import text_table
from tumblecal.recordings.table import Reader, Source, Table


_FORMAT = re.compile(rb"^FMT, *\d+, *\d+, *(\w+), *\w+, *([\w,]+)", re.MULTILINE)

# A parameter follows the time, which older logs do not have.
_CORRECTION = re.compile(rb"^PARM,(?:[^,\n]*,)? *INS_TCAL(\d)_ENABLE, *1(?:\.0*)? *(?:[,\r\n]|$)", re.MULTILINE)


def _read(source: Source) -> list[Table]:
    fields, instances, enabled = dict[str, list[str]](), dict[str, set[str]](), set[int]()
    for piece in pieces_of(source.path):
        fields |= {name.decode(): names.decode().split(",") for name, names in _FORMAT.findall(piece)}
        enabled |= {int(number) for number in _CORRECTION.findall(piece)}
        for name, names in fields.items():
            if set(names) >= FORCE and (found := {*re.findall(_begin(name, names), piece, re.MULTILINE)}):
                instances.setdefault(name, set()).update(map(bytes.decode, found))
    if not instances:
        raise InputError(f"{source.path}: no accelerations among its messages {shown(', '.join(fields))}")
    return [
        _table(source, name, fields[name], instance, enabled)
        for name in fields.keys() & instances.keys()
        for instance in sorted(instances[name])
    ]


def _begin(name: str, fields: list[str]) -> bytes:
    """The pattern of the start of a message, with its instance as a group."""
    before = rb"(?:[^,\n]*,){%d} *(\d+)," % fields.index("I") if "I" in fields else b"()"
    return b"^%s,%s" % (name.encode(), before)


def _table(source: Source, name: str, fields: list[str], instance: str, enabled: set[int]) -> Table:
    others = rb"^(?!%s,).*$" % name.encode()
    if instance:
        others += rb"|%s.*$" % _begin(name, fields).replace(rb"(\d+)", rb"(?!%s,)\d+" % instance.encode())
    form = LineForm(
        re.compile(rb"^%s, *" % name.encode(), re.MULTILINE), b"", tuple(fields), re.compile(others, re.MULTILINE)
    )
    layout = TextLayout(source.path, tuple(fields), ",", ("",) * len(fields), None, 1, form)
    number = int(instance) if instance else int(name[-1]) - 1 if name[-1].isdigit() else 0
    stated = ardupilot_correction(enabled, number)
    return text_table(source, layout, stated, f"{name}[{instance}]" if instance else name, ROLES)


READER = Reader("ArduPilot dataflash text", lambda path, head: bool(_FORMAT.search(head[:8192])), _read, rank=1)

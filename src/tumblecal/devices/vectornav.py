"""VectorNav, register 25 (acceleration compensation): `C (A - B)`, m/s^2, in float32, as ASCII commands."""

import re

import numpy as np

from tumblecal.devices.target import Export, Numbers, Target
from tumblecal.ground.errors import InputError


def _vectornav(export: Export) -> str:
    values = [*export.calibration.matrix.ravel(), *export.bias_ms2]
    # In the format of the library of the manufacturer; the registers are float32.
    commands = ["VNWRG,25," + ",".join(f"{value:+.6f}" for value in values), "VNWNV"]
    return "".join(f"${command}*{_checksum(command):02X}\r\n" for command in commands)


def _read_vectornav(text: str, gravity_ms2: float) -> Numbers:
    command = re.search(r"\$(VN[RW]RG,25,([^*\r\n]*))\*([0-9A-Fa-f]{2})", text)
    if command is None:
        raise InputError("no $VNWRG,25 or $VNRRG,25 with its checksum")
    if int(command[3], 16) != _checksum(command[1]):
        raise InputError(
            f"the checksum of register 25 is {command[3]}, not {_checksum(command[1]):02X}: the line was changed; read the "
            "register again"
        )
    try:
        values = np.array([float(word) for word in command[2].split(",")])
    except ValueError as error:
        raise InputError(f"register 25: {error}") from error
    if len(values) != 12 or not np.all(np.isfinite(values)):
        raise InputError(f"register 25: {len(values)} numbers; there must be 12")
    return Numbers(values[:9].reshape(3, 3), values[9:] / gravity_ms2)


def _checksum(command: str) -> int:
    """Exclusive or of all bytes between $ and *."""
    total = 0
    for byte in command.encode("ascii", "replace"):
        total ^= byte
    return total


TARGETS = (
    Target(
        "vectornav",
        ".txt",
        "register 25: C (A - B), m/s^2",
        _vectornav,
        _read_vectornav,
        frozenset({"cross terms", "bias"}),
        "VectorNav manuals, register 25",
        ("It is applied after the factory calibration: record the readings with a neutral register 25.",),
    ),
)

"""The serial port behind a few functions; the only module that uses pyserial.

Reads never wait: one read returns the available bytes, so nothing is lost if it fails, and the reader decides how often.
"""

import contextlib
import errno
import fcntl
import os
import termios
from dataclasses import dataclass, replace
from pathlib import Path

import serial
from serial.tools import list_ports

from tumblecal.ground.errors import InputError
from tumblecal.ground.plain_text import plain


_READ_BYTES = 65536


@dataclass(frozen=True)
class Identity:
    """The identity of a device: USB ids if there are any, otherwise the path by which it was opened."""

    url: str
    vendor: int | None = None
    product: int | None = None
    serial_number: str | None = None
    description: str | None = None

    def __post_init__(self) -> None:
        # The description of a device on the bus is shown and recorded.
        for name in ("serial_number", "description"):
            if value := getattr(self, name):
                object.__setattr__(self, name, plain(value))

    def same_unit(self, other: "Identity") -> bool:
        """Whether both are the same adapter: by the ids if both have them, otherwise by the path."""
        if self.vendor is not None and other.vendor is not None:
            return (self.vendor, self.product, self.serial_number) == (
                other.vendor,
                other.product,
                other.serial_number,
            )
        return self.url == other.url


def available() -> list[Identity]:
    """All serial devices of this machine, by stable name if there is one."""
    stable = {str(p.resolve()): str(p) for p in Path("/dev/serial/by-id").glob("*")}
    return [
        Identity(stable.get(p.device, p.device), p.vid, p.pid, p.serial_number, p.description)
        for p in sorted(list_ports.comports())
    ]


class Port:
    """An open serial port, for this process alone.

    **Arguments:**

    - `url`: device path, or any address pyserial understands (`socket://host:port`).
    - `baud`: bits per second.

    **Raises:** `InputError` with the reason in one line if the port cannot be opened.
    """

    identity: Identity

    def __init__(self, url: str, baud: int):
        native = "://" not in url
        user = _terminal_of(Path(url)) if native else None
        if user is not None:
            raise InputError(f"port {url}: this is the terminal of {user}, not an instrument; see `tumblecal ports`")
        try:
            self._serial = serial.serial_for_url(url, do_not_open=True, baudrate=baud, timeout=0, write_timeout=1)
            if native:
                self._serial.exclusive = True
            self._serial.open()
        except (OSError, ValueError, serial.SerialException) as error:
            raise InputError(_why_not(url, baud, error)) from error
        real = os.path.realpath(url)
        units = (unit for unit in available() if os.path.realpath(unit.url) == real)
        self.identity = replace(next(units, Identity(url)), url=url)
        if native:
            # The kernel removes this mark at the last close. The other end of a virtual port keeps it open, so the mark
            # would remain after its recorder ended; there the lock of the file is used instead.
            if not real.startswith("/dev/pts/"):
                with contextlib.suppress(OSError):
                    fcntl.ioctl(self._serial.fileno(), termios.TIOCEXCL)
            with contextlib.suppress(OSError, ValueError, AttributeError, NotImplementedError):
                self._serial.set_low_latency_mode(True)

    def read(self) -> bytes:
        """The bytes that have arrived, without waiting; empty for none.

        **Raises:** `OSError` if the device is disconnected.
        """
        try:
            return self._serial.read(_READ_BYTES)
        except TypeError as error:
            raise OSError("port closed") from error

    def write(self, data: bytes) -> None:
        """Send a command.

        **Raises:** `OSError` if the device is disconnected or accepts nothing for a second.
        """
        self._serial.write(data)

    def close(self) -> None:
        """Close, even if the device is already disconnected."""
        with contextlib.suppress(OSError, TypeError):
            self._serial.close()


def _why_not(url: str, baud: int, error: Exception) -> str:
    path, text, number = Path(url), str(error), getattr(error, "errno", None)
    words = (
        f"the driver does not support {baud} baud ({text})"
        if isinstance(error, ValueError)
        else f"cannot be opened ({text})"
    )
    if "://" in url:
        return f"port {url}: {words}"
    if not path.exists():
        names = ", ".join(i.url for i in available()) or "none found"
        words = f"there is no such device; plug it in, or use one of: {names} (`tumblecal ports`)"
    elif not path.is_char_device():
        words = "this is not a serial device"
    elif number in (errno.EPERM, errno.EACCES) or "Permission" in text:
        group = path.stat().st_gid
        with contextlib.suppress(KeyError):
            group = path.group()
        words = f"no permission; the device belongs to the group {group}: `sudo usermod -aG {group} $USER`, then log in again"
    elif number in (errno.EAGAIN, errno.EBUSY) or "lock" in text.lower() or "busy" in text.lower():
        words = f"in use by {holder_of(path) or 'another program'}; end it first"
    return f"port {url}: {words}"


def _terminal_of(path: Path) -> str | None:
    """Program and process number of the process with this device as its controlling terminal (proc(5): stat, tty_nr)."""
    for process in Path("/proc").glob("[0-9]*") if path.is_char_device() else ():
        with contextlib.suppress(OSError):
            name, fields = (process / "stat").read_text().split("(", 1)[1].rsplit(")", 1)
            if int(fields.split()[4]) == path.stat().st_rdev:
                return f"{name} (process {process.name})"
    return None


def holder_of(path: Path) -> str | None:
    """Program and process number of the process that locked the device, or has it open, if visible to this user."""
    real, openers, lockers = os.path.realpath(path), list[Path](), list[str]()
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if any(os.readlink(fd) == real for fd in (process / "fd").iterdir()) and int(process.name) != os.getpid():
                openers.append(process)
    with contextlib.suppress(OSError):
        # proc(5), locks: the fifth field is the process, the sixth ends with the inode.
        locks = map(str.split, Path("/proc/locks").read_text().splitlines())
        lockers = [lock[4] for lock in locks if lock[5].endswith(f":{path.stat().st_ino}")]
    for process in sorted(openers, key=lambda process: process.name not in lockers):
        with contextlib.suppress(OSError):
            return f"{(process / 'comm').read_text().strip()} (process {process.name})"
    return None

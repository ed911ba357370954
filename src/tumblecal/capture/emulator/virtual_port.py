"""The virtual cable: a pseudo-terminal with a fixed name, which can be unplugged and plugged in again."""

import contextlib
import os
import time
import tty
from pathlib import Path

from tumblecal.ground.errors import InputError


# Size of a real driver's buffer; bytes that do not fit are lost, as in reality.
_BUFFER_BYTES = 1 << 20
_UNREAD_S = 1.0


class VirtualPort:
    """A pseudo-terminal reachable at `link`.

    **Arguments:**

    - `link`: a name in the file system; created, and moved when the port is plugged in again.

    **Raises:** `InputError` if `link` is a different file already.
    """

    def __init__(self, link: Path):
        if link.exists() and not link.is_symlink():
            raise InputError(f"{link}: exists and is not a virtual port; give another name")
        self.link = link
        self._waiting, self._read_at = bytearray(), time.monotonic()
        self._master = self._slave = -1
        self.plug()

    def plug(self) -> None:
        """Make the pseudo-terminal and point the name at it."""
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        try:
            self.link.unlink(missing_ok=True)
            self.link.symlink_to(os.ttyname(self._slave))
        except OSError as error:
            raise InputError(f"{self.link}: cannot be made ({error.strerror}); give another name") from error

    def unplug(self) -> None:
        """Unplug the cable, if it is plugged in: the name is removed, and readers get an error."""
        if self.plugged:
            self.link.unlink(missing_ok=True)
            self._waiting.clear()
            for descriptor in (self._master, self._slave):
                os.close(descriptor)
            self._master = self._slave = -1

    @property
    def plugged(self) -> bool:
        """Whether the cable is plugged in."""
        return self._master >= 0

    def write(self, data: bytes) -> int:
        """Send the bytes that the terminal accepts now, and store the rest; returns the number of bytes that did not fit."""
        if self._waiting and time.monotonic() - self._read_at > _UNREAD_S:
            # Without a reader, a port stores nothing for a later one.
            self._waiting.clear()
        overrun = max(0, len(self._waiting) + len(data) - _BUFFER_BYTES)
        self._waiting += data[: len(data) - overrun]
        with contextlib.suppress(BlockingIOError):
            while self._waiting:
                del self._waiting[: os.write(self._master, self._waiting[:65536])]
                self._read_at = time.monotonic()
        return overrun

    def read(self) -> bytes:
        """The commands sent to the device."""
        with contextlib.suppress(OSError):
            return os.read(self._master, 4096)
        return b""

"""Ctrl-C, SIGTERM and SIGHUP during a run: remembered, and handled when no step is incomplete."""

import signal
import time
from types import FrameType


class Stopped(Exception):
    """A signal requested the end; `number` is that signal."""

    number: signal.Signals

    def __init__(self, number: int):
        self.number = signal.Signals(number)
        super().__init__(self.number.name)


class StopSignals:
    """While entered, these signals set `received` (otherwise None) instead of ending the process at any place.

    A signal that was ignored before (`nohup`) stays ignored.
    """

    def __init__(self) -> None:
        self.received: int | None = None
        self._earlier: dict[int, object] = {}

    def __enter__(self) -> "StopSignals":
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if signal.getsignal(number) is not signal.SIG_IGN:
                self._earlier[number] = signal.signal(number, self._remember)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._earlier.items():
            signal.signal(number, handler)  # type: ignore[arg-type]

    def _remember(self, number: int, frame: FrameType | None) -> None:
        self.received = self.received or number

    def pause(self, seconds: float) -> None:
        """Sleep.

        **Raises:** `Stopped` if a signal came, now or since the last pause.
        """
        if self.received is None:
            time.sleep(seconds)
        if self.received is not None:
            raise Stopped(self.received)

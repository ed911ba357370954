"""Reports on workers of a cluster that do not respond while a study waits for them."""

import time
from collections.abc import Callable, Mapping
from typing import Any


# Seconds without a heartbeat before a worker is called stopped. A worker that computes goes on sending them, the more
# workers there are the less often: every second with 50, every 5 s with 1000.
SILENT_S = 15.0


class WorkerWatch:
    """Reports workers that stop, leave, or answer again.

    **Arguments:**

    - `cluster`: what the user called the cluster. `tell`: is given the lines.
    """

    def __init__(self, cluster: str, tell: Callable[[str], object]):
        self._cluster, self._tell = cluster, tell
        # For each worker its last heartbeat by the scheduler's clock, and when it was first seen here.
        self._heard: dict[str, tuple[float, float]] = {}
        self._silent: set[str] = set()

    def look(self, workers: Mapping[str, Mapping[str, Any]]) -> None:
        """Compare with the scheduler's present list of workers."""
        now = time.monotonic()
        for address, about in workers.items():
            beat = float(about.get("last_seen", 0.0))
            known = self._heard.get(address)
            if known is None or known[0] != beat:
                self._heard[address] = beat, now
                if address in self._silent:
                    self._silent.discard(address)
                    self._tell(f"{self._cluster}: worker {address} answers again")
            elif now - known[1] > SILENT_S and address not in self._silent:
                self._silent.add(address)
                self._tell(
                    f"{self._cluster}: worker {address} has not responded for {SILENT_S:.0f} s; its chunks wait. "
                    "Let it continue, or end it: other workers then compute them"
                )
        for address in [address for address in self._heard if address not in workers]:
            del self._heard[address]
            self._silent.discard(address)
            self._tell(f"{self._cluster}: worker {address} is gone; other workers compute its chunks")

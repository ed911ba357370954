"""The live estimate in a separate thread: it may take seconds or fail without stopping a capture."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.journal import Attempt


# (number in the plan, mean_g, sd_g) of the accepted positions -> (name, value, sd, unit) of the parameters.
Measured = tuple[int, NDArray[np.float64], NDArray[np.float64]]
Shown = tuple[str, float, float, str]
Estimate = Callable[[list[Measured]], list[Shown]]


class EstimateWorker:
    """Runs an estimate on request; `rows` is the last finished one.

    **Arguments:**

    - `estimate`: the function; None for no live estimate.
    - `failed`: called if it fails.
    """

    def __init__(self, estimate: Estimate | None, failed: Callable[[str], object]):
        self._estimate, self._failed = estimate, failed
        self._thread = ThreadPoolExecutor(1)
        self._pending: Future | None = None
        self.rows: list[Shown] = []

    def ask(self, accepted: dict[int, Attempt]) -> None:
        """Begin to estimate from the accepted positions."""
        if self._estimate is None:
            return
        measured = []
        for position, attempt in sorted(accepted.items()):
            summary = attempt.summary
            sd = np.maximum(np.array(summary["sd_g"]) / np.sqrt(max(summary["n"], 1)), 1e-7)
            measured.append((position, np.array(summary["mean_g"]), sd))
        self._pending = self._thread.submit(self._estimate, measured)

    def look(self) -> None:
        """Take the result if it is ready."""
        if self._pending is None or not self._pending.done():
            return
        error = self._pending.exception()
        if error is None:
            self.rows = self._pending.result()
        else:
            self._failed(f"live estimate: {error}")
        self._pending = None

    def close(self) -> None:
        """Return without waiting; the thread ends with the program."""
        self._thread.shutdown(wait=False, cancel_futures=True)

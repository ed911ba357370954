"""What every command that computes does first: float64, one heap, and compiled programs kept between calls."""

import gc
import os
import sys
import warnings
from pathlib import Path

from tumblecal.cli.interrupts import interrupts_kept
from tumblecal.ground.heap import one_heap
from tumblecal.ground.precision import enable_float64


# Objects made between two looks of the garbage collector; Python's own number is 700.
_COLLECT_EVERY = 50_000


def cache_folder() -> Path:
    """Where compiled programs, executable code, are kept: `programs` in `TUMBLECAL_CACHE`, else in the user's cache."""
    own = os.environ.get("TUMBLECAL_CACHE")
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return (Path(own) if own else Path(base) / "tumblecal") / "programs"


def start(*, accelerator: bool = False) -> None:
    """Float64, one thread of linear algebra and of short programs, one heap, and compiled programs kept on disk.

    **Arguments:**

    - `accelerator`: whether JAX may use a GPU. Single fits and diagnoses are thousands of small programs, which a processor
      runs and compiles many times faster. `JAX_PLATFORMS` overrides this.

    A folder that cannot be used is done without, and said.
    """
    interrupts_kept()
    one_heap()
    # Before numpy is loaded. For matrices of a hundred rows threads only wait for each other, at full load.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if not accelerator:
        os.environ.setdefault("JAX_PLATFORMS", "cpu")
    gc.set_threshold(_COLLECT_EVERY)
    import equinox  # noqa: F401  (and JAX with it)
    import jax

    from tumblecal.ground.program_cache import keep_programs

    # What was imported stays: the collector need not look at it.
    gc.freeze()
    enable_float64()
    # Programs that run for microseconds are done before another thread could begin.
    jax.config.update("jax_cpu_enable_async_dispatch", False)
    # A cache that is full or unreadable costs time, never a result.
    warnings.filterwarnings("ignore", message="Error (writing|reading) persistent compilation cache")
    unsafe = keep_programs(cache_folder())
    if unsafe:
        print(
            f"tumblecal: {unsafe}: compiled programs are executable code, so none is read or kept there; give a folder of "
            "your own in TUMBLECAL_CACHE, or remove this one",
            file=sys.stderr,
        )

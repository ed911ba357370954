"""Start of each command that computes: float64, one heap, and a cache of compiled programs."""

import ctypes
import gc
import os
import sys
import warnings
from contextlib import suppress

from tumblecal.cli.interrupts import interrupts_kept
from tumblecal.ground.precision import enable_float64


# New objects between two runs of the garbage collector; the default of Python is 700.
_COLLECT_EVERY = 50_000
# M_ARENA_MAX of glibc's malloc.h.
_ARENA_MAX = -8


def start(*, accelerator: bool = False, one_thread: bool = False) -> None:
    """Set float64, one thread for linear algebra and short programs, one heap, and the cache of compiled programs.

    **Arguments:**

    - `accelerator`: whether JAX may use a GPU. Single fits and diagnoses are thousands of small programs, which a CPU runs
      and compiles many times faster. `JAX_PLATFORMS` overrides this.
    - `one_thread`: whether XLA computes in one thread, too.

    A cache folder that cannot be used is reported and ignored.
    """
    if one_thread:
        from tumblecal.studies.threads import use_one_thread

        use_one_thread()
    interrupts_kept()
    with suppress(OSError, AttributeError, TypeError):
        # One heap of glibc for all threads, before any is started: compilers and table readers leave tens of megabytes unused.
        ctypes.CDLL(None).mallopt(_ARENA_MAX, 1)
    # Before numpy is imported. For matrices of a hundred rows threads only wait for each other, at full load.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if not accelerator:
        os.environ.setdefault("JAX_PLATFORMS", "cpu")
    gc.set_threshold(_COLLECT_EVERY)
    import equinox  # noqa: F401  (and JAX with it)
    import jax

    from tumblecal.ground.program_cache import cache_folder, keep_programs_in

    # Imported objects persist, so the collector can skip them.
    gc.freeze()
    enable_float64()
    # Programs that run for microseconds end before a thread could start.
    jax.config.update("jax_cpu_enable_async_dispatch", False)
    # A full or unreadable cache costs only time.
    warnings.filterwarnings("ignore", message="Error (writing|reading) persistent compilation cache")
    unsafe = keep_programs_in(cache_folder())
    if unsafe:
        print(
            f"tumblecal: {unsafe}: compiled programs are executable code, so none is read or stored there; set TUMBLECAL_CACHE "
            "to a folder that belongs to you, or remove this one",
            file=sys.stderr,
        )

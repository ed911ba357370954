"""What every command that computes does first: float64, and compiled programs kept between calls."""

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from tumblecal.precision import enable_float64


def cache_folder() -> Path:
    """Where compiled programs are kept: `TUMBLECAL_CACHE`, else the user's cache folder."""
    own = os.environ.get("TUMBLECAL_CACHE")
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(own) if own else Path(base) / "tumblecal"


def interrupts_kept() -> None:
    """Ctrl-C inside JAX's callback of the garbage collector would be swallowed there: ask again a moment later."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        if frame is not None and frame.f_code.co_name == "_xla_gc_callback":
            threading.Timer(0.02, signal.raise_signal, [number]).start()
            return
        raise KeyboardInterrupt

    on_main = threading.current_thread() is threading.main_thread()
    if on_main and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, interrupt)


@contextmanager
def interrupts_held_back() -> Iterator[None]:
    """Ctrl-C while compiled modules are being imported would be lost in them or crash them: it waits until the end."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    received: list[int] = []
    earlier = signal.signal(signal.SIGINT, lambda number, frame: received.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, earlier)
    if received:
        signal.raise_signal(signal.SIGINT)


def start() -> None:
    """Switch float64 on and let JAX keep compiled programs on disk; a folder that cannot be written is done without."""
    interrupts_kept()
    with interrupts_held_back():
        import equinox  # noqa: F401  (and JAX with it)
        import jax

    enable_float64()
    folder = cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)

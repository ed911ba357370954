"""What every command that computes does first: float64, and compiled programs kept between calls."""

import os
import warnings
from pathlib import Path

from tumblecal.cli.interrupts import interrupts_held_back, interrupts_kept
from tumblecal.precision import enable_float64


def cache_folder() -> Path:
    """Where compiled programs are kept: `TUMBLECAL_CACHE`, else the user's cache folder."""
    own = os.environ.get("TUMBLECAL_CACHE")
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(own) if own else Path(base) / "tumblecal"


def start() -> None:
    """Switch float64 on and let JAX keep compiled programs on disk; a folder that cannot be written is done without."""
    interrupts_kept()
    with interrupts_held_back():
        import equinox  # noqa: F401  (and JAX with it)
        import jax

    enable_float64()
    # A cache that is full or unreadable costs time, never a result.
    warnings.filterwarnings("ignore", message="Error (writing|reading) persistent compilation cache")
    folder = cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)

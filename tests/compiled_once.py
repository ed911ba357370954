"""What JAX compiles in this session is compiled once: its workers and the commands that it starts share one folder.

Only executables: the functions are traced in every process, so that the shapes of their signatures are checked there.
Null distributions are drawn once a plan.
"""

import os
import shutil
import tempfile
from pathlib import Path


def begin() -> None:
    """Make the session's folder, in the first process alone; the others inherit it."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        os.environ["TUMBLECAL_CACHE"] = tempfile.mkdtemp(prefix="tumblecal-tests-")


def keep_programs() -> None:
    """Let this process, and the workers that it starts, read and keep programs as a command does."""
    from tumblecal.ground import program_cache  # not earlier: the import hook checks what it imports

    program_cache.keep_programs(Path(os.environ["TUMBLECAL_CACHE"]) / "programs")


def keep_executables() -> None:
    """Let this process read and keep what JAX compiled, and no traced program."""
    from tumblecal.ground import program_cache

    keep_programs()
    program_cache._kept = None


def share_null_distributions() -> None:
    """Let all processes of this session draw the null distribution of a plan once."""
    from tumblecal.diagnosis.detection import kept_null
    from tumblecal.ground.program_cache import ProgramCache

    cache = ProgramCache(Path(os.environ["TUMBLECAL_CACHE"]) / "programs")
    kept_null.program_cache = lambda: cache


def end() -> None:
    if "PYTEST_XDIST_WORKER" not in os.environ:
        shutil.rmtree(os.environ["TUMBLECAL_CACHE"], ignore_errors=True)

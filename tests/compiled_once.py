"""What JAX traces and compiles in this session is made once: its workers and the commands that it starts share one folder.

The process that traces a function checks the shapes of its signatures.
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


def end() -> None:
    if "PYTEST_XDIST_WORKER" not in os.environ:
        shutil.rmtree(os.environ["TUMBLECAL_CACHE"], ignore_errors=True)

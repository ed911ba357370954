"""Studies compute in one thread: how XLA's libraries share a sum between threads decides its last digit."""

import os


# Several processes share the cores of a machine without this too: blocks of trials are too small for threads to help.
ONE_THREAD = {"NPROC": "1", "OMP_NUM_THREADS": "1"}


def use_one_thread() -> None:
    """Make this process compute in one thread, unless its environment says otherwise; before JAX and numpy start."""
    for name, value in ONE_THREAD.items():
        os.environ.setdefault(name, value)

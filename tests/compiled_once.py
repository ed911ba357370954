"""What JAX compiles in this session is compiled once: its workers and the commands that it starts share one folder.

Only executables: the functions are traced in every process, so that the shapes of their signatures are checked there.
In one process a chain is traced once for plans of one kind, and null distributions are drawn once a plan, whoever diagnoses.
"""

import dataclasses
import os
import shutil
import tempfile
from functools import lru_cache
from pathlib import Path
from typing import Any


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


def share_programs() -> None:
    """Let all diagnosers of this process share the programs of a chain."""
    from tumblecal.diagnosis import full_model

    full_model.programs_of = _Shared(full_model.programs_of)


def share_null_distributions() -> None:
    """Let all processes of this session draw the null distribution of a plan once."""
    from tumblecal.diagnosis import kept_null
    from tumblecal.ground.program_cache import ProgramCache

    cache = ProgramCache(Path(os.environ["TUMBLECAL_CACHE"]) / "programs")
    kept_null.program_cache = lambda: cache


class _Shared:
    """Programs by all that they depend on; of the last 32 chains."""

    def __init__(self, programs_of: Any):
        self._programs = lru_cache(maxsize=32)(lambda call: programs_of(*call.arguments))

    def __call__(self, chain: Any, back: Any, nominal: Any, where: Any, start: Any, scales: Any) -> Any:
        return self._programs(_Call((chain, back, nominal, where, start, scales)))


class _Call:
    """Arguments of `programs_of`, told apart by the chains, but for the values and sizes of what is free, and the settings'
    kind."""

    def __init__(self, arguments: tuple):
        import jax
        import numpy as np

        self.arguments = arguments
        chain, back, nominal, where, *_ = arguments
        chains = [_without_sizes(model.at(np.zeros(len(model.names)))) for model in (chain, nominal)]
        leaves, structure = jax.tree.flatten((chains, back))
        settings, form = jax.tree.flatten(where)
        values = tuple((np.shape(leaf), np.asarray(leaf).tobytes()) for leaf in leaves)
        self._key = structure, values, form, tuple(np.shape(leaf) for leaf in settings)

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Call) and self._key == other._key


def _without_sizes(chain: Any) -> Any:
    import jax

    from tumblecal.chain import Parameter

    def replaced(node: Any) -> Any:
        return dataclasses.replace(node, scale=1.0) if isinstance(node, Parameter) and node.free else node

    return jax.tree.map(replaced, chain, is_leaf=lambda node: isinstance(node, Parameter))


def end() -> None:
    if "PYTEST_XDIST_WORKER" not in os.environ:
        shutil.rmtree(os.environ["TUMBLECAL_CACHE"], ignore_errors=True)

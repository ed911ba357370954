"""Traced programs stored on disk with JAX's compiled ones, so that a cold start neither traces nor compiles.

JAX's persistent cache saves the compilation but not the tracing, which takes most of a second for a solver. A program is stored
as exported StableHLO under a key of everything that it depends on: its name, the structure and shapes of its arguments, the
sources of this package, and the versions of Python, JAX and jaxlib. Nothing is stored before `program_cache.keep_programs`.
"""

import hashlib
import inspect
import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jax.core import Tracer
from jax.stages import Wrapped

from tumblecal.chain import Chain, Link
from tumblecal.estimation.program_key import described
from tumblecal.ground.program_cache import ProgramCache, program_cache, sources_digest


_log = logging.getLogger(__name__)
# LAPACK calls that JAX may change between versions; the key includes the version.
_LAPACK = ("geqrf", "ormqr", "orgqr", "trsm", "potrf", "getrf", "gesdd")

# A program for one plan runs a few times, for milliseconds, but takes seconds to compile. XLA's fusion emitters for the CPU
# recompute a chain of 60 links repeatedly: 30 ms instead of 1 ms (jax 0.10.2). Without LLVM's optimisation the
# compilation takes a third of the time; without a split for several cores the program then runs equally fast.
_QUICKLY_COMPILED = {
    "xla_cpu_use_fusion_emitters": False,
    "xla_backend_optimization_level": 0,
    "xla_cpu_parallel_codegen_split_count": 1,
}
_OPTIMISED = {"xla_backend_optimization_level": 2}
# A compiled program takes 5 to 20 MB. Limits in memory: kinds of arguments of one function, and programs of all
# functions. Those beyond are read from disk or compiled again.
_MOST_KINDS = 8
_MOST_PROGRAMS = 32


@lru_cache
def compiler_options(optimised: bool = False) -> dict[str, Any]:
    """XLA's options for programs of one plan; empty if not on the CPU, or if this version of XLA lacks them.

    `optimised`: for one that runs for longer than its compilation takes.
    """
    if jax.default_backend() != "cpu":
        return {}
    options = _QUICKLY_COMPILED | (_OPTIMISED if optimised else {})
    try:
        jax.jit(lambda x: x + 1.0, compiler_options=options)(1.0)
    except RuntimeError:
        return {}
    return options


def cached_program(function: Callable[..., Any], *about: Any, optimised: bool = False) -> Callable[..., Any]:
    """`jax.jit(function)` for a function of pytrees of arrays, stored on disk if a folder for programs is set.

    Equal programs are compiled once in a process. The last few kinds of arguments stay compiled.

    **Arguments:**

    - `function`: of a module, or one that closes over nothing but `about`: chains, arrays, plain values.
    - `optimised`: compiled to run for longer than the compilation takes.
    """
    traced, ready = jax.jit(function), dict[tuple, Callable[..., Any]]()

    def call(*arguments):
        leaves, structure = jax.tree.flatten(arguments)
        if any(isinstance(leaf, Tracer) for leaf in leaves):
            return traced(*arguments)
        cache = program_cache()
        kind = cache, structure, tuple(map(_shape, leaves))
        if kind not in ready:
            while len(ready) >= _MOST_KINDS:
                ready.pop(next(iter(ready)))
            key = _key(function, about, (arguments, about), *map(str, kind[1:]))
            program = _Program(key, optimised, cache, function, structure, leaves)
            kept = _compiled if cache is None else _from_disk
            ready[kind] = kept(program) if key else program.jitted()
        return ready[kind](leaves)

    return call


@dataclass(frozen=True)
class _Program:
    """A function for one kind of arguments.

    `key`: digest of all that it depends on, "" if unknown. `optimised`: as of `cached_program`. `cache`: its store on disk.
    `structure`, `leaves`: of the first arguments.
    """

    key: str
    optimised: bool
    cache: ProgramCache | None
    function: Callable[..., Any] = field(compare=False)
    structure: Any = field(compare=False)
    leaves: list = field(compare=False)

    def jitted(self) -> Wrapped:
        """Compiled for the list of leaves; JAX's cache of it is released with it."""

        def of_leaves(flat):
            return self.function(*jax.tree.unflatten(self.structure, flat))

        return jax.jit(of_leaves, compiler_options=compiler_options(self.optimised))


@lru_cache(maxsize=_MOST_PROGRAMS)
def _compiled(program: _Program) -> Callable[[list], Any]:
    return program.jitted()


def _key(function: Callable[..., Any], about: tuple, arguments: Any, *kind: str) -> str:
    """Digest of all that a program depends on, including the links in `arguments`; "" if that cannot be described."""
    try:
        return _digest(function.__qualname__, "\0".join(described(about)), *kind, _sources(_links(arguments)))
    except (TypeError, ValueError, RecursionError, OSError) as reason:  # a function that closes over itself, say
        _log.debug("%s", reason)
        return ""


def _shape(leaf: Any) -> tuple:
    return (leaf.shape, leaf.dtype) if hasattr(leaf, "dtype") else (np.shape(leaf), np.result_type(leaf))


@lru_cache(maxsize=_MOST_PROGRAMS)
def _from_disk(program: _Program) -> Callable[[list], Any]:
    """The program from disk if one works; otherwise traced, compiled and stored there. Takes the leaves of the arguments."""
    from jax import export

    cache, name = program.cache, f"tumblecal-{program.key}.stablehlo"
    assert cache is not None
    payload = cache.get(name)
    if payload is None:
        return _exported(program, cache, name)
    try:
        loaded = _of_used(export.deserialize(bytearray(payload)), program.optimised)
        jax.block_until_ready(loaded(program.leaves))
        return loaded
    except Exception as error:  # any error: the program is made again, and its errors appear then
        cache.discard(name, error)
        return _exported(program, cache, name)


def _exported(program: _Program, cache: ProgramCache, name: str) -> Callable[[list], Any]:
    """The program traced, exported and stored on disk; only traced if JAX cannot export it."""
    from jax import export

    made = program.jitted()
    checks = [export.DisabledSafetyCheck.custom_call(f"lapack_d{target}_ffi") for target in _LAPACK]
    try:
        exported = export.export(made, disabled_checks=checks)(program.leaves)
        cache.put(name, bytes(exported.serialize()))
    except (ValueError, NotImplementedError):
        return made
    return _of_used(exported, program.optimised)


def _of_used(exported: Any, optimised: bool) -> Callable[[list], Any]:
    """An exported program as a function of the list of its arguments' leaves. Only the leaves in use are passed,
    because passing the others takes longer than a short program runs."""
    used, kinds = exported.module_kept_var_idx, exported.in_avals

    def program(used_leaves):
        leaves: list[Any] = [np.zeros(kind.shape, kind.dtype) for kind in kinds]
        for number, leaf in zip(used, used_leaves, strict=True):
            leaves[number] = leaf
        return exported.call(leaves)

    compiled = jax.jit(program, compiler_options=compiler_options(optimised))
    return lambda leaves: compiled([leaves[number] for number in used])


def _links(arguments: Any) -> tuple[type, ...]:
    """The classes of all links among the arguments."""
    chains = [
        node
        for node in jax.tree.leaves(arguments, is_leaf=lambda node: isinstance(node, Chain) or hasattr(node, "chain"))
        if hasattr(node, "chain")
    ]
    return tuple(type(link) for node in chains for link in node.chain.links)


@lru_cache
def _sources(links: tuple[type[Link], ...]) -> str:
    """Digest of this package's sources and of those of links defined elsewhere."""
    files = sorted({Path(inspect.getfile(link)) for link in links})
    package = sources_digest("chain", "effects", "estimation", "simulation")
    return _digest(package, *(path.read_text(encoding="utf-8") for path in files))


def _digest(*texts: str) -> str:
    return hashlib.sha256("\0".join((jax.default_backend(), *texts)).encode()).hexdigest()[:32]

"""Traced programs kept on disk beside JAX's compiled ones, so that a cold start neither traces nor compiles.

JAX's persistent cache saves the compilation but not the tracing, which for a solver costs most of a second. A program
is kept as exported StableHLO under a key of everything that it depends on: its name, the structure and shapes of its
arguments, this package's sources, and the versions of Python, JAX and jaxlib. Nothing is kept where JAX has no
`jax_compilation_cache_dir`.
"""

import hashlib
import inspect
import sys
from collections.abc import Callable
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jax.core import Tracer

import tumblecal
from tumblecal.chain import Chain, Link
from tumblecal.data.atomic import written_aside


# LAPACK calls that JAX does not promise to keep from version to version; the key holds the version.
_LAPACK = ("geqrf", "ormqr", "orgqr", "trsm", "potrf", "getrf", "gesdd")

_loaded: dict[tuple, Callable[..., Any]] = {}


def kept(function: Callable[..., Any]) -> Callable[..., Any]:
    """`jax.jit(function)` for a module-level function of pytrees of arrays, kept on disk where JAX keeps its own."""
    compiled = jax.jit(function)

    def call(*arguments):
        if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(arguments)):
            return compiled(*arguments)
        folder: str | None = jax.config.jax_compilation_cache_dir  # type: ignore[attr-defined]
        if not folder:
            return compiled(*arguments)
        leaves, structure = jax.tree.flatten(arguments)
        shapes = tuple((np.shape(leaf), str(np.result_type(leaf))) for leaf in leaves)
        place = (function.__qualname__, structure, shapes)
        if place not in _loaded:
            digest = _digest(function.__qualname__, str(structure), str(shapes), _sources(_links(arguments)))
            program = _load_or_export(Path(folder) / f"tumblecal-{digest}.stablehlo", function, structure, leaves)
            _loaded[place] = compiled if program is None else program
        program = _loaded[place]
        return compiled(*arguments) if program is compiled else program(leaves)

    return call


def _load_or_export(path: Path, function: Callable, structure: Any, leaves: list) -> Callable[..., Any] | None:
    """The program from disk, or exported and written there; None when it cannot be exported or written."""
    try:
        from jax import export

        if path.exists():
            return jax.jit(export.deserialize(bytearray(path.read_bytes())).call)
        checks = [export.DisabledSafetyCheck.custom_call(f"lapack_d{name}_ffi") for name in _LAPACK]
        exported = export.export(
            jax.jit(lambda flat: function(*jax.tree.unflatten(structure, flat))), disabled_checks=checks
        )(leaves)
        with written_aside(path) as aside:
            aside.write_bytes(exported.serialize())
        return jax.jit(exported.call)
    except Exception:  # a cache that fails, for whatever reason, must not cost a result: trace and compile instead
        return None


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
    package = Path(tumblecal.__file__).parent
    files = {path for folder in ("chain", "effects", "estimation") for path in (package / folder).glob("*.py")}
    files |= {Path(inspect.getfile(link)) for link in links}
    return _digest(*(path.read_text(encoding="utf-8") for path in sorted(files)))


def _digest(*texts: str) -> str:
    versions = (sys.version, jax.__version__, version("jaxlib"), jax.default_backend())
    return hashlib.sha256("\0".join((*versions, *texts)).encode()).hexdigest()[:32]

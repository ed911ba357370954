"""User effects from a Python file, checked before use.

Every fault is one line with file and line. An effect is tested on positions all over the sphere, under `jax.jit` as in a
diagnosis: it must give finite values and derivatives of the correct shape.
"""

import linecache
import sys
import traceback
import types
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from tumblecal.chain import Chain, Link, Parameter, State, Where, settings
from tumblecal.chain.nominal import UNIT_OF_LEAF
from tumblecal.effects.added_terms import base_unit
from tumblecal.effects.effect import Effect
from tumblecal.ground.errors import InputError
from tumblecal.ground.frames import gravity_in_head
from tumblecal.ground.numbers_shown import counted
from tumblecal.ground.units import factor


# Characters that separate names in reports and on the command line.
_RESERVED = ":+,=@ \t\n"
_COLUMNS = ("time_s", "temperature_degc", "approach")


@dataclass(frozen=True)
class Source:
    """A Python file with a list `EFFECTS`: its name and text."""

    path: str
    text: str

    def at(self, line: int | None) -> str:
        """The place that a fault names."""
        return f"{self.path}:line {line}" if line else self.path

    def line_with(self, text: str) -> int | None:
        """The first line that contains a text."""
        return next((k for k, line in enumerate(self.text.splitlines(), start=1) if text in line), None)

    def line_of(self, error: BaseException) -> int | None:
        """The last line of this file that an error passed through."""
        lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == self.path]
        return lines[-1] if lines else None


def read_source(path: Path) -> Source:
    """The text of a user's file.

    **Raises:** `InputError` if it cannot be read.
    """
    if path.suffix != ".py":
        raise InputError(f"{path}: not a Python file; its name must end in .py")
    try:
        return Source(str(path), path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file; give a Python file with a list EFFECTS") from error
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not text in UTF-8"
        raise InputError(f"{path}: cannot be read ({reason})") from error


def extended(entries: Mapping[str, Effect], sources: Sequence[Source]) -> dict[str, Effect]:
    """A catalogue with the effects of files whose texts are given.

    **Raises:** `InputError` for a text that cannot be used.
    """
    whole = dict(entries)
    for source in sources:
        whole |= {effect.id: effect for effect in effects_of(source, whole)}
    return whole


def effects_of(source: Source, others: Mapping[str, Effect]) -> tuple[Effect, ...]:
    """The effects that a text defines in its list `EFFECTS`.

    **Arguments:**

    - `source`: the file.
    - `others`: effects that exist already.

    **Raises:** `InputError`, one line a fault, if the text fails, if the list contains anything else, or if an effect
    is invalid.
    """
    effects = getattr(_module(source), "EFFECTS", None)
    if effects is None:
        raise InputError(f"{source.path}: no list EFFECTS in this file; write EFFECTS = [output_effect(...), ...]")
    line = source.line_with("EFFECTS")
    if not isinstance(effects, list | tuple):
        raise InputError(f"{source.at(line)}: EFFECTS is a {type(effects).__name__}; write a list of effects")
    faults: list[str] = []
    used_ids, leaves = set(others), {leaf for effect in others.values() for leaf in _leaf_names(effect)}
    for number, effect in enumerate(effects, start=1):
        if not isinstance(effect, Effect):
            faults.append(
                f"{source.at(line)}: entry {number} of EFFECTS is a {type(effect).__name__}, not an effect; make it with "
                "output_effect, angle_effect or Effect"
            )
            continue
        try:
            _check(effect, source, used_ids, leaves)
        except InputError as error:
            faults += error.faults
            continue
        used_ids.add(effect.id)
        leaves |= set(_leaf_names(effect))
    if faults:
        raise InputError(faults)
    return tuple(effects)


def fault_in_users_file(error: BaseException) -> str | None:
    """One line for an error raised in a user's file while something was computed; None for any other error."""
    frames = traceback.extract_tb(error.__traceback__)
    known = {module.__file__ for name, module in sys.modules.items() if name.startswith(_PREFIX)}
    in_file = [frame for frame in frames if frame.filename in known]
    return f"{in_file[-1].filename}:line {in_file[-1].lineno}: {_words(error)}" if in_file else None


_PREFIX = "tumblecal_users_"


def _module(source: Source) -> types.ModuleType:
    """The text executed as a module; its lines are stored for tracebacks."""
    module = types.ModuleType(f"{_PREFIX}{Path(source.path).stem}")
    module.__file__ = source.path
    sys.modules[module.__name__] = module
    linecache.cache[source.path] = (len(source.text), None, source.text.splitlines(keepends=True), source.path)
    try:
        exec(compile(source.text, source.path, "exec"), module.__dict__)
    except SyntaxError as error:
        raise InputError(f"{source.at(error.lineno)}: not Python: {error.msg}") from error
    except (Exception, SystemExit) as error:
        raise InputError(f"{source.at(source.line_of(error))}: {_words(error)}") from error
    return module


def _words(error: BaseException) -> str:
    """An error in one line."""
    text = " ".join(str(error).split())
    return text if isinstance(error, InputError) else f"{type(error).__name__}: {text[:200]}"


def _check(effect: Effect, source: Source, used_ids: Collection[str], leaves: Collection[str]) -> None:
    if not isinstance(effect.id, str) or not effect.id or any(mark in effect.id for mark in _RESERVED):
        raise InputError(
            f"{source.at(source.line_with('EFFECTS'))}: the id {effect.id!r} must be one word without : + , = @"
        )
    place = source.at(source.line_with(f'"{effect.id}"') or source.line_with(f"'{effect.id}'"))
    if effect.id in used_ids:
        raise InputError(f"{place}: the id {effect.id!r} exists already; give the effect another id")
    if effect.make is None:
        raise InputError(
            f"{place}: effect {effect.id!r} has no link; make it with output_effect or angle_effect, or give make="
        )
    unknown = [name for name in effect.needs if name not in _COLUMNS]
    if unknown:
        raise InputError(
            f"{place}: effect {effect.id!r}: unknown columns in needs: {', '.join(unknown)}; the columns are "
            f"{', '.join(_COLUMNS)}"
        )
    made = _tried(effect, source, place)
    for link in made:
        in_file = [leaf for leaf in Chain((link,)).free]
        if not in_file:
            raise InputError(f"{place}: effect {effect.id!r} has no free coefficient; make it with coefficients(...)")
        for leaf in in_file:
            if leaf.name in leaves or leaf.name in _NOMINAL:
                raise InputError(f"{place}: the coefficient's name {leaf.name!r} exists already; name it {effect.id!r}")
            _check_unit(effect, leaf, place)
    count = sum(len(leaf.names) for leaf in Chain(made[:1]).parameters)
    if effect.forms and len(effect.forms) != count:
        raise InputError(
            f"{place}: effect {effect.id!r}: {counted(len(effect.forms), 'form')} for {counted(count, 'coefficient')}; give "
            "one for each, in their order, or none: a calibration file would contain half an effect"
        )


_NOMINAL = (*UNIT_OF_LEAF, "probe")


def _check_unit(effect: Effect, leaf: Parameter, place: str) -> None:
    try:
        if leaf.unit != "s":  # a time constant in addition to the coefficients
            factor(effect.unit, leaf.unit)
    except InputError as error:
        raise InputError(
            f"{place}: effect {effect.id!r}: {error}; the leaf's unit is {base_unit(effect.unit)[0]}"
        ) from error


def _tried(effect: Effect, source: Source, place: str) -> tuple[Link, ...]:
    """The links of the effect, after a test.

    **Raises:** `InputError` if they fail, or if their results are not readings.
    """
    where = _everywhere(effect.needs)
    assert effect.make is not None
    try:
        links = effect.make(where)
        if not isinstance(links, tuple) or not links or not all(isinstance(link, Link) for link in links):
            raise InputError(f"make must return a tuple of links, not {type(links).__name__}")
        for link in links:
            _try_link(link, where)
    except Exception as error:
        line = source.line_of(error)
        lacking = [name for name in _COLUMNS if name not in effect.needs]
        hint = ""
        if lacking and _works(effect, _everywhere(_COLUMNS)):
            hint = f"; it seems to use a column that is not in needs=; add one of {', '.join(lacking)}"
        elif line and "inputs_before" in source.text.splitlines()[line - 1]:
            hint = "; the inputs at the previous position are available with looks_back=True"
        place = source.at(line) if line else place
        raise InputError(f"{place}: effect {effect.id!r}: {_words(error)}{hint}") from error
    return links


def _works(effect: Effect, where: Where) -> bool:
    assert effect.make is not None
    try:
        for link in effect.make(where):
            _try_link(link, where)
    except Exception:
        return False
    return True


def _try_link(link: Link, where: Where) -> None:
    """Test the values of a link for a perfect state, and its derivatives by its leaves and by the specific force."""
    chain = Chain((link,))
    alpha, beta = jnp.asarray(where.alpha), jnp.asarray(where.beta)
    count = len(alpha)

    def run(vector, f, where: Where):
        components = (f[:, 0], f[:, 1], f[:, 2])
        if link.looks_back:
            where = replace(where, inputs_before=components)
        made = chain.at(vector).links[0](State(alpha, beta, components, components), where)
        if not isinstance(made, State):
            raise InputError(f"a link must return a State, not {type(made).__name__}")
        parts = [jnp.asarray(part) for part in (made.alpha, made.beta, *made.f, *made.reading)]
        for part in parts:
            if part.shape != (count,):
                raise InputError(
                    f"it gives an array of shape {part.shape}, not one number for each position ({count},)"
                )
        return jnp.stack(parts, axis=-1)

    @jax.jit
    def tried(vector, f, where: Where):
        by_leaves = jax.jacfwd(run)(vector, f, where).reshape(count, -1)
        value, by_force = jax.jvp(lambda f: run(vector, f, where), (f,), (jnp.ones_like(f),))
        return jnp.concatenate([value, by_force, by_leaves], axis=1)

    f = jnp.asarray(gravity_in_head(np.asarray(where.alpha), np.asarray(where.beta)))
    # At zero and at the leaves' typical sizes.
    for vector in (chain.vector, chain.vector + chain.scales):
        bad = np.flatnonzero(~np.all(np.isfinite(np.asarray(tried(jnp.asarray(vector), f, where))), axis=1))
        if len(bad):
            at = f"alpha {np.degrees(where.alpha[bad[0]]):.0f}, beta {np.degrees(where.beta[bad[0]]):.0f} deg"
            raise InputError(f"it gives no finite value or derivative at {at}")


def _everywhere(columns: Collection[str]) -> Where:
    """Positions all over the sphere, with these optional columns."""
    alpha, beta = np.meshgrid(np.radians(np.arange(0, 360, 30.0)), np.radians([-90.0, -45.0, 0.0, 30.0, 90.0]))
    count = alpha.size
    every = {
        "time_s": np.linspace(0.0, 7200.0, count),
        "temperature_degc": np.linspace(20.0, 40.0, count),
        "approach": np.where(np.arange(count) % 2, 1.0, -1.0),
    }
    return settings(alpha.ravel(), beta.ravel(), **{name: every[name] for name in columns})


def _leaf_names(effect: Effect) -> list[str]:
    if effect.make is None:
        return []
    return [leaf.name for link in effect.make(_everywhere(_COLUMNS)) for leaf in Chain((link,)).parameters]

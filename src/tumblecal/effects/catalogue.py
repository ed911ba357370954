"""The catalogue: all entries by id, and the user's own from a Python file."""

import importlib.util
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

from tumblecal.chain import Chain, Link, Where, settings
from tumblecal.effects import environment, noise, procedure, rig, sensor
from tumblecal.effects.effect import Effect
from tumblecal.errors import InputError


Catalogue = dict[str, Effect]


def catalogue(*files: Path | str) -> Catalogue:
    """All entries by id: those of the program, then those of the user's files.

    **Arguments:**

    - `files`: Python files, each with a list `EFFECTS`.

    **Raises:** `InputError` for a file that cannot be used.
    """
    modules = (rig, sensor, environment, procedure, noise)
    entries = {entry.id: entry for module in modules for entry in module.ENTRIES}
    for file in files:
        for entry in read_effects(Path(file)):
            if entry.id in entries:
                raise InputError(f"{file}: the id {entry.id!r} exists already; give the effect another id")
            entries[entry.id] = entry
    return entries


def read_effects(path: Path) -> tuple[Effect, ...]:
    """The effects that a Python file defines in its list `EFFECTS`.

    **Raises:** `InputError` when the file is missing, fails, or lists something else.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file; give a Python file with a list EFFECTS")
    name = f"tumblecal_user_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise InputError(f"{path}: not a Python file; its name must end in .py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise InputError(f"{path}: the file fails with {type(error).__name__}: {error}") from error
    effects = getattr(module, "EFFECTS", None)
    if not isinstance(effects, list | tuple) or not all(isinstance(entry, Effect) for entry in effects):
        raise InputError(f"{path}: no list EFFECTS of tumblecal.effects.Effect in this file")
    for entry in effects:
        if entry.make is None:
            raise InputError(f"{path}: effect {entry.id!r} has no link; make it with output_effect or give make=")
    return tuple(effects)


def entry(entries: Catalogue, id: str) -> Effect:
    """One entry.

    **Raises:** `InputError` naming near ids.
    """
    if id in entries:
        return entries[id]
    import difflib

    near = difflib.get_close_matches(id, entries, n=3, cutoff=0.4)
    near += [other for other in entries if other.startswith(id) and other not in near]
    hint = f"did you mean {', '.join(near[:6])}?" if near else "`tumblecal effects` lists them"
    raise InputError(f"no effect {id!r}; {hint}")


def links(entries: Catalogue, ids: tuple[str, ...], where) -> dict[str, tuple]:
    """The links (all variants) of the given effects for given settings, coefficients zero."""
    found = {}
    for id in ids:
        effect = entry(entries, id)
        if effect.make is None:
            raise InputError(f"{id}: acts on the {effect.kind}, it is not a link of the chain")
        missing = effect.missing(where)
        if missing:
            raise InputError(f"{id}: needs the column {' and '.join(missing)}")
        found[id] = effect.make(where)
    return found


def links_and_units(entries: Catalogue) -> tuple[dict[str, Callable[[Where], Link]], dict[str, str]]:
    """What a rig file needs of the catalogue: the link of each effect, and the base unit of each of its leaves."""
    every = settings([0.0, 1.0], [0.0, 1.0], time_s=[0.0, 1.0], temperature_degc=[25.0, 26.0], approach=[1.0, -1.0])
    makers, units = {}, {}
    for id, effect in entries.items():
        if effect.make is not None:
            makers[id] = partial(_first_link, effect)
            units |= {leaf.name: leaf.unit for leaf in Chain(effect.make(every)[:1]).parameters}
    return makers, units


def _first_link(effect: Effect, where: Where) -> Link:
    missing = effect.missing(where)
    if effect.make is None or missing:
        raise InputError(f"{effect.id}: needs the column {' and '.join(missing)}")
    return effect.make(where)[0]

"""The catalogue: all entries by id, and user entries from a Python file."""

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path

from tumblecal.chain import Chain, Link, Where, settings
from tumblecal.effects import (
    alignment,
    by_setting,
    dividing_head,
    environment,
    history,
    noise,
    procedure,
    readout,
    sensor,
    temperature,
)
from tumblecal.effects.effect import Effect, of_head
from tumblecal.ground.errors import InputError


Catalogue = dict[str, Effect]
MODULES = (
    dividing_head,
    sensor,
    environment,
    temperature,
    alignment,
    by_setting,
    history,
    readout,
    procedure,
    noise,
)


def catalogue(*files: Path | str) -> Catalogue:
    """All entries by id: those of the program, then those of the user's files.

    **Arguments:**

    - `files`: Python files, each with a list `EFFECTS`.

    **Raises:** `InputError` for a file that cannot be used.

    Examples:
        >>> from tumblecal.effects import catalogue
        >>> effect = catalogue()["second_order.z"]
        >>> effect.symbol, effect.unit, effect.physics
        ('K2', 'mg/g^2', 'K2 u^2')
    """
    entries = {entry.id: entry for module in MODULES for entry in module.ENTRIES}
    if not files:
        return entries
    from tumblecal.effects.users_file import extended, read_source

    return extended(entries, [read_source(Path(file)) for file in files])


def with_effects(effects: Iterable[Effect], entries: Catalogue | None = None) -> Catalogue:
    """A catalogue with further effects; `entries`: the program's if omitted.

    **Raises:** `InputError` for what is no effect, or an effect with the id of another one.

    Examples:
        >>> from tumblecal.effects import catalogue, with_effects
        >>> len(with_effects([])) == len(catalogue())
        True
        >>> with_effects([catalogue()["bias_drift.x"]])
        Traceback (most recent call last):
        tumblecal.ground.errors.InputError: effects: bias_drift.x is in the catalogue already; give it another id
    """
    whole = dict(catalogue() if entries is None else entries)
    if not whole:
        raise InputError(
            "entries: an empty catalogue; give one effect or more, or omit it for the catalogue of the program"
        )
    if isinstance(effects, Mapping):
        raise InputError("effects is a list of effects that are added to the catalogue; entries replaces it")
    for effect in effects:
        if not isinstance(effect, Effect):
            raise InputError(
                f"effects has an entry of type {type(effect).__name__}; give effects, such as from output_effect"
            )
        if effect.id in whole:
            raise InputError(f"effects: {effect.id} is in the catalogue already; give it another id")
        whole[effect.id] = effect
    return whole


def entry(entries: Catalogue, id: str) -> Effect:
    """One entry.

    **Raises:** `InputError` naming near ids.

    Examples:
        >>> from tumblecal.effects import catalogue, entry
        >>> entry(catalogue(), "bias_drift.x").needs
        ('time_s',)
        >>> entry(catalogue(), "bias_drif.x")
        Traceback (most recent call last):
        tumblecal.ground.errors.InputError: no effect 'bias_drif.x'; did you mean bias_drift.x, bias_drift.z, bias_drift.y?
    """
    if id in entries:
        return entries[id]
    import difflib

    near = difflib.get_close_matches(id, entries, n=3, cutoff=0.4)
    near += [other for other in entries if other.startswith(id) and other not in near]
    hint = f"did you mean {', '.join(near[:6])}?" if near else "`tumblecal effects` lists them"
    raise InputError(f"no effect {id!r}; {hint}")


def belongs_to(effect: Effect) -> str:
    """`head` if its links act before the triad's mount and so equally on every unit; otherwise `sensor`. "" for an
    effect on the data or on the noise."""
    if effect.make is None:
        return ""
    return "head" if of_head(effect.make(_everywhere())) else "sensor"


def _everywhere() -> Where:
    """Settings with every column and two runs."""
    ends, degc = [0.0, 1.0], [25.0, 26.0]
    return settings(ends, ends, run=["1", "2"], time_s=ends, temperature_degc=degc, approach=[1.0, -1.0])


def links(entries: Catalogue, ids: tuple[str, ...], where) -> dict[str, tuple]:
    """The links (all variants) of the given effects for given settings, coefficients zero.

    **Raises:** `InputError` for an unknown id, an effect that is no link, or settings without a column that it needs.

    Examples:
        >>> from tumblecal.chain import settings
        >>> from tumblecal.effects import catalogue, links
        >>> made = links(catalogue(), ("second_order.x",), settings([0.0], [0.0]))
        >>> [type(link).__name__ for link in made["second_order.x"]]
        ['OutputTerm']
    """
    made = {}
    for id in ids:
        effect = entry(entries, id)
        if effect.make is None:
            raise InputError(f"{id}: acts on the {effect.kind}, it is not a link of the chain")
        lacking = effect.lacking(where)
        if lacking:
            raise InputError(f"{id}: the data have {lacking}")
        made[id] = effect.make(where)
    return made


def links_and_units(entries: Catalogue) -> tuple[dict[str, Callable[[Where], Link]], dict[str, str]]:
    """The part of the catalogue that a rig file needs: the link of each effect, and the base unit of each of its leaves."""
    every = _everywhere()
    makers, units = {}, {}
    for id, effect in entries.items():
        if effect.make is not None:
            makers[id] = partial(first_link, effect)
            units |= {leaf.name: leaf.unit for leaf in Chain(effect.make(every)[:1]).parameters}
    return makers, units


def first_link(effect: Effect, where: Where) -> Link:
    """The link of an effect, the first of its variants.

    **Raises:** `InputError` for an effect on the data, or settings without a column that it needs.
    """
    lacking = effect.lacking(where)
    if effect.make is None or lacking:
        raise InputError(f"{effect.id}: {f'the data have {lacking}' if lacking else 'is not a link of the chain'}")
    return effect.make(where)[0]

"""Effects of temperature that a chain already includes, because its leaves follow temperature."""

from collections.abc import Iterator

from tumblecal.chain import Chain, Where, followings_of
from tumblecal.effects import Effect
from tumblecal.effects.alignment import TurningMount
from tumblecal.ground.axes import AXES


def already_followed(effect: Effect, nominal: Chain, where: Where) -> str:
    """The leaves by which the chain already includes an effect of temperature, in words; "" if it does not.

    A term `u^powers (T - reference)^k` is a change of the bias, of a scale factor or of an element of the alignment. The chain
    includes it if that leaf follows temperature by order k or more. One such term suffices: the others of the same effect are
    then a rotation of the mount, which is a separate effect.
    """
    orders = {leaf.reference.name: leaf.functions.order for leaf in followings_of(nominal) if leaf.change.free}
    if not orders or "temperature_degc" not in effect.needs:
        return ""
    terms = [*_leaves(effect, where)]
    if effect.over_temperature:
        terms = terms[-1:]  # the highest order includes the others
    included = [leaves for leaves, power in terms if all(orders.get(leaf, 0) >= power for leaf in leaves)]
    return " and ".join(dict.fromkeys(leaf for leaves in included for leaf in leaves))


def _leaves(effect: Effect, where: Where) -> Iterator[tuple[tuple[str, ...], int]]:
    """For each coefficient the leaves of whose changes it is a combination, and its power of the temperature; nothing for an
    effect that is no such change."""
    links = effect.make(where) if effect.make is not None and effect.needs == ("temperature_degc",) else ()
    if links and all(isinstance(link, TurningMount) for link in links):
        yield ("dtheta",), 1
        return
    terms = [_term(form) for form in effect.forms]
    if all(terms):
        yield from filter(None, terms)


def _term(form: dict) -> tuple[tuple[str, ...], int] | None:
    inputs, power = form.get("powers"), form.get("degc_power", 1 if form.get("per_degc") else 0)
    if form.get("kind", "product") != "product" or form.get("per_hour") or not isinstance(inputs, list) or power < 1:
        return None
    if sum(inputs) > 1 or "axis" not in form:
        return None
    if not any(inputs):
        return ("bias",), power
    output, entering = AXES.index(str(form["axis"])), inputs.index(1)
    if output == entering:
        return ("dK",), power
    # Below the diagonal gamma changes the reading; above it, a rotation of the triad and gamma together.
    return (("gamma",) if output > entering else ("dtheta", "gamma")), power

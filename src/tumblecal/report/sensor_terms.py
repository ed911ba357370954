"""The terms of a calibration file: what of a fitted model's effects belongs to the sensor, and what the file cannot hold."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

from tumblecal.chain import Chain, Where
from tumblecal.chain.nominal import UNIT_OF_LEAF
from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_terms import checked
from tumblecal.effects import Catalogue
from tumblecal.effects.effect import of_head
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.intrinsic import one_sensor
from tumblecal.ground.units import factor


_EQUATION = "A = diag(1 + dK) u + bias + sum of coefficient * product of u^powers"


@dataclass(frozen=True)
class FittedEffect:
    """An effect in a fitted chain: its id, each coefficient's term as a file holds it (`forms`; none: no file does), and the
    coefficients' names in that order. `head`: whether it acts before the triad's mount. `kept`: at known values."""

    id: str
    forms: tuple[dict, ...]
    names: tuple[str, ...]
    head: bool = False
    kept: bool = False

    @property
    def held(self) -> bool:
        """Whether a calibration file can hold it: of some coefficients without a form it would hold half an effect."""
        return len(self.forms) == len(self.names)


def effects_in(chain: Chain, where: Where, entries: Catalogue) -> Iterator[FittedEffect]:
    """The effects that a chain has beside the nominal links: those that are estimated, or kept at more than zero.

    **Arguments:**

    - `where`: the settings that the chain was made for. `entries`: the catalogue; what it does not know has its leaf's name.
    """
    acting = [leaf for leaf in chain.parameters if leaf.name not in UNIT_OF_LEAF and (leaf.free or leaf.value.any())]
    left = {leaf.name: leaf for leaf in acting}
    for effect in entries.values() if left else ():
        if effect.make is None or effect.lacking(where):
            continue
        links = effect.make(where)[:1]
        own = [left.pop(leaf.name) for leaf in Chain(links).parameters if leaf.name in left]
        if own:
            names = tuple([name for leaf in own for name in leaf.names])
            kept = not any(leaf.free for leaf in own)
            yield FittedEffect(effect.id, effect.forms, names, of_head(links), kept)
    yield from (FittedEffect(name, (), leaf.names) for name, leaf in left.items())


class SensorTerms:
    """The terms of one calibration file, collected from the effects of one fit or of several that are averaged."""

    def __init__(self):
        self._terms: dict[str, dict] = {}
        self._left: dict[str, None] = {}

    def add(self, effect: FittedEffect, fit: Fit, determined: Collection[str], share: float = 1.0) -> None:
        """Add an effect as it was fitted.

        **Arguments:**

        - `determined`: names of the coefficients that the data determine by themselves. `share`: the fit's in the average.

        **Raises:** `InputError` for a form of a user's effect that no calibration file may hold.
        """
        if not effect.held:
            self._left[effect.id] = None
            return
        values = dict(zip(fit.names, fit.values.tolist(), strict=True))
        units = dict(zip(fit.names, fit.units, strict=True))
        for leaf in fit.problem.chain.parameters if not values.keys() >= {*effect.names} else ():
            # Those that are kept at what the chain has.
            values = dict(zip(leaf.names, leaf.value.ravel().tolist(), strict=True)) | values
            units = dict.fromkeys(leaf.names, leaf.unit) | units
        for form, name in zip(effect.forms, effect.names, strict=True):
            if name not in self._terms:
                told = {"coefficient": 0.0, "determined": name in determined, "effect": effect.id}
                checked([form | told], f"effect {effect.id}: forms")
                self._terms[name] = {**form, **told}
            # Chains count time in seconds, files in hours.
            unit = units[name]
            per_hour = factor(unit, unit.replace("/s", "/h")) if form.get("per_hour") and "/s" in unit else 1.0
            self._terms[name]["coefficient"] += share * values[name] * per_hour

    @property
    def not_applied(self) -> list[str]:
        """Ids of the effects that the file cannot hold."""
        return list(self._left)

    @property
    def thermal(self) -> bool:
        """Whether one of the terms changes with the temperature."""
        return any(term.get("per_degc") for term in self._terms.values())

    def put_into(self, calibration: Calibration) -> Calibration:
        """The calibration with these terms; its provenance names the effects that it cannot hold, where there are any."""
        said = {"not_applied": self.not_applied} if self._left else {}
        extra = {"terms": list(self._terms.values()), "terms_equation": _EQUATION} if self._terms else {}
        return replace(calibration, provenance=calibration.provenance | said, extra=calibration.extra | extra)


def terms_of_chain(fit: Fit, chain: Chain, entries: Catalogue) -> SensorTerms:
    """The terms of the effects that a chain has as it was given, such as a rig's, at the values of a fit of it."""
    terms = SensorTerms()
    for effect in effects_in(chain, fit.problem.where, entries):
        terms.add(effect, fit, {name for name in effect.names if name not in fit.undetermined})
    return terms


def held_words(fit: Fit, chain: Chain, entries: Catalogue) -> Iterator[str]:
    """Which effects of a chain as it was given calibration.json holds as terms, and which it does not; nothing where no such
    file is made of the fit."""
    if not (fit.code.good and one_sensor(fit)):
        return
    effects = [effect for effect in effects_in(chain, fit.problem.where, entries) if not effect.kept]
    if held := [effect.id for effect in effects if effect.held]:
        yield f"terms of calibration.json, beside matrix and bias: {', '.join(held)}"
    yield from _left_words([effect for effect in effects if not effect.held])


def left_of_sensor(fit: Fit, entries: Catalogue, chain: Chain | None = None) -> Iterator[str]:
    """What calibration.json lacks of effects that are not the head's, in words; nothing where there are none.

    **Arguments:**

    - `chain`: as it was given; that of the fit where left out.
    """
    if fit.code.good and one_sensor(fit):
        effects = effects_in(fit.problem.chain if chain is None else chain, fit.problem.where, entries)
        yield from _left_words([effect for effect in effects if not (effect.held or effect.head)])


def _left_words(effects: Sequence[FittedEffect]) -> Iterator[str]:
    """Effects that were fitted and that calibration.json cannot hold, in words."""
    if effects:
        yield (
            "fitted, but not in calibration.json, which can hold no term for them: "
            f"{', '.join(effect.id for effect in effects)}; apply corrects without them, as where they are zero"
        )

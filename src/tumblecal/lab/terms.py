"""The terms of a calibration file: effects of a fitted model that belong to the sensor, and those that no file can contain."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from tumblecal.chain import Chain, Where, followings_of, nominal_chain, settings
from tumblecal.chain.nominal import UNIT_OF_LEAF
from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_terms import Term, contributions, terms_of
from tumblecal.data.not_applied import IDS, LOSSES, NotApplied, losses_words
from tumblecal.data.temperature_curves import TemperatureCurves
from tumblecal.effects import Catalogue, Effect
from tumblecal.effects.catalogue import catalogue, first_link
from tumblecal.effects.effect import MEAN, NO_FORMS, OF_HEAD, OF_MOUNT, reason_not_held
from tumblecal.estimation.curves_of_fit import curves_of
from tumblecal.estimation.fit import Fit
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.frames import gravity_in_head
from tumblecal.ground.soaks import soaks


_EQUATION = (
    "A = diag(1 + dK) u + bias + sum of coefficient * product of u^powers * (T - reference_degc)^degc_power, "
    "per_degc being a degc_power of 1"
)
# Order of the usual model.
_USUAL_ORDER = 3
_WORDS = {2: "second", 3: "third"}
_GRID = 401
# A form and its term are the same function within this share of the coefficient.
_SAME = 1e-9
# Without these the force in the frame of the triad is correct.
NOT_MISSED = (OF_HEAD, OF_MOUNT)
# Leaves that are no property of the sensor.
_OF_NO_SENSOR = {"dtheta": OF_MOUNT, "dbeta": OF_HEAD, "levelling": OF_HEAD}
# A signal of an effect in the readings of the data, g; None if unknown.
Signal = Float[np.ndarray, "positions 3"] | None


@dataclass(frozen=True)
class FittedEffect:
    """An effect in a fitted chain: its id, the term of each coefficient in a file (`forms`; none: no file contains it), and the
    names of the coefficients in that order. `kept`: at known values. `reason`: why no file contains it."""

    id: str
    forms: tuple[dict[str, Any], ...]
    names: tuple[str, ...]
    kept: bool = False
    reason: str = NO_FORMS

    @property
    def held(self) -> bool:
        """Whether a calibration file can contain it: every coefficient needs a form."""
        return len(self.forms) == len(self.names)


def effects_in(chain: Chain, where: Where, entries: Catalogue) -> Iterator[FittedEffect]:
    """The effects of a chain in addition to the nominal links: those that are estimated, or kept at more than zero.

    `where`: the settings that the chain was made for. `entries`: the catalogue; an effect without an entry has the name of its
    leaf.
    """
    nominal = {*UNIT_OF_LEAF, *(leaf.change.name for leaf in followings_of(chain))}
    acting = [leaf for leaf in chain.parameters if leaf.name not in nominal and (leaf.free or leaf.value.any())]
    remaining = {leaf.name: leaf for leaf in acting}
    # Most leaves have the id of their effect; making the links of every effect takes milliseconds.
    candidates = [id for id in entries if id in remaining] if remaining.keys() <= entries.keys() else entries
    for effect in map(entries.__getitem__, candidates):
        if not remaining:
            return
        if effect.make is None or effect.lacking(where):
            continue
        links = effect.make(where)[:1]
        leaves = [remaining.pop(leaf.name) for leaf in Chain(links).parameters if leaf.name in remaining]
        if leaves:
            names, kept = [name for leaf in leaves for name in leaf.names], not any(leaf.free for leaf in leaves)
            yield FittedEffect(effect.id, effect.forms, tuple(names), kept, reason_not_held(effect, links))
    yield from (FittedEffect(name, (), leaf.names) for name, leaf in remaining.items())


@dataclass(frozen=True)
class SensorTerms:
    """The terms of one calibration file, collected from the effects of one fit or of several.

    - `curves`: the parameters of the sensor over temperature. `by_name`: the terms by the names of their coefficients.
    - `lacking`: by id, the effects that the file cannot contain, the reasons, and their sizes in the data.
    """

    curves: TemperatureCurves | None = None
    by_name: dict[str, Term] = field(default_factory=dict)
    lacking: dict[str, NotApplied] = field(default_factory=dict)

    def has(self, id: str) -> bool:
        """Whether an effect was added."""
        return id in self.lacking or any(term.effect == id for term in self.by_name.values())

    def add(self, effect: FittedEffect, fit: Fit, determined: Collection[str], signal: Signal = None) -> None:
        """Add an effect as it was fitted.

        `determined`: names of the coefficients that the data determine separately. `signal`: contribution of the effect to the
        readings of the data, g.

        **Raises:** `InputError` for a form of a user effect that no calibration file can contain.
        """
        if not effect.held:
            sizes = () if signal is None else (np.max(np.abs(signal)), np.sqrt(np.mean(np.square(signal))))
            self.lacking[effect.id] = NotApplied(effect.id, effect.reason, *(1e3 * float(size) for size in sizes))
            return
        values, units = fit.stated_values, _units(fit.problem.chain) | dict(zip(fit.names, fit.units, strict=True))
        for form, name in zip(effect.forms, effect.names, strict=True):
            self.by_name[name] = term_of_form(
                form,
                fit.problem.where,
                effect=effect.id,
                determined=name in determined,
                coefficient=values[name],
                unit=units[name],
            )

    @property
    def thermal(self) -> bool:
        """Whether the file corrects for temperature."""
        return self.curves is not None or any(term.thermal for term in self.by_name.values())

    def losses(self, temperature_degc: Float[np.ndarray, " positions"] | None) -> list[NotApplied]:
        """All corrections that the file lacks: `lacking`, and an order of the dependence on temperature that the data, at
        these temperatures, do not determine."""
        open_order = undetermined_order([*self.by_name.values()], temperature_degc, self.curves)
        return [*self.lacking.values(), *filter(None, [open_order])]

    def put_into(
        self, calibration: Calibration, temperature_degc: Float[np.ndarray, " positions"] | None
    ) -> Calibration:
        """The calibration with these terms; its provenance lists the missing corrections, if any.

        `temperature_degc`: of the data.
        """
        stated = {IDS: [*self.lacking], LOSSES: [loss.record() for loss in self.losses(temperature_degc)]}
        provenance = calibration.provenance | {key: entry for key, entry in stated.items() if entry}
        calibration = replace(calibration, provenance=provenance)
        if not self.by_name:
            return calibration
        calibration = calibration.with_terms([*self.by_name.values()])
        return replace(calibration, extra=calibration.extra | {"terms_equation": _EQUATION})


def terms_of_chain(
    fit: Fit, chain: Chain, entries: Catalogue, signal: Callable[[FittedEffect], Signal] | None = None
) -> SensorTerms:
    """The terms of the effects in a given chain, such as that of a rig, at the values of a fit of it.

    `signal`: contribution of an effect to the readings; by default from the Jacobian of the fit.
    """
    terms = SensorTerms(curves_of(fit))
    for leaf in followings_of(chain):
        if leaf.change.free and (reason := _OF_NO_SENSOR.get(leaf.reference.name)):
            effect = FittedEffect(leaf.change.name, (), leaf.change.names, reason=reason)
            terms.add(effect, fit, (), signal=_signal(fit, effect))
    for effect in effects_in(chain, fit.problem.where, entries):
        if effect.id in entries:
            require_forms(entries[effect.id])
        added = _signal(fit, effect) if signal is None else signal(effect)
        terms.add(effect, fit, {name for name in effect.names if name not in fit.undetermined}, signal=added)
    return terms


def _units(chain: Chain) -> dict[str, str]:
    """Units of all coefficients of a chain."""
    return {name: leaf.unit for leaf in chain.parameters for name in leaf.names}


def _signal(fit: Fit, effect: FittedEffect) -> Signal:
    """Contribution of an effect to the readings of a fit, to first order, g; None for one that is not estimated."""
    moved = [k for k, name in enumerate(fit.names) if name in effect.names and fit.units[k] != "s"]
    if not moved or fit.jacobian.shape[1:] != (len(fit.names),):
        return None
    rows = fit.jacobian[:, moved] @ (fit.values[moved] / fit.problem.scales[moved])
    return fit.problem.unwhitened(rows[: fit.problem.readings.size])


def term_of_form(
    form: Mapping[str, Any],
    where: Where,
    *,
    effect: str,
    determined: bool = True,
    coefficient: float = 0.0,
    unit: str = "",
) -> Term:
    """A form of an effect as a term of a calibration file.

    `coefficient`, `unit`: as in the chain, which uses seconds; a file uses hours.

    **Raises:** `InputError` for a form that no calibration file can contain.
    """
    stated = {**form, "coefficient": 0.0, "effect": effect, "determined": determined}
    if stated.get("reference_degc") == MEAN and where.temperature_degc is not None:
        stated["reference_degc"] = float(np.mean(np.asarray(where.temperature_degc)))
    (term,) = terms_of([stated], f"effect {effect}: forms")
    return replace(term, coefficient=coefficient * (3600.0 if term.per_hour and "/s" in unit else 1.0))


def require_forms(effect: Effect) -> None:
    """Compare the forms of a user effect with the contribution of its link to the readings, at many attitudes, times and
    temperatures.

    **Raises:** `InputError` for a form that is a different function, as a calibration file would correct with the form.
    """
    if not effect.forms or effect.make is None or catalogue().get(effect.id) is effect:
        return
    alpha, beta = (
        each.ravel() for each in np.radians(np.meshgrid(np.arange(5, 360, 30.0), (-80.0, -45.0, 10.0, 50.0)))
    )
    number = np.arange(alpha.size)
    degc, time_s = np.linspace(-20.0, 60.0, alpha.size)[number * 7 % alpha.size], np.linspace(0.0, 7200.0, alpha.size)
    more = {"run": [str(k % 2) for k in number], "approach": np.where(number % 2, 1.0, -1.0)}
    where, f = settings(alpha, beta, time_s=time_s, temperature_degc=degc, **more), gravity_in_head(alpha, beta)
    link = first_link(effect, where)
    chain = nominal_chain(where) + link
    for k, (form, name) in enumerate(zip(effect.forms, Chain((link,)).names, strict=True)):
        place = chain.names.index(name)
        scale, unit, vector = chain.scales[place], chain.units[place], np.zeros(len(chain.names))
        without, vector[place] = np.asarray(chain.at(vector)(where)), scale
        added, stated = (np.asarray(chain.at(vector)(where)) - without) / scale, np.zeros_like(f)
        term = term_of_form(form, where, effect=effect.id, coefficient=1.0, unit=unit)
        stated[:, AXES.index(term.axis)] = term.factor(degc, time_s) * term.of_inputs(np.asarray(f))
        if np.max(np.abs(added - stated)) > _SAME * max(1.0, float(np.max(np.abs(added)))):
            raise InputError(
                f"effect {effect.id}: forms.{k}: differs from the function of the effect (up to "
                f"{np.max(np.abs(stated)):.3g} instead of {np.max(np.abs(added)):.3g} for a coefficient of 1 {unit}). Correct "
                "the form, or omit forms"
            )


def held_words(calibration: Calibration | None, found: Collection[str] = ()) -> list[str]:
    """The effects that a calibration file contains as terms, without those `found`; none without a calibration."""
    terms = calibration.terms if calibration else ()
    ids = dict.fromkeys(term.effect for term in terms if term.effect and term.effect not in found)
    return [f"terms of calibration.json, in addition to matrix and bias: {', '.join(ids)}"] if ids else []


def lacking_words(calibration: Calibration | None, *, of_sensor: bool = False) -> list[str]:
    """Corrections that a calibration file does not contain, with reasons and sizes; none without a calibration.

    `of_sensor`: without effects of the head and of the mount, which the frame of the triad does not need.
    """
    losses = calibration.not_applied if calibration else ()
    return losses_words([loss for loss in losses if not (of_sensor and loss.reason in NOT_MISSED)])


def undetermined_order(
    terms: Sequence[Term],
    temperature_degc: Float[np.ndarray, " positions"] | None,
    curves: TemperatureCurves | None = None,
) -> NotApplied | None:
    """The order of the dependence on temperature that is not determined, with the size (mg) that it has between the
    measured temperatures if it changes the readings over their range as much as terms and curves do; None if third order, that
    of the usual model of an accelerometer, is determined.

    A polynomial that is zero at every temperature measured changes no reading of the data: one of second order with two
    temperatures, one of third order with three.
    """
    thermal = [term for term in terms if term.thermal]
    if temperature_degc is None or not (thermal or curves):
        return None
    levels = np.array(soaks(temperature_degc))
    order = len(levels)
    if not 1 < order <= _USUAL_ORDER:
        return None
    half, middle = np.ptp(levels) / 2, (levels[0] + levels[-1]) / 2
    grid = np.linspace(-1, 1, _GRID)
    hidden = np.prod(grid[:, None] - (levels - middle) / half, axis=1)
    # Half of the change of a reading at 1 g over the temperatures, of the axis on which it is largest.
    degc, sizes = middle + half * grid, np.array([term.coefficient for term in thermal])
    along = np.tensordot(sizes, contributions(thermal, np.ones((1, 3)), degc)[:, :, 0], 1)
    if curves is not None:
        along += curves.at(degc)[:, :6].reshape(-1, 2, 3).sum(axis=1)
    hidden *= 1e3 * float(np.max(np.ptp(along, axis=0))) / 2
    at = ", ".join(f"{level:.3g}" for level in levels)
    return NotApplied(
        f"temperature^{order}",
        f"not determined: a {_WORDS[order]}-order dependence of the same size as the known one would be zero at the "
        f"{order} temperatures measured ({at} degC) and act between them",
        float(np.max(np.abs(hidden))),
        float(np.sqrt(np.mean(hidden**2))),
    )

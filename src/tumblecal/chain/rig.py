"""A rig: plan, links, truth, noise and priors, as described by a `configs/*.toml` file."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from tumblecal.chain.chain import Chain
from tumblecal.chain.considered import Considered
from tumblecal.chain.head_ability import HeadAbility
from tumblecal.chain.link import Link
from tumblecal.chain.nominal import NOMINAL, Leaf, nominal_link
from tumblecal.chain.plan import Plan
from tumblecal.chain.rig_temperature import RigTemperature
from tumblecal.chain.where import Where, settings, with_visits
from tumblecal.ground.errors import InputError
from tumblecal.ground.frames import rotation_matrix
from tumblecal.ground.showing import Screen, Shown
from tumblecal.ground.toml_faults import located


EffectLinks = Mapping[str, Callable[[Where], Link]]


@dataclass(frozen=True, repr=False)
class Rig(Shown):
    """A dividing head with a triad, and the known properties of both.

    `truth`: true values by leaf or parameter name (base units), for simulation; zero where absent. `priors`: mean and
    sd by leaf or parameter name. `usual`: the largest plausible size by the same names. `considered`: inputs of its
    budget. `temperature`: leaves that follow temperature. `mounts`: intended rotation of each mounting, deg about x, y, z.
    `ability`: what the head can do, for the design of a plan; None if the file has no table `[head]`.
    """

    title: str
    plan: Plan
    links: tuple[str, ...] = NOMINAL
    leaves: Mapping[str, Leaf] = field(default_factory=dict)
    mounts: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    effects: tuple[str, ...] = ()
    effect_links: EffectLinks = field(default_factory=dict)
    truth: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    noise_sd_g: float | None = None
    priors: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    usual: Mapping[str, float] = field(default_factory=dict)
    considered: Mapping[str, Considered] = field(default_factory=dict)
    temperature: RigTemperature = field(default_factory=RigTemperature)
    ability: HeadAbility | None = None
    source: str = "rig"

    def screen(self) -> Screen:
        """The contents of its file, one line each."""
        plan = self.plan
        settings_of = "beta " + ", ".join(f"{beta:g}" for beta in dict.fromkeys(plan.beta_deg)) + " deg"
        facts = {
            "plan": f"{len(plan)} positions; {settings_of}; runs {', '.join(dict.fromkeys(plan.runs))}; mountings "
            + ", ".join(dict.fromkeys(plan.mounts)),
            "links": ", ".join((*self.links, *self.effects)),
            "temperature": self.temperature.words,
            "truth": "; ".join(
                f"{name} {', '.join(f'{v:.4g}' for v in values)}" for name, values in self.truth.items()
            ),
            "noise": "" if self.noise_sd_g is None else f"{1e3 * self.noise_sd_g:.4g} mg",
            "priors": "; ".join(f"{name} {mean:.4g} +- {sd:.4g}" for name, (mean, sd) in self.priors.items()),
        }
        lines = [f"{name}: {fact}" for name, fact in facts.items() if fact]
        return Screen(f"Rig {self.title or self.source}", notes=[*lines, "values in base units: rad, g, 1"])

    @property
    def tables_of_head(self) -> tuple[str, ...]:
        """Tables of the head that state its noise and repeatability: `[head.noise]`, `[head.repeatability]`."""
        if self.ability is None:
            return ()
        again = self.ability.repeatability
        stated = {
            "[head.noise]": self.ability.slow_noise.any,
            "[head.repeatability]": again.pitch is not None or again.mount is not None,
        }
        return tuple(name for name, given in stated.items() if given)

    @property
    def where(self) -> Where:
        """The settings of the plan's positions."""
        plan = self.plan
        where = settings(
            plan.alpha,
            plan.beta,
            run=plan.runs,
            mount=plan.mounts,
            time_s=plan.time_s,
            temperature_degc=plan.temperature_degc,
            approach=plan.approach,
        )
        return with_visits(where, {leaf.by for leaf in self.leaves.values()})

    def chain(self, where: Where) -> Chain:
        """The rig's chain for a set of positions: its links, then its effects, coefficients zero.

        **Raises:** `InputError` if the data have a mounting that the rig does not describe, or lack the temperatures that its
        leaves follow.
        """
        with self._faults_of_temperature():
            leaves = self.temperature.into(self.leaves, where)
        return self._made(where, leaves)

    def _made(self, where: Where, leaves: Mapping[str, Leaf]) -> Chain:
        where = with_visits(where, {leaf.by for leaf in leaves.values()})
        rotations = partial(self._rotations, where)
        chain = Chain(tuple(nominal_link(name, where, leaves, rotations) for name in self.links))
        for name in self.effects:
            chain = chain + self.effect_links[name](where)
        return chain

    def true_chain(self, where: Where) -> Chain:
        """The rig's chain with its leaves at their true values; reference temperature and range are those of the plan."""
        with self._faults_of_temperature():
            leaves = self.temperature.into(self.leaves, self.where, fitted=False)
        chain = self._made(where, leaves)
        values = self.temperature.truth(chain)
        for name, numbers in self.truth.items():
            members = next((leaf.names for leaf in chain.parameters if leaf.name == name), (name,))
            if len(members) != len(numbers):
                raise InputError(
                    f"{self.source}: truth.{name}: {len(numbers)} values, but the plan makes {len(members)} "
                    f"of them ({', '.join(members)})"
                )
            values |= dict(zip(members, numbers, strict=True))
        try:
            return chain.named(values)
        except KeyError as error:
            raise InputError(f"{self.source}: truth: {error.args[0]}") from error

    @contextmanager
    def _faults_of_temperature(self) -> Iterator[None]:
        """Add the file and the table to faults that begin with a leaf."""
        try:
            yield
        except InputError as error:
            faults = [f"{self.source}: temperature.{fault}" for fault in error.faults]
            raise InputError(located(Path(self.source), faults)) from error

    def _rotations(self, where: Where) -> np.ndarray | None:
        """The intended rotation of every mounting of the data, or None if none is turned."""
        if not self.mounts:
            return None
        labels = [name.removeprefix("@mount=") for name in where.names("mount")]
        missing = [label for label in labels if label not in self.mounts]
        if missing:
            raise InputError(
                f"{self.source}: mounts: no entry for mount {', '.join(missing)} of the data; add [mounts.{missing[0]}]"
            )
        return np.stack([rotation_matrix(np.radians(self.mounts[label])) for label in labels])

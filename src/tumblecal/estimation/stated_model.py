"""The model that is stated for position files: rig or inferred plan, noise, priors, fixed parameters, measured head."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tumblecal.chain import Chain
from tumblecal.data import PositionSet, read_positions
from tumblecal.data.position_comments import ATTITUDES, BY_HEAD
from tumblecal.data.repeats import in_bounds
from tumblecal.data.sensor_parameters import leaf_of
from tumblecal.effects.catalogue import Catalogue, catalogue, first_link
from tumblecal.estimation.methods import Calibrated, all_methods, checked
from tumblecal.estimation.plausibility import Implausible
from tumblecal.estimation.position_problem import default_chain, problem_of, where_of
from tumblecal.estimation.priors import Priors
from tumblecal.estimation.problem import Problem
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import Gravity
from tumblecal.words import sentences


if TYPE_CHECKING:
    from tumblecal.chain.head_ability import HeadAbility
    from tumblecal.chain.head_file import MeasuredHead
    from tumblecal.chain.rig import Rig

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class StatedModel:
    """A model as it is stated: every part has a default that follows from the data.

    - `rig`, `head`: files. `noise_sd`: of a reading, g. `priors`, `fixed`: of parameters. `entries`: the catalogue of effects.
    - `gravity`, `columns`, `attitudes`: of position files. `stated_in`: file or option of each prior.
    """

    rig: "Rig | None" = None
    noise_sd: float | None = None
    priors: Priors = field(default_factory=dict)
    fixed: frozenset[str] = frozenset()
    head: "MeasuredHead | None" = None
    entries: Catalogue = field(default_factory=catalogue)
    gravity: Gravity | None = None
    columns: Mapping[str, str] | None = None
    attitudes: str | None = None
    stated_in: Mapping[str, str] = field(default_factory=dict)

    @property
    def usual(self) -> Mapping[str, float]:
        """The largest usual sizes of parameters that the rig states, base units."""
        return self.rig.usual if self.rig else {}

    def read(self, path: Path, *, check_size: bool = True, one_of_several: bool = False) -> PositionSet:
        """The positions of a file, under the stated gravity.

        **Raises:** `InputError` for a file that is not a position file.
        """
        stated = {"names": self.columns, "attitudes": self.attitudes}
        data = read_positions(path, check_size=check_size, one_of_several=one_of_several, **stated)
        if data.attitudes is None and (self.head or (self.rig and "free_attitude" not in self.rig.links)):
            data = replace(data, comments=data.comments | {ATTITUDES: BY_HEAD})
        _log.debug("%s: %d positions, columns sd: %s", path, len(data), "no" if data.sd is None else "yes")
        return data if self.gravity is None else data.under(self.gravity)

    @property
    def described(self) -> bool:
        """Whether the chain differs from the default one."""
        return self.rig is not None or self.head is not None or bool(self.fixed)

    def known(self, data: PositionSet) -> bool:
        """Whether the noise of these data is stated."""
        return self.noise_sd is not None or data.sd is not None

    def calibrated(self, data: PositionSet) -> Calibrated:
        """These positions by all methods.

        **Raises:** `InputError` for positions that cannot determine the parameters, and for set-up errors that influence a
        calibration at rest: it is for the columns as recorded.
        """
        chain = self.chain(data, known=self.known(data)) if self.rig else None
        data, setup_errors = checked(data, chain, self.entries)
        made = all_methods(self.problem(data), usual=self.usual, by_columns=self.noise_sd is None)
        unusual = self.with_sources(made.implausible, made.exact.problem)
        return replace(made, setup_errors=tuple(setup_errors), entries=self.entries, implausible=unusual)

    def with_sources(self, listed: Sequence[Implausible], problem: Problem) -> tuple[Implausible, ...]:
        """Implausible parameters of a fit to this problem; those that contradict a statement, with its option or file."""
        stated = [one for one in listed if one.stated is not None]
        named = {} if self.head is None or not stated else self.head.priors(problem.chain, problem.where)
        by_head = {name for names in named for name in names}

        def source(name: str) -> str:
            prior = [self.stated_in[key] for key in (name, leaf_of(name)) if key in self.stated_in][:1]
            return " and ".join([*prior, *([f"--head {self.head.source}"] if self.head and name in by_head else [])])

        return tuple([replace(one, stated_in=source(one.parameter)) if one in stated else one for one in listed])

    def problem(self, data: PositionSet) -> Problem:
        """The fit of the stated chain to these data."""
        known = self.known(data)
        chain = self.chain(data, known=known)
        problem = problem_of(data, chain, noise_sd=self.noise_sd, priors=self.stated(chain, data, known=known))
        ability, _ = self.slow_noise(data)
        if ability is None:
            return problem
        from tumblecal.estimation.slow_noise import with_slow_noise

        return with_slow_noise(problem, ability)

    def slow_noise(self, data: PositionSet, *, sampled: bool = False) -> "tuple[HeadAbility | None, str]":
        """The head whose slow noise (`[head.noise]` of the rig) these data have, or why it cannot be used; None and "" if
        none is stated.

        **Arguments:**

        - `sampled`: whether raw samples state the noise.
        """
        ability = None if self.rig is None else self.rig.ability
        if ability is None or not ability.slow_noise.any:
            return None, ""
        reasons = {
            "the noise is that of --samples": sampled,
            'the noise of a dwell is not stated; add [noise] sd = "0.1 mg" to the rig, or give --noise-sd': self.noise_sd
            is None,
            "no column time_s": data.time_s is None,
        }
        reason = next((words for words, holds in reasons.items() if holds), "")
        return None if reason else ability, reason

    def notes(self, data: PositionSet, *, sampled: bool = False) -> list[str]:
        """What a user should know of this model for these data: differences from the designed plan of the rig, and parts of the
        rig that are not used."""
        if self.rig is None:
            return []
        from tumblecal.estimation.planned_positions import compared_with_plan, is_designed

        notes, (_, reason) = [], self.slow_noise(data, sampled=sampled)
        if is_designed(self.rig):
            notes += compared_with_plan(self.rig, data)
        return [*notes, *(sentences("positions/slow_noise_unused", reason=reason) if reason else [])]

    def for_diagnosis(self, data: PositionSet, most: int | None = None, *, sampled: bool = False) -> dict[str, Any]:
        """Positions, repeats averaged if there are many, with their model and noise: arguments of a `Diagnoser`, and `words` on
        the averaging.

        **Arguments:** as of `in_bounds`.

        **Raises:** `InputError` for more positions than allowed.
        """
        bounded = in_bounds(data, self.noise_sd, most, sampled=sampled)
        known = bounded.noise_sd is not None or self.known(bounded.data) or sampled
        chain = self.chain(bounded.data, known=known) if self.described else None
        return {
            "words": bounded.words,
            "data": bounded.data,
            "chain": chain,
            "noise_sd": bounded.noise_sd,
            "priors": self.priors if chain is None else self.stated(chain, bounded.data, known=known),
            "ability": self.slow_noise(bounded.data, sampled=sampled)[0],
        }

    def chain(self, data: PositionSet, *, known: bool) -> Chain:
        """The chain to fit to these data; `known`: whether their noise is known.

        **Raises:** `InputError` for an effect of the rig that can only be simulated.
        """
        where = where_of(data)
        chain = self.rig.chain(where) if self.rig else default_chain(data)
        chain = chain.fixed({*self.fixed}) if self.fixed else chain
        for leaf in chain.free:
            effect = self.entries.get(leaf.name)
            if effect is not None and effect.found_as:
                raise InputError(
                    f"{self.rig.source if self.rig else data.source}: chain.effects: {effect.id} can be simulated but not "
                    f"fitted: {effect.not_held}. tumblecal diagnose finds it as: {effect.found_as}. Remove it from the rig"
                )
        chain = chain.started()
        if self.head is None:
            return chain
        return self.head.extended(chain, where, lambda id, at: first_link(self.entries[id], at), known=known)

    def stated(self, chain: Chain, data: PositionSet, *, known: bool) -> Priors:
        """The priors of the parameters of that chain."""
        where, stated = where_of(data, chain), self.priors
        if known and self.rig is not None and self.rig.ability is not None:
            from tumblecal.estimation.visits import with_repeatability

            stated = with_repeatability(stated, self.rig.ability.repeatability, chain, where)
        return dict(stated.items()) | self.head.priors(chain, where) if self.head and known else stated

    def of_head(self, problem: Problem) -> dict[str, Any]:
        """The measured errors of the head, for the provenance of a fit to this problem."""
        return {} if self.head is None else self.head.record(problem.chain, problem.where, known=problem.known)

"""The model of a command's options: rig or inferred plan, stated noise, priors, fixed parameters."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tumblecal.chain import Chain
from tumblecal.chain.following import CHANGE
from tumblecal.chain.nominal import UNIT_OF_LEAF, unit_in
from tumblecal.cli.command import warn
from tumblecal.cli.options import ModelOptions
from tumblecal.data import PositionSet, read_positions
from tumblecal.data.overwriting import given_once
from tumblecal.data.position_comments import ATTITUDES, BY_HEAD
from tumblecal.data.repeats import copied_positions
from tumblecal.data.sensor_parameters import leaf_of
from tumblecal.data.table import KNOWN, READINGS, likely_meant
from tumblecal.effects.catalogue import Catalogue, catalogue, first_link, links_and_units
from tumblecal.estimation import Problem, default_chain, problem_of, where_of
from tumblecal.estimation.methods import Calibrated, all_methods, checked
from tumblecal.estimation.plausibility import Implausible
from tumblecal.estimation.priors import Priors
from tumblecal.ground.counted import counted, shortened
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import Gravity, gravity_of_option
from tumblecal.ground.option_texts import pairs, sd_of_reading, sizes
from tumblecal.ground.suggested_command import suggested
from tumblecal.ground.toml_faults import located


if TYPE_CHECKING:
    from tumblecal.chain.head_ability import HeadAbility
    from tumblecal.chain.head_file import MeasuredHead
    from tumblecal.chain.rig import Rig

_log = logging.getLogger(__name__)
_MOST_COPIES = 3
# This many consecutive rows of one name and setting are samples of one dwell.
_LIKE_SAMPLES = 16


@dataclass(frozen=True)
class StatedModel:
    """Model of `--rig`, `--noise-sd`, `--prior`, `--fix`, `--head`, `--gravity`, `--columns`, `--effects` and `--attitudes`."""

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

    @classmethod
    def of(cls, options: ModelOptions) -> "StatedModel":
        """Read the options.

        **Raises:** `InputError` for an option that cannot be used.
        """
        entries, rig, head = catalogue(*options.effects), None, None
        if options.rig is not None:
            from tumblecal.effects.rig_with_effects import read_rig_with_effects

            rig = read_rig_with_effects(options.rig, entries)
        if options.head is not None:
            from tumblecal.chain.head_file import read_head

            head = read_head(options.head, *links_and_units(entries))
        units = UNIT_OF_LEAF | (links_and_units(entries)[1] if rig and rig.effects else {})
        given = sizes("--prior ", options.prior, unit_in(units), "'dbeta=3 arcmin'", zero=True)
        known = [*UNIT_OF_LEAF, *(leaf + CHANGE for leaf in (rig.temperature.leaves if rig else ()))]
        if unknown := sorted({*options.fix} - {*known}):
            raise InputError(f"--fix {unknown[0]}: no such parameter; parameters: {', '.join(known)}")
        noise_sd = sd_of_reading("--noise-sd", options.noise_sd) or (rig.noise_sd_g if rig else None)
        if rig and noise_sd == 0:
            fault = (
                f"{rig.source}: noise.sd: readings without noise cannot be weighted; write their standard deviation, remove "
                "[noise] to estimate it from the residuals, or give --noise-sd"
            )
            raise InputError(located(Path(rig.source), [fault]))
        columns = pairs("--columns", options.columns or "", "ax_g=AccX,ay_g=AccY,az_g=AccZ")
        return cls(
            rig=rig,
            noise_sd=noise_sd,
            priors={**(rig.priors if rig else {}), **{name: (0.0, size) for name, size in given.items()}},
            fixed=frozenset(options.fix),
            head=head,
            entries=entries,
            gravity=None if options.gravity is None else gravity_of_option(options.gravity),
            columns=columns or None,
            attitudes=options.attitudes,
            stated_in={name: f"{options.rig} (priors.{name})" for name in (rig.priors if rig else ())}
            | {name: f"--prior {name}" for name in given},
        )

    def read(self, path: Path, *, check_size: bool = True, one_of_several: bool = False) -> PositionSet:
        """The positions of a file, under the stated gravity; rows that look copied are reported.

        **Raises:** `InputError` for a file that is not a position file, or that has raw samples.
        """
        stated = {"names": self.columns, "attitudes": self.attitudes}
        data = read_positions(path, check_size=check_size, one_of_several=one_of_several, **stated)
        if data.attitudes is None and (self.head or (self.rig and "free_attitude" not in self.rig.links)):
            data = replace(data, comments=data.comments | {ATTITUDES: BY_HEAD})
        _log.debug("%s: %d positions, columns sd: %s", path, len(data), "no" if data.sd is None else "yes")
        free = [name for name in KNOWN if name not in (*data.columns, *READINGS)]
        for name in data.ignored:
            if meant := likely_meant(name, free):
                cure = f"did you mean {meant}? Rename it, or give --columns {meant}={name}"
                warn(path, [f"column {name} is not used; {cure}"])
        if len(data) >= _LIKE_SAMPLES * data.stretches:
            reduced = Path("reduced")
            raise InputError(
                f"{path}: {len(data)} rows, but only {counted(data.stretches, 'stretch')} of one position each, so these look "
                f"like raw samples. Reduce them first, then give {reduced / 'positions.csv'}: "
                f"{suggested('reduce', path, '--out', reduced)}"
            )
        if copies := [f"{name} and {first}" for name, first in copied_positions(data)]:
            listed = shortened(copies, _MOST_COPIES)
            warn(path, [f"identical rows: positions {listed}; a copied row is weighted twice: remove it"])
        return data if self.gravity is None else data.under(self.gravity)

    @property
    def described(self) -> bool:
        """Whether the chain differs from the default one."""
        return self.rig is not None or self.head is not None or bool(self.fixed)

    def known(self, data: PositionSet) -> bool:
        """Whether the noise of these data is stated."""
        return self.noise_sd is not None or data.sd is not None

    def read_each(
        self, paths: Sequence[Path], *, together: bool, check_size: bool = True
    ) -> list[PositionSet | InputError]:
        """The positions of several files; in a batch, the fault of each file that cannot be read. Copies of a file are
        reported.

        **Raises:** `InputError` for a file given twice, or, if all files belong together, one that cannot be read.
        """
        for path, copied in given_once(paths).items():
            warn(path, [copied])
        read: list[PositionSet | InputError] = []
        for path in paths:
            try:
                read.append(self.read(path, check_size=check_size, one_of_several=len(paths) > 1))
            except InputError as fault:
                if together:
                    raise
                read.append(fault)
        return read

    def compare_with_plan(self, read: Sequence[PositionSet | InputError]) -> None:
        """Print the differences between each set of positions and the designed plan of the rig, if it is one."""
        if self.rig is None:
            return
        from tumblecal.estimation.planned_positions import compared_with_plan, is_designed

        for positions in read:
            if is_designed(self.rig) and not isinstance(positions, InputError):
                warn(positions.source, compared_with_plan(self.rig, positions))

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
        ability = self.slow_noise(data)
        if ability is None:
            return problem
        from tumblecal.estimation.slow_noise import with_slow_noise

        return with_slow_noise(problem, ability)

    def slow_noise(self, data: PositionSet, *, sampled: bool = False) -> "HeadAbility | None":
        """The head whose slow noise (`[head.noise]` of the rig) these data have; None if none is stated. If it cannot be used,
        a warning states the reason.

        **Arguments:**

        - `sampled`: whether raw samples state the noise.
        """
        ability = None if self.rig is None else self.rig.ability
        if ability is None or not ability.slow_noise.any:
            return None
        reasons = {
            "the noise is that of --samples": sampled,
            'the noise of a dwell is not stated; add [noise] sd = "0.1 mg" to the rig, or give --noise-sd': self.noise_sd
            is None,
            "no column time_s": data.time_s is None,
        }
        if reason := next((words for words, holds in reasons.items() if holds), ""):
            warn(data.source, [f"[head.noise] of the rig is not used: {reason}"])
        return None if reason else ability

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

"""The model of a command's options: rig or inferred plan, stated noise, priors, fixed parameters."""

import logging
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from tumblecal.chain import Chain
from tumblecal.chain.following import CHANGE
from tumblecal.chain.head_ability import HeadAbility
from tumblecal.chain.head_file import MeasuredHead, read_head
from tumblecal.chain.nominal import UNIT_OF_LEAF
from tumblecal.chain.rig import Rig
from tumblecal.chain.rig_file import unit_of_parameter
from tumblecal.cli.options import ModelOptions
from tumblecal.cli.output import warn
from tumblecal.data import PositionSet, read_positions
from tumblecal.data.position_comments import ATTITUDES, BY_HEAD
from tumblecal.data.repeats import copied_positions
from tumblecal.data.same_files import given_once
from tumblecal.data.sensor_parameters import leaf_of
from tumblecal.data.table import KNOWN, READINGS, likely_meant
from tumblecal.effects.catalogue import (
    Catalogue,
    catalogue,
    first_link,
    links_and_units,
    read_rig_with_effects,
)
from tumblecal.estimation import Problem, default_chain, problem_of, where_of
from tumblecal.estimation.methods import checked
from tumblecal.estimation.planned_positions import compared_with_plan, is_designed
from tumblecal.estimation.plausibility import Implausible
from tumblecal.estimation.priors import Priors
from tumblecal.estimation.setup_error import SetupError
from tumblecal.estimation.slow_noise import with_slow_noise
from tumblecal.estimation.visits import with_repeatability
from tumblecal.ground.counted import counted
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import Gravity, gravity_of_option
from tumblecal.ground.suggested_command import suggested
from tumblecal.ground.toml_faults import located
from tumblecal.ground.units import quantity, reading_sd


_log = logging.getLogger(__name__)
_MOST_COPIES = 3
# This many consecutive rows of one name and setting are samples of one dwell.
_LIKE_SAMPLES = 16


def _column_names(text: str) -> dict[str, str]:
    """The columns of `--columns`: standard name to name in the file.

    **Raises:** `InputError` for a text that is not a list of NAME=COLUMN.
    """
    pairs = [part.partition("=") for part in text.split(",")]
    if not all(name.strip() and equals and column.strip() for name, equals, column in pairs):
        raise InputError(f"--columns {text}: write NAME=COLUMN,..., such as ax_g=AccX,ay_g=AccY,az_g=AccZ")
    names = [name.strip() for name, *_ in pairs]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"--columns {text}: {name} is given twice; keep one")
    return {name.strip(): column.strip() for name, _, column in pairs}


def stated_noise_sd(option: str | None, rig: Rig | None) -> float | None:
    """Standard deviation of a reading, g: `--noise-sd`, or that of the rig; None if neither states it.

    **Raises:** `InputError` for a value that gives no weights.
    """
    if option is not None:
        try:
            return reading_sd(option)
        except InputError as error:
            raise InputError(f"--noise-sd: {error}") from error
    if rig is not None and rig.noise_sd_g == 0:
        fault = (
            f"{rig.source}: noise.sd: readings without noise cannot be weighted; write their standard deviation, remove "
            "[noise] to estimate it from the residuals, or give --noise-sd"
        )
        raise InputError(located(Path(rig.source), [fault]))
    return None if rig is None else rig.noise_sd_g


def started_from_amplitudes(chain: Chain) -> Chain:
    """The chain with amplitudes of typical size as a start for time constants, which have no influence at amplitude zero."""
    starts = dict[str, float]()
    for link in chain.links:
        leaves = Chain((link,)).free
        if any(leaf.unit == "s" for leaf in leaves):
            zero = [leaf for leaf in leaves if leaf.unit != "s" and not np.any(leaf.value)]
            starts |= {name: leaf.scale for leaf in zero for name in leaf.names}
    return chain.named(starts) if starts else chain


@dataclass(frozen=True)
class StatedModel:
    """Model of `--rig`, `--noise-sd`, `--prior`, `--fix`, `--head`, `--gravity`, `--columns`, `--effects` and `--attitudes`.

    `stated_in`: the option or file that states each prior.
    """

    rig: Rig | None = None
    noise_sd: float | None = None
    priors: Priors = field(default_factory=dict)
    fixed: frozenset[str] = frozenset()
    head: MeasuredHead | None = None
    entries: Catalogue = field(default_factory=catalogue)
    gravity: Gravity | None = None
    columns: Mapping[str, str] | None = None
    stated_in: Mapping[str, str] = field(default_factory=dict)
    attitudes: str | None = None

    @property
    def usual(self) -> Mapping[str, float]:
        """The largest usual sizes of parameters that the rig states, base units."""
        return self.rig.usual if self.rig else {}

    @classmethod
    def of(cls, options: ModelOptions) -> "StatedModel":
        """Read the options.

        **Raises:** `InputError` for an option that cannot be used.
        """
        entries, described = catalogue(*options.effects), None
        if options.rig is not None:
            described = read_rig_with_effects(options.rig, entries)
        priors: dict[str | tuple[str, ...], tuple] = dict(described.priors.items()) if described else {}
        stated_in = {name: f"{described.source} (priors.{name})" for name in described.priors} if described else {}
        units = UNIT_OF_LEAF | (links_and_units(entries)[1] if described and described.effects else {})
        for text in options.prior:
            name, equals, size = text.partition("=")
            if not equals:
                raise InputError(f"--prior {text!r}: write NAME=SIZE, such as 'dbeta=3 arcmin'")
            unit = unit_of_parameter(name, units)
            if unit is None:
                raise InputError(f"--prior {text!r}: no parameter {name!r}; parameters: {', '.join(units)}")
            try:
                priors[name], stated_in[name] = (0.0, quantity(size, unit)), f"--prior {name}"
            except InputError as error:
                raise InputError(f"--prior {text!r}: {error}") from error
        known = [*UNIT_OF_LEAF, *(leaf + CHANGE for leaf in (described.temperature.leaves if described else ()))]
        unknown = sorted(set(options.fix) - set(known))
        if unknown:
            raise InputError(f"--fix {unknown[0]}: no such parameter; parameters: {', '.join(known)}")
        stated = stated_noise_sd(options.noise_sd, described)
        head = None if options.head is None else read_head(options.head, *links_and_units(entries))
        gravity = None if options.gravity is None else gravity_of_option(options.gravity)
        columns = None if options.columns is None else _column_names(options.columns)
        named = (stated_in, options.attitudes)
        return cls(described, stated, priors, frozenset(options.fix), head, entries, gravity, columns, *named)

    def read(self, path: Path, *, check_size: bool = True, one_of_several: bool = False) -> PositionSet:
        """The positions of a file, under the stated gravity; rows that look copied are reported.

        **Raises:** `InputError` for a file that is not a position file, or that has raw samples.
        """
        stated = {"names": self.columns, "attitudes": self.attitudes}
        data = read_positions(path, check_size=check_size, one_of_several=one_of_several, **stated)
        if data.attitudes is None and (self.head or (self.rig and "free_attitude" not in self.rig.links)):
            data = replace(data, comments=data.comments | {ATTITUDES: BY_HEAD})
        _log.debug("%s: %d positions, columns sd: %s", path, len(data), "no" if data.sd is None else "yes")
        for name in data.ignored:
            if meant := likely_meant(name, [known for known in KNOWN if known not in (*data.columns, *READINGS)]):
                cure = f"did you mean {meant}? Rename it, or give --columns {meant}={name}"
                print(f"WARNING: {path}: column {name} is not used; {cure}", file=sys.stderr)
            else:
                _log.info("%s: column %s is not used", path, name)
        stretches = data.stretches
        if len(data) >= _LIKE_SAMPLES * stretches:
            reduced = Path("reduced")
            raise InputError(
                f"{path}: {len(data)} rows, but only {counted(stretches, 'stretch')} of one position each, so these look like "
                f"raw samples. Reduce them first, then give {reduced / 'positions.csv'}: "
                f"{suggested('reduce', path, '--out', reduced)}"
            )
        if copies := copied_positions(data):
            pairs = [f"{name} and {first}" for name, first in copies[:_MOST_COPIES]]
            more = f" and {len(copies) - _MOST_COPIES} more" if len(copies) > _MOST_COPIES else ""
            print(
                f"WARNING: {path}: identical rows: positions {', '.join(pairs)}{more}; a copied row is weighted twice: "
                "remove it",
                file=sys.stderr,
            )
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
        for copied in given_once(paths):
            print(f"WARNING: {copied}", file=sys.stderr)
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
        if self.rig is None or not is_designed(self.rig):
            return
        for positions in read:
            if not isinstance(positions, InputError):
                warn(positions.source, compared_with_plan(self.rig, positions))

    def checked(self, data: PositionSet) -> tuple[PositionSet, list[SetupError]]:
        """The positions after correction of set-up errors that do not influence a calibration at rest, and these errors.

        **Raises:** `InputError` for other set-up errors: a calibration is for the columns as recorded.
        """
        return checked(data, self.chain(data, known=self.known(data)) if self.rig else None, self.entries)

    def problem(self, data: PositionSet) -> Problem:
        """The fit of the stated chain to these data."""
        known = self.known(data)
        chain = self.chain(data, known=known)
        problem = problem_of(data, chain, noise_sd=self.noise_sd, priors=self.stated(chain, data, known=known))
        return with_slow_noise(problem, self.slow_noise(data))

    def slow_noise(self, data: PositionSet, *, sampled: bool = False) -> HeadAbility | None:
        """The head whose slow noise (`[head.noise]` of the rig) these data have; None if none is stated. If it cannot be used,
        a warning states the reason.

        **Arguments:**

        - `sampled`: whether raw samples state the noise.
        """
        ability = None if self.rig is None else self.rig.ability
        if ability is None or not ability.slow_noise.any:
            return None
        if sampled:
            reason = "the noise is that of --samples"
        elif self.noise_sd is None:
            reason = 'the noise of a dwell is not stated; add [noise] sd = "0.1 mg" to the rig, or give --noise-sd'
        elif data.time_s is None:
            reason = "no column time_s"
        else:
            return ability
        warn(data.source, [f"[head.noise] of the rig is not used: {reason}"])
        return None

    def chain(self, data: PositionSet, *, known: bool) -> Chain:
        """The chain to fit to these data; `known`: whether their noise is known.

        **Raises:** `InputError` for an effect of the rig that can only be simulated.
        """
        where = where_of(data)
        chain = self.rig.chain(where) if self.rig else default_chain(data)
        chain = chain.fixed(set(self.fixed)) if self.fixed else chain
        for leaf in chain.free:
            effect = self.entries.get(leaf.name)
            if effect is not None and effect.found_as:
                raise InputError(
                    f"{self.rig.source if self.rig else data.source}: chain.effects: {effect.id} can be simulated but not "
                    f"fitted: {effect.not_held}. tumblecal diagnose finds it as: {effect.found_as}. Remove it from the rig"
                )
        chain = started_from_amplitudes(chain)
        if self.head is None:
            return chain
        return self.head.extended(
            chain, where, lambda id, settings: first_link(self.entries[id], settings), known=known
        )

    def stated(self, chain: Chain, data: PositionSet, *, known: bool) -> Priors:
        """The priors of the parameters of that chain."""
        where, stated = where_of(data, chain), self.priors
        if known and self.rig is not None and self.rig.ability is not None:
            stated = with_repeatability(stated, self.rig.ability.repeatability, chain, where)
        if self.head is None or not known:
            return stated
        return dict(stated.items()) | self.head.priors(chain, where)

    def with_sources(self, listed: Sequence[Implausible], problem: Problem) -> tuple[Implausible, ...]:
        """Implausible parameters of a fit to this problem; if they contradict a statement, with its option or file."""
        if self.head is None or not any(unusual.stated is not None for unusual in listed):
            by_head = set[str]()
        else:
            by_head = {name for names in self.head.priors(problem.chain, problem.where) for name in names}

        def source(name: str) -> str:
            prior = [self.stated_in[key] for key in (name, leaf_of(name)) if key in self.stated_in][:1]
            return " and ".join([*prior, *([f"--head {self.head.source}"] if self.head and name in by_head else [])])

        return tuple(
            [
                unusual if unusual.stated is None else replace(unusual, stated_in=source(unusual.parameter))
                for unusual in listed
            ]
        )

    def of_head(self, problem: Problem) -> dict[str, Any]:
        """The measured errors of the head, for the provenance of a fit to this problem."""
        return {} if self.head is None else self.head.record(problem.chain, problem.where, known=problem.known)

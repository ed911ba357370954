"""The model that a command's options describe: rig or inferred plan, stated noise, priors, fixed parameters."""

import logging
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from tumblecal.chain import Chain
from tumblecal.chain.head_file import MeasuredHead, read_head
from tumblecal.chain.nominal import UNIT_OF_LEAF
from tumblecal.chain.rig import Rig
from tumblecal.chain.rig_file import unit_of_parameter
from tumblecal.cli.options import ModelOptions
from tumblecal.data import PositionSet, read_positions
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
from tumblecal.estimation.plausibility import Implausible
from tumblecal.estimation.priors import Priors
from tumblecal.estimation.setup_error import SetupError
from tumblecal.ground.counted import counted
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import Gravity, gravity_of_option
from tumblecal.ground.suggested_command import suggested
from tumblecal.ground.toml_faults import located
from tumblecal.ground.units import quantity, reading_sd


_log = logging.getLogger(__name__)
_MOST_COPIES = 3
# So many rows of one name and setting after another are samples of one dwell.
_LIKE_SAMPLES = 16


def _named(text: str) -> dict[str, str]:
    """The columns of `--columns`.

    **Raises:** `InputError` for a text that is no list of NAME=OWN.
    """
    pairs = [part.partition("=") for part in text.split(",")]
    if not all(name.strip() and equals and own.strip() for name, equals, own in pairs):
        raise InputError(f"--columns {text}: write NAME=OWN,..., such as ax_g=AccX,ay_g=AccY,az_g=AccZ")
    names = [name.strip() for name, *_ in pairs]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"--columns {text}: {name} is given twice; keep one")
    return {name.strip(): own.strip() for name, _, own in pairs}


def _noise_sd(option: str | None, rig: Rig | None) -> float | None:
    """The sd of a reading (g) of `--noise-sd`, else the rig's.

    **Raises:** `InputError` for one that nothing can be weighed by.
    """
    if option is not None:
        try:
            return reading_sd(option)
        except InputError as error:
            raise InputError(f"--noise-sd: {error}") from error
    if rig is not None and rig.noise_sd_g == 0:
        fault = (
            f"{rig.source}: noise.sd: readings without noise cannot be weighed; write the sd that they have, leave [noise] out "
            "to have it estimated, or give --noise-sd"
        )
        raise InputError(located(Path(rig.source), [fault]))
    return None if rig is None else rig.noise_sd_g


def started_from_amplitudes(chain: Chain) -> Chain:
    """The chain whose time constants start with amplitudes of typical size: at zero a constant changes no reading."""
    starts = dict[str, float]()
    for link in chain.links:
        leaves = Chain((link,)).free
        if any(leaf.unit == "s" for leaf in leaves):
            zero = [leaf for leaf in leaves if leaf.unit != "s" and not np.any(leaf.value)]
            starts |= {name: leaf.scale for leaf in zero for name in leaf.names}
    return chain.named(starts) if starts else chain


@dataclass(frozen=True)
class StatedModel:
    """What `--rig`, `--noise-sd`, `--prior`, `--fix`, `--head`, `--gravity`, `--columns` and `--effects` say.

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

    @property
    def usual(self) -> Mapping[str, float]:
        """The largest usual sizes of parameters that the rig states, base units."""
        return self.rig.usual if self.rig else {}

    @classmethod
    def of(cls, options: ModelOptions) -> "StatedModel":
        """Read the options.

        **Raises:** `InputError` for one that cannot be used.
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
                raise InputError(f"--prior {text!r}: write NAME=SIZE, e.g. 'dbeta=3 arcmin'")
            unit = unit_of_parameter(name, units)
            if unit is None:
                raise InputError(f"--prior {text!r}: no parameter {name!r}; there are {', '.join(units)}")
            try:
                priors[name], stated_in[name] = (0.0, quantity(size, unit)), f"--prior {name}"
            except InputError as error:
                raise InputError(f"--prior {text!r}: {error}") from error
        unknown = sorted(set(options.fix) - set(UNIT_OF_LEAF))
        if unknown:
            raise InputError(f"--fix {unknown[0]}: no such parameter; there are {', '.join(UNIT_OF_LEAF)}")
        stated = _noise_sd(options.noise_sd, described)
        head = None if options.head is None else read_head(options.head, *links_and_units(entries))
        gravity = None if options.gravity is None else gravity_of_option(options.gravity)
        columns = None if options.columns is None else _named(options.columns)
        return cls(described, stated, priors, frozenset(options.fix), head, entries, gravity, columns, stated_in)

    def read(self, path: Path, *, check_size: bool = True, one_of_several: bool = False) -> PositionSet:
        """The positions of a file, under the stated gravity; rows that look copied are said.

        **Raises:** `InputError` for a file that is none, or that holds raw samples.
        """
        data = read_positions(path, check_size=check_size, names=self.columns, one_of_several=one_of_several)
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
                f"{path}: {len(data)} rows, but only {counted(stretches, 'stretch')} of one position each; give "
                f"{reduced / 'positions.csv'} in their place: these look like raw samples; reduce them first: "
                f"{suggested('reduce', path, '--out', reduced)}"
            )
        if copies := data.copies:
            pairs = [f"{name} and {first}" for name, first in copies[:_MOST_COPIES]]
            more = f" and {len(copies) - _MOST_COPIES} more" if len(copies) > _MOST_COPIES else ""
            print(
                f"WARNING: {path}: the same in every number: positions {', '.join(pairs)}{more}; a row that was copied counts "
                "twice: remove it",
                file=sys.stderr,
            )
        return data if self.gravity is None else data.under(self.gravity)

    @property
    def described(self) -> bool:
        """Whether the chain is another than the default one."""
        return self.rig is not None or self.head is not None or bool(self.fixed)

    def known(self, data: PositionSet) -> bool:
        """Whether the noise of these data is stated."""
        return self.noise_sd is not None or data.sd is not None

    def read_each(
        self, paths: Sequence[Path], *, together: bool, check_size: bool = True
    ) -> list[PositionSet | InputError]:
        """The positions of several files; of those that are worked on one by one, the fault of each that cannot be
        read. Copies of a file are said.

        **Raises:** `InputError` for a file that is given twice, or cannot be read where all belong together.
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

    def checked(self, data: PositionSet) -> tuple[PositionSet, list[SetupError]]:
        """The set with what no calibration at rest depends on put right, and what that was.

        **Raises:** `InputError` for readings or angles that are mixed up: a calibration is for the columns as they stand.
        """
        return checked(data, self.chain(data, known=self.known(data)) if self.rig else None, self.entries)

    def problem(self, data: PositionSet) -> Problem:
        """The fit of that chain to these data."""
        known = self.known(data)
        chain = self.chain(data, known=known)
        return problem_of(data, chain, noise_sd=self.noise_sd, priors=self.stated(chain, data, known=known))

    def chain(self, data: PositionSet, *, known: bool) -> Chain:
        """The chain to fit to these data; `known`: whether their noise is.

        **Raises:** `InputError` for an effect of the rig that can be simulated alone.
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
        """What is known of that chain's parameters."""
        if self.head is None or not known:
            return self.priors
        return dict(self.priors.items()) | self.head.priors(chain, where_of(data))

    def with_sources(self, listed: Sequence[Implausible], problem: Problem) -> tuple[Implausible, ...]:
        """Parameters of a fit to this problem that contradict what is stated, each with the option or file that states it."""
        if self.head is None or not any(unusual.stated is not None for unusual in listed):
            by_head = set[str]()
        else:
            by_head = {name for names in self.head.priors(problem.chain, problem.where) for name in names}

        def source(name: str) -> str:
            own = [self.stated_in[key] for key in (name, leaf_of(name)) if key in self.stated_in][:1]
            return " and ".join([*own, *([f"--head {self.head.source}"] if self.head and name in by_head else [])])

        return tuple(
            [
                unusual if unusual.stated is None else replace(unusual, stated_in=source(unusual.parameter))
                for unusual in listed
            ]
        )

    def of_head(self, problem: Problem) -> dict[str, Any]:
        """What the provenance of a fit to this problem says of the head's measured errors."""
        return {} if self.head is None else self.head.record(problem.chain, problem.where, known=problem.known)

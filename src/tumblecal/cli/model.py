"""The model that a command's options describe: rig or inferred plan, stated noise, priors, fixed parameters."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from tumblecal.chain import Chain
from tumblecal.chain.rig import UNIT_OF_LEAF, Rig
from tumblecal.chain.units import quantity
from tumblecal.data import PositionSet
from tumblecal.errors import InputError
from tumblecal.estimation import default_chain


def read_rig_with_effects(path: Path, *effect_files: Path) -> Rig:
    """A rig whose chain may name the effects of the catalogue and of the user's files."""
    from tumblecal.chain.rig_file import read_rig
    from tumblecal.effects.catalogue import catalogue, links_and_units

    return read_rig(path, *links_and_units(catalogue(*effect_files)))


@dataclass(frozen=True)
class Model:
    """What `--rig`, `--noise-sd`, `--prior` and `--fix` say."""

    rig: Rig | None = None
    noise_sd: float | None = None
    priors: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    fixed: frozenset[str] = frozenset()

    @classmethod
    def of(cls, rig: Path | None, noise_sd: str | None, prior: Sequence[str], fix: Sequence[str]) -> "Model":
        """Read the options.

        **Raises:** `InputError` for one that cannot be used.
        """

        described = None
        if rig is not None:
            described = read_rig_with_effects(rig)
        priors = dict(described.priors) if described else {}
        for text in prior:
            name, equals, size = text.partition("=")
            if not equals:
                raise InputError(f"--prior {text!r}: write NAME=SIZE, e.g. 'dbeta=3 arcmin'")
            leaf = name.partition("_")[0]
            if leaf not in UNIT_OF_LEAF:
                raise InputError(f"--prior {text!r}: no parameter {name!r}; there are {', '.join(UNIT_OF_LEAF)}")
            priors[name] = (0.0, quantity(size, UNIT_OF_LEAF[leaf]))
        unknown = sorted(set(fix) - set(UNIT_OF_LEAF))
        if unknown:
            raise InputError(f"--fix {unknown[0]}: no such parameter; there are {', '.join(UNIT_OF_LEAF)}")
        stated = quantity(noise_sd, "g") if noise_sd else (described.noise_sd_g if described else None)
        if stated is not None and not stated > 0:
            raise InputError(f"--noise-sd {noise_sd}: must be above 0")
        return cls(described, stated, priors, frozenset(fix))

    def chain(self, data: PositionSet) -> Chain:
        """The chain to fit to these data."""
        from tumblecal.estimation import where_of

        chain = self.rig.chain(where_of(data)) if self.rig else default_chain(data)
        return chain.fixed(set(self.fixed)) if self.fixed else chain

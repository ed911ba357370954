"""The uncertainties that a measurement is to reach: a TOML file of parameters, `bias_x = "0.05 mg"`."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from tumblecal.chain.nominal import UNIT_OF_LEAF
from tumblecal.chain.rig_file import sizes_of, unit_of_parameter
from tumblecal.design.criteria.criterion import Criterion
from tumblecal.design.model.responses import Responses
from tumblecal.ground.errors import InputError
from tumblecal.ground.strict_toml import read_toml
from tumblecal.ground.toml_faults import located
from tumblecal.ground.units import in_words, shown


@dataclass(frozen=True)
class Target:
    """Standard uncertainties to reach, base units, by parameter."""

    sd: dict[str, float]

    def criterion(self, responses: Responses) -> Criterion:
        """The largest standard uncertainty relative to its target: 1 if all are reached."""
        at = responses.indices(list(self.sd))
        rows = np.zeros((len(at), len(responses.names)))
        rows[np.arange(len(at)), at] = responses.scales[at] / list(self.sd.values())
        return Criterion("target", rows, "largest")

    def missed(self, names: tuple[str, ...], sd: Float[np.ndarray, " shared"], tolerance: float = 1.0) -> list[str]:
        """Parameters whose uncertainty is larger than the target, the worst one first; `tolerance`: by which factor."""
        ratio = {name: sd[names.index(name)] / wanted for name, wanted in self.sd.items()}
        return sorted((name for name in ratio if not ratio[name] <= tolerance), key=lambda name: -ratio[name])


def read_target(path: Path, names: tuple[str, ...]) -> Target:
    """Read a target.

    **Arguments:** `names`: parameters that can have a target; the name of a group (`bias`) stands for all of its members.

    **Raises:** `InputError` for an unknown parameter, or a text that is not an uncertainty.
    """
    given = {name: text for name, text in read_toml(path).items() if name != "schema"}
    faults = [
        f'{path}: {name}: write an uncertainty with its unit, such as "0.05 mg"'
        for name, text in given.items()
        if not isinstance(text, str)
    ]
    faults += [] if given else [f'{path}: no parameter; write for example bias_x = "0.05 mg"']
    if faults:
        raise InputError(located(path, faults))
    members = {name: [one for one in names if one == name or one.startswith(f"{name}_")] for name in given}
    faults = [
        f"{path}: {name}: no such parameter of the sensor; a target can be set for {', '.join(names)}"
        for name, listed in members.items()
        if not listed
    ]
    stated = {name: text for name, text in given.items() if members[name]}
    sizes = sizes_of(path, stated, UNIT_OF_LEAF, faults)
    if faults:
        raise InputError(located(path, faults))
    # A single parameter has priority over its group.
    ordered = sorted(sizes, key=lambda name: name in names)
    return Target({one: sizes[name] for name in ordered for one in members[name]})


def uncertainty_words(name: str, sd: float, digits: int = 2) -> str:
    """A standard uncertainty with its unit, such as `0.31 mg`; `not determined` if it is infinite."""
    if not np.isfinite(sd):
        return "not determined"
    unit, factor = shown(unit_of_parameter(name, UNIT_OF_LEAF) or "1")
    return in_words(f"{sd * factor:.{digits}g}", unit)

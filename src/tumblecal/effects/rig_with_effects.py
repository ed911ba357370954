"""A rig from its file, with effects of a catalogue in its chain."""

from pathlib import Path

from tumblecal.chain.rig import Rig
from tumblecal.chain.rig_file import read_rig
from tumblecal.effects.catalogue import Catalogue, catalogue, links_and_units


def read_rig_with_effects(path: Path | str, entries: Catalogue | None = None) -> Rig:
    """Read a rig whose chain may name the effects of a catalogue.

    **Arguments:**

    - `path`: the TOML file, or the name of an example (`tumblecal example` lists them).
    - `entries`: the catalogue; the program's if omitted.

    **Raises:** `InputError` with every fault and its dotted path.

    Examples:
        >>> import tumblecal
        >>> rig = tumblecal.read_rig("paper24")
        >>> len(rig.plan), rig.noise_sd_g, rig.truth["bias"]
        (24, 0.00015, (0.0011, -0.00075, 0.0008))
    """
    return read_rig(path, *links_and_units(catalogue() if entries is None else entries))

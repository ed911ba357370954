"""A catalogue of few effects, for tests of what is done with a diagnosis and not of what it finds.

The program of all effects is compiled for each kind of plan (number of positions, columns, runs, mounts): seconds for tests
whose plan no other test has.
"""

from tumblecal.effects.catalogue import Catalogue, catalogue


# Of the input, the temperature, the time, and the head.
KINDS = {
    "second_order",
    "cross_coupling",
    "bias_temperature",
    "bias_temperature_square",
    "scale_temperature",
    "bias_drift",
    "index_eccentricity",
    "base_levelling",
    "axis_perpendicularity",
}


def few_entries() -> Catalogue:
    """The program's entries of these kinds, and faults of single positions and of the noise."""
    return {id: entry for id, entry in catalogue().items() if entry.make is None or id.partition(".")[0] in KINDS}

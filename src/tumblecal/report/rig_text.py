"""Tables of a rig file as text, for the rigs that a diagnosis writes."""

from collections.abc import Iterator, Mapping, Sequence

from tumblecal.ground.strict_toml import toml_string


SCHEMA = 'schema = "tumblecal.rig/1"'


def leaf_table(name: str, by: str | None, free: bool | None) -> Iterator[str]:
    """How a leaf is indexed and whether it is estimated; None: as usual."""
    yield f"[chain.leaves.{name}]"
    if by is not None:
        yield f"by = {toml_string(by)}"
    if free is not None:
        yield f"free = {str(free).lower()}"
    yield ""


def mount_tables(rotations_deg: Mapping[str, Sequence[float]]) -> Iterator[str]:
    """The intended rotation of each mounting, deg about x, y, z."""
    for label, rotation in rotations_deg.items():
        yield f"[mounts.{toml_string(label)}]"
        yield f"rotation_deg = {list(rotation)}"
        yield ""


def position_table(name: str, alpha_deg: float, beta_deg: float, more: Mapping[str, str | float]) -> Iterator[str]:
    """One position of the plan; `more`: its labels and conditions by key."""
    yield "[[plan.positions]]"
    yield f"name = {toml_string(name)}"
    for key, value in {"alpha_deg": alpha_deg, "beta_deg": beta_deg, **more}.items():
        yield f"{key} = {toml_string(value) if isinstance(value, str) else value!r}"
    yield ""

"""The positions that a plan of capture, a rig or a position file has, for a plan that adds to them or is compared with them."""

from pathlib import Path

from tumblecal.capture.capture_plan import read_plan
from tumblecal.chain.plan_table import PlanTable
from tumblecal.chain.rig import Rig
from tumblecal.data import read_positions
from tumblecal.ground.errors import InputError
from tumblecal.ground.strict_toml import checked, read_toml
from tumblecal.plan.cells import Cells, Positions


def require_mounts(rig: Rig, labels: tuple[str, ...], named: str) -> None:
    """Check that a rig has these mountings.

    **Raises:** `InputError`, with `named` first.
    """
    known = sorted({*rig.mounts, *rig.plan.mounts})
    if unknown := [label for label in labels if label not in known]:
        raise InputError(
            f"{named}: mounting {unknown[0]!r} is not in {rig.source} (mountings: {', '.join(known)}); rename it, or add "
            f"[mounts.{unknown[0]}] with its rotation_deg"
        )


def positions_of(path: Path, rig: Rig) -> Positions:
    """The positions of a plan of capture, a rig or a position file.

    **Raises:** `InputError` for a file of none of these kinds, or with a mounting that the rig does not have.
    """
    mount = (rig.ability.mounts if rig.ability else ("1",))[0]
    if path.suffix != ".toml":
        data = read_positions(path)
        if data.hand_held:
            raise InputError(f"{path}: unknown attitudes; a plan needs alpha_deg and beta_deg")
        rows = zip(data.alpha_deg.tolist(), data.beta_deg.tolist(), data.mount or (mount,) * len(data), strict=True)
        degc = data.temperature_degc
    elif "plan" in (content := read_toml(path)):
        planned = checked(path, content["plan"], PlanTable).plan()
        rows, degc = zip(planned.alpha_deg, planned.beta_deg, planned.mounts, strict=True), planned.temperature_degc
    else:
        captured = read_plan(path)
        rows = ((step.alpha_deg, step.beta_deg, captured.session.mount) for step in captured.steps)
        listed = [step.temperature_degc for step in captured.steps if step.temperature_degc is not None]
        degc = listed if captured.over_temperature else None
    cells = Cells.listed(list(rows), degc)
    require_mounts(rig, cells.mounts, str(path))
    return Positions(path.name, "", cells)

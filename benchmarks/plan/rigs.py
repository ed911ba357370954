"""Rigs of the studies: angles, mountings and abilities of a head."""

from collections.abc import Sequence
from pathlib import Path

from tumblecal.chain.rig import Rig
from tumblecal.chain.rig_file import rig_of


TURNS = {"A": (0, 0, 0), "B": (0, 0, 90), "C": (0, 90, 0)}


def head(
    step_deg: float,
    beta_deg: Sequence[float],
    turns: dict[str, Sequence[float]],
    *extensions,
    sd_mg: float = 0.15,
    prior: str = "",
    **ability: object,
) -> Rig:
    """A head with a step of its spindle, pitch settings and orientations of its mountings (Rx Ry Rz, deg).

    `prior`: of the pitch errors. `ability`: further tables of [head]. `extensions`: links and units of effects.
    """
    alpha = {"start": 0, "step": step_deg, "count": round(360 / step_deg)}
    table = {
        "schema": "tumblecal.rig/1",
        "plan": {"alpha_deg": alpha, "beta_deg": list(beta_deg), "mounts": list(turns)},
        "chain": {"leaves": {"dbeta": {"by": "mount.pitch"}, "dtheta": {"by": "mount"}}},
        "mounts": {name: {"rotation_deg": list(turn)} for name, turn in turns.items()},
        "noise": {"sd": f"{sd_mg} mg"},
        "head": {"alpha_deg": alpha, "beta_deg": list(beta_deg), **ability},
    }
    return rig_of(table | ({"priors": {"dbeta": prior}} if prior else {}), Path("rig.toml"), *extensions)

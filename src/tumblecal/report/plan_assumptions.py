"""Assumptions of a designed plan that neither rig file nor options state, each with the key or option that overrides it."""

from collections.abc import Iterator
from typing import NamedTuple

from tumblecal.chain.head_ability import Times
from tumblecal.design.model.responses import MOUNT, PITCH, Setting
from tumblecal.design.plan import DesignedPlan
from tumblecal.ground.units import factor


class Assumption(NamedTuple):
    """An assumption in words, and the key of the rig file or the option that overrides it."""

    words: str
    override: str


_TIMES = {
    "dwell_s": "dwell",
    "settle_s": "settling",
    "turn_s": "turn of the spindle",
    "pitch_change_s": "change of the pitch setting",
    "remount_s": "remounting",
    "temperature_change_s": "change of the temperature",
}


def assumptions(plan: DesignedPlan) -> list[Assumption]:
    """All assumptions."""
    return list(_assumptions(plan))


def _assumptions(plan: DesignedPlan) -> Iterator[Assumption]:
    ability, wanted, assumed = plan.ability, plan.wanted, set(plan.ability.assumed)
    if wanted.positions is None and wanted.minutes is None:
        new = len(plan.after.schedule) - plan.measured
        yield Assumption(f"{new} positions", "--positions 24, or --minutes 480")
    if dict(wanted.criteria) == {"worst": 1.0} and not wanted.parameters:
        yield Assumption("criterion: the largest standard uncertainty of the sensor's parameters", "--criterion in_use")
    if "alpha_deg" in assumed:
        yield Assumption(f"{len(ability.alpha_deg)} spindle angles, every 15 deg", "[head] alpha_deg, or --allow-alpha")
    if "beta_deg" in assumed:
        angles = ", ".join(f"{angle:g}" for angle in ability.beta_deg)
        yield Assumption(f"pitch settings of the present plan: {angles} deg", "[head] beta_deg, or --allow-beta")
    if "mounts" in assumed:
        yield Assumption(
            f"mountings of the present plan: {', '.join(ability.mounts)}", "[head] mounts, or --allow-mount"
        )
    times = {key: getattr(Times, key) for key in _TIMES if f"times.{key}" in assumed}
    if len(ability.mounts) == 1:
        times.pop("remount_s", None)
    if not ability.temperatures_degc:
        times.pop("temperature_change_s", None)
    if times:
        listed = ", ".join(f"{_TIMES[key]} {seconds:g} s" for key, seconds in times.items())
        yield Assumption(f"times: {listed}", "[head.times]")
    for name, what, key in ((PITCH, "pitch setting", "pitch"), (MOUNT, "mounting", "mount")):
        if f"repeatability.{key}" in assumed:
            setting = plan.responses.pitch if name == PITCH else plan.responses.mount
            yield Assumption(_repeatability(name, what, setting), f"[head.repeatability] {key}")
    if "noise" in assumed:
        yield Assumption("no slow noise (drift, random walk, bias instability)", "[head.noise]")
    yield Assumption("uncertainties are those at nominal parameters, and at the stated noise", "[noise] sd")


def _repeatability(name: str, what: str, setting: Setting) -> str:
    if setting.exact:
        return f"each {what} is exact ({name} is not estimated)"
    if setting.again:
        sd = setting.again * setting.scale * factor("rad", "arcmin")
        return (
            f"each visit of a {what} has an independent error, standard deviation {sd:.3g} arcmin (the prior of {name})"
        )
    return f"each visit of a {what} has an independent, unknown error"

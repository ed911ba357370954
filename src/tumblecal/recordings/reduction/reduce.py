"""Reduction of a capture's folder to position means: decode, check, average."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.capture_plan import SETUP, CapturePlan, CaptureSetup
from tumblecal.capture.decoding.framing import decode_all
from tumblecal.capture.decoding.losses import SAME_RATE
from tumblecal.capture.decoding.samples import Samples, Settings, Status
from tumblecal.capture.journal import (
    JOURNAL_NAME,
    RAW_NAME,
    Attempt,
    RunState,
    read_journal,
    replayed,
    sha256_of,
)
from tumblecal.capture.log import RecordKind, read_log
from tumblecal.capture.protocols import Protocol, protocol
from tumblecal.capture.protocols.stim300 import settings_of
from tumblecal.capture.run.dwell import losses_of
from tumblecal.capture.run.run_folder import plan_of_run
from tumblecal.data.joined_clocks import TIME_SPEED, TIME_ZERO, moment
from tumblecal.data.position_comments import NOT_CONFIRMED
from tumblecal.data.positions import PositionSet
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2
from tumblecal.ground.suggested_command import suggested
from tumblecal.recordings.reduction.reduction import Reduction, reduction_of


def unconfirmed(state: RunState, attempts: Sequence[Attempt]) -> list[int]:
    """Places of the accepted attempts whose instrument did not state its serial number."""
    since = min((entry["wall_ns"] for entry in state.doubts), default=None)
    if state.serial_number is not None:
        return [place for place, attempt in enumerate(attempts) if attempt.serial_number is None]
    # If the instrument never states one: the attempts after an interruption of the line.
    return [place for place, attempt in enumerate(attempts) if since is not None and attempt.wall_ns > since]


def identity_comments(state: RunState, attempts: Sequence[Attempt], names: Sequence[str]) -> dict[str, str]:
    """Comments of a file of position means."""
    serial, places = state.serial_number, unconfirmed(state, attempts)
    if not places:
        return {"serial_number": str(serial)} if serial else {}
    which = ", ".join(names[place] for place in places)
    found = "; ".join(entry["text"] for entry in state.doubts if "text" in entry) or "no serial number stated"
    comments = {NOT_CONFIRMED: f"position {which}: {found}"}
    return comments | ({"serial_number_not_confirmed": str(serial)} if serial else {})


def identity_content(state: RunState, attempts: Sequence[Attempt], names: Sequence[str]) -> dict[str, Any]:
    """The identity of the instrument for reduction.json."""
    places = unconfirmed(state, attempts)
    return {
        "confirmed": not places and state.serial_number is not None,
        "serial_number": state.serial_number,
        "positions_not_confirmed": [names[place] for place in places],
        "entries": state.doubts,
    }


_NEAR_FULL_SCALE = 0.98
_AFTER_BYTES = 1 << 20


@dataclass(frozen=True)
class _Accepted:
    """One position: `force`: good samples in local g, shape (n, 3), `warmth`: their temperatures,
    degC; `time_s`: its middle; `temperature_degc`: mean of the sensor, otherwise of the chamber, otherwise as requested; the
    number of `flagged` samples, and the counts (`counted`) for `check_dwell`."""

    force: NDArray[np.float64]
    warmth: NDArray[np.float64]
    time_s: float
    temperature_degc: float | None
    flagged: int
    counted: dict[str, Any]


def reduce(folder: Path, report: Callable[[str], None] = lambda text: None) -> Reduction:
    """Reduce a capture.

    **Arguments:**

    - `folder`: the folder of `tumblecal capture`.
    - `report`: called with messages of progress.

    **Raises:** `InputError` if the folder contains no capture, no position was accepted, or the raw log was changed.
    """
    faults = list[str]()
    state = replayed(read_journal(folder, faults))
    if not state.accepted:
        raise InputError(
            f"{folder}: no position was accepted yet; to resume: {suggested('capture', '--resume', folder)}"
        )
    if not state.device:
        raise InputError(f"{folder / JOURNAL_NAME}: the entry of the device is damaged; restore the file from a copy")
    plan = plan_of_run(folder, state)
    device_protocol = protocol(state.device["protocol"])
    raw = folder / RAW_NAME
    attempts = [attempt for _, attempt in sorted(state.accepted.items())]
    rate = _rate_of(attempts, float(state.device["rate_hz"]), plan.port.speed)
    accepted = []
    for attempt in attempts:
        name = plan.steps[attempt.position].name
        report(f"position {name}")
        if sha256_of(raw, attempt.log_start, attempt.log_stop) != attempt.sha256:
            raise InputError(f"{raw}: the bytes of position {name} were changed after recording; restore the file")
        accepted.append(_accepted(raw, attempt, plan, device_protocol, rate, state))
    return reduction_of(
        _position_set(folder, attempts, accepted, plan, state),
        [dwell.force for dwell in accepted],
        rate,
        attempts[0].sha256[:16],
        entries={
            "session": state.session,
            "device": state.device,
            "damage": faults,
            "identity": identity_content(state, attempts, [str(plan.steps[a.position].name) for a in attempts]),
        },
        dwell_entries=[
            {"attempt": attempt.number, "flagged": dwell.flagged, "sha256": attempt.sha256}
            | {name: attempt.summary[name] for name in ("requested_degc", "chamber_degc") if name in attempt.summary}
            for attempt, dwell in zip(attempts, accepted, strict=True)
        ],
        counted=[dwell.counted for dwell in accepted],
        temperatures=[dwell.warmth for dwell in accepted],
    )


def decoded_stretch(
    raw: Path, attempt: Attempt, device_protocol: Protocol, settings: Settings | None, options: dict[str, Any]
) -> tuple[Samples, NDArray[np.float64], range, list[int]]:
    """Samples of an attempt and shortly before and after it: with stamps, mask of the attempt, and places of replies."""
    records = [
        r for r in read_log(raw, attempt.log_before, attempt.log_stop + _AFTER_BYTES) if r.kind == RecordKind.BYTES
    ]
    decoder = device_protocol.decoder(settings, **options)
    decoded = decode_all(decoder, b"".join(r.payload for r in records))
    stops = np.cumsum([len(r.payload) for r in records])
    stamps = np.array([r.stamp_ns * 1e-9 for r in records])
    which = np.minimum(np.searchsorted(stops, decoded.samples.stop), len(records) - 1)
    first = sum(r.offset < attempt.log_start for r in records)
    last = sum(r.stop <= attempt.log_stop for r in records) - 1
    inside = range(*map(int, np.searchsorted(which, [first, last + 1])))
    # After a restart of the recorder the stamps may jump back (a new boot): only samples in order are used.
    host_s = stamps[which]
    ordered = inside.stop + int(np.argmax(np.append(np.diff(host_s[inside.stop - 1 :]) < 0, True))) if inside else 0
    specials = [event.stop for event in decoded.events if event.counted]
    return decoded.samples[:ordered], host_s[:ordered], inside, specials


def device_settings(state: RunState, plan: CapturePlan, device_protocol: Protocol) -> Settings | None:
    """Range and rate: as the device stated when the run began, otherwise from the plan."""
    stated = state.configuration
    if stated is not None and "range_g" in stated:
        return settings_of(stated)
    return device_protocol.settings(plan.port.range_g, float(state.device["rate_hz"]))


def _accepted(
    raw: Path, attempt: Attempt, plan: CapturePlan, device_protocol: Protocol, rate: float, state: RunState
) -> _Accepted:
    settings = device_settings(state, plan, device_protocol)
    options = device_protocol.decoder_options(plan.port.columns, plan.port.unit, whole=True)
    samples, host_s, attempted, specials = decoded_stretch(raw, attempt, device_protocol, settings, options)
    losses = losses_of(device_protocol, samples, host_s, rate, attempted, specials)
    guard = round(plan.dwell.guard_s * rate)
    inside = samples[attempted.start + guard : attempted.stop - guard]
    use = (inside.status == 0) & np.isfinite(inside.force).all(1)
    if use.sum() < 8:
        raise InputError(
            f"{raw}: position {plan.steps[attempt.position].name}: only {use.sum()} good samples; repeat it"
        )
    force = inside.force[use] * (STANDARD_GRAVITY_MS2 / plan.site.gravity.value_ms2)
    full = settings.range_g if settings and settings.range_g else (np.inf,) * 3
    near_full = (np.abs(inside.force) > _NEAR_FULL_SCALE * np.array(full)).any(1)
    overloaded = (inside.status & Status.OVERLOAD) != 0
    temperature = inside.temperature[use]
    known = temperature[np.isfinite(temperature)]
    degc = float(known.mean()) if len(known) else attempt.summary.get("chamber_degc")
    saturated = int((near_full | overloaded).sum())
    return _Accepted(
        force=force,
        warmth=temperature,
        time_s=_wall_s(host_s[attempted.start : attempted.stop], attempt, state) * plan.port.speed,
        temperature_degc=attempt.summary.get("requested_degc") if degc is None else degc,
        flagged=int((~use).sum()),
        counted={
            "saturated": saturated,
            "lost": losses.lost,
            "lost_unresolved": losses.unresolved,
            "rate_fault": losses.rates.words(rate * plan.port.speed),
        },
    )


def _rate_of(attempts: Sequence[Attempt], at_contact_hz: float, speed: float) -> float:
    """The sample rate: that at the contact with the device, unless most dwells contradict it by the host's clock."""
    dwells = [attempt.summary.get("rate_hz") or np.nan for attempt in attempts]
    rate = float(np.median(dwells)) / speed
    return rate if abs(rate / at_contact_hz - 1) > SAME_RATE else at_contact_hz


def _wall_s(host_s: NDArray[np.float64], attempt: Attempt, state: RunState) -> float:
    """Middle of the attempt in s since the session began, by the monotonic clock of its recording.

    That clock stops while the machine sleeps: the sleeping time is added, from the clock that continues.
    """
    begun = [d for d in state.devices if d["log_position"] <= attempt.log_start] or [state.device]
    clock = begun[-1]["clocks"]
    middle = float(host_s[0] + host_s[-1]) / 2
    wall = clock["wall_ns"] + (middle * 1e9 - clock["monotonic_ns"]) + _asleep_ns(clock, attempt.clocks)
    return (wall - state.devices[0]["clocks"]["wall_ns"]) * 1e-9


def _asleep_ns(before: Mapping[str, int], after: Mapping[str, int]) -> int:
    """Sleeping time of the machine between two readings of its clocks, if they show it, ns."""
    if not (before.get("boot_ns") and after.get("boot_ns")):
        return 0
    return (after["boot_ns"] - before["boot_ns"]) - (after["monotonic_ns"] - before["monotonic_ns"])


def _temperature_source(attempts: Sequence[Attempt], accepted: Sequence[_Accepted]) -> str:
    """The thermometer of `temperature_degc`; empty for that of the sensor."""
    if any(np.isfinite(dwell.warmth).any() for dwell in accepted):
        return ""
    by_chamber = all(attempt.summary.get("chamber_degc") is not None for attempt in attempts)
    requested = any("requested_degc" in attempt.summary for attempt in attempts)
    return "chamber" if by_chamber else "requested temperature, not measured" if requested else ""


def _position_set(
    folder: Path, attempts: Sequence[Attempt], accepted: Sequence[_Accepted], plan: CapturePlan, state: RunState
) -> PositionSet:
    """The means, without their standard deviations."""
    steps = [plan.steps[attempt.position] for attempt in attempts]
    temperatures = [dwell.temperature_degc for dwell in accepted]
    approaches = [step.approach for step in steps]
    runs = [plan.session.run] * len(steps)
    if plan.soak.new_pitch_settings and plan.over_temperature:
        runs = [f"{plan.session.run}.{plan.soaks[attempt.position] + 1}" for attempt in attempts]
    session, device = state.session, state.device
    comments = {
        "captured_in": folder.name,
        **identity_comments(state, attempts, [str(step.name) for step in steps]),
        "protocol": device["protocol"],
        "operator": session.get("operator", ""),
        "gravity_ms2": f"{plan.site.gravity.value_ms2:.6f}",
        "gravity_source": plan.site.gravity.source,
        TIME_ZERO: moment(state.devices[0]["clocks"]["wall_ns"] * 1e-9),
        TIME_SPEED: f"{plan.port.speed:g}" if plan.port.speed != 1 else "",
        "raw_sha256": sha256_of(folder / RAW_NAME),
        SETUP: CaptureSetup.of(plan).text,
        "temperature_source": _temperature_source(attempts, accepted),
    }
    return PositionSet(
        names=tuple(str(step.name) for step in steps),
        alpha_deg=np.array([step.alpha_deg for step in steps], float),
        beta_deg=np.array([step.beta_deg for step in steps], float),
        readings=np.array([dwell.force.mean(0) for dwell in accepted]),
        run=None if {*runs} == {"1"} else tuple(runs),
        mount=(plan.session.mount,) * len(steps) if plan.session.mount != "1" else None,
        time_s=np.array([dwell.time_s for dwell in accepted]),
        temperature_degc=np.array(temperatures, float) if all(t is not None for t in temperatures) else None,
        approach=np.array(approaches, float) if all(a is not None for a in approaches) else None,
        n=np.array([len(dwell.force) for dwell in accepted], float),
        comments={key: value for key, value in comments.items() if value},
        source=str(folder),
    )

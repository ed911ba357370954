"""Dwells of the folder of a capture: the accepted stretches of its raw log, decoded."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.capture_plan import SETUP, CapturePlan, CaptureSetup
from tumblecal.capture.decoding.framing import decode_all
from tumblecal.capture.decoding.losses import SAME_RATE
from tumblecal.capture.decoding.samples import Samples, Settings, Status
from tumblecal.capture.journal import JOURNAL_NAME, RAW_NAME, Attempt, RunState, read_journal, replayed, sha256_of
from tumblecal.capture.log import RecordKind, read_log
from tumblecal.capture.protocols import Protocol, protocol
from tumblecal.capture.protocols.stim300_datagrams import settings_of
from tumblecal.capture.run.dwell import losses_of
from tumblecal.capture.run.run_folder import plan_of_run
from tumblecal.data.joined_clocks import TIME_SPEED, TIME_ZERO, moment
from tumblecal.data.position_comments import NOT_CONFIRMED, identity_words
from tumblecal.ground.counted import counted
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2
from tumblecal.ground.suggested_command import suggested
from tumblecal.recordings.dwells.dwell_samples import DwellSamples
from tumblecal.recordings.dwells.place import Place, position_set
from tumblecal.recordings.options import KnownContext


_NEAR_FULL_SCALE = 0.98
_AFTER_BYTES = 1 << 20
_FEWEST_GOOD = 8


def captured_dwells(folder: Path, context: KnownContext = KnownContext()) -> DwellSamples:
    """The dwells of a capture; labels of run and mounting of the `context` precede those of its plan.

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
    attempts = [attempt for _, attempt in sorted(state.accepted.items())]
    places = _places(attempts, plan)
    device = protocol(state.device["protocol"])
    rate_hz = _rate_of(attempts, float(state.device["rate_hz"]), plan.port.speed)
    raw, decoded = folder / RAW_NAME, []
    for attempt, place in zip(attempts, places, strict=True):
        if sha256_of(raw, attempt.log_start, attempt.log_stop) != attempt.sha256:
            raise InputError(
                f"{raw}: the bytes of position {place.name} were changed after recording; restore the file"
            )
        decoded.append(_decoded(raw, place.name, attempt, device, (plan, state), rate_hz))
    force, warmth, time_s, dwell_entries, numbers = zip(*decoded, strict=True)
    identity = identity_of(state, attempts, [place.name for place in places])
    degc, thermometer = _temperatures(warmth, attempts)
    comments = {
        "captured_in": folder.name,
        **identity_comments(identity),
        "protocol": state.device["protocol"],
        "operator": state.session.get("operator", ""),
        "gravity_ms2": f"{plan.site.gravity.value_ms2:.6f}",
        "gravity_source": plan.site.gravity.source,
        TIME_ZERO: moment(state.devices[0]["clocks"]["wall_ns"] * 1e-9),
        TIME_SPEED: f"{plan.port.speed:g}" if plan.port.speed != 1 else "",
        "raw_sha256": sha256_of(raw),
        SETUP: CaptureSetup.of(plan).text,
        "temperature_source": thermometer,
    }
    positions = position_set(
        str(folder),
        np.array([dwell.mean(0) for dwell in force]),
        places,
        {key: value for key, value in comments.items() if value},
        (context, plan),
        time_s=np.array(time_s),
        temperature_degc=degc,
        n=np.array([len(dwell) for dwell in force], float),
    )
    entries = {"session": state.session, "device": state.device, "damage": faults, "identity": identity}
    warnings = [*faults, *filter(None, [identity_words(positions)])]
    return DwellSamples(
        positions,
        force,
        rate_hz,
        attempts[0].sha256[:16],
        warmth,
        counted=numbers,
        entries=entries,
        dwell_entries=dwell_entries,
        warnings=((str(folder), warnings),),
        lines=(f"{len(places)} of {counted(len(plan.steps), 'position')} of the plan",),
    )


def identity_of(state: RunState, attempts: Sequence[Attempt], names: Sequence[str]) -> dict[str, Any]:
    """The identity of the instrument for reduction.json, with the positions at which it was not confirmed."""
    since = min((entry["wall_ns"] for entry in state.doubts), default=None)
    if state.serial_number is not None:
        doubtful = [attempt.serial_number is None for attempt in attempts]
    else:  # If the instrument never states one: the attempts after an interruption of the line.
        doubtful = [since is not None and attempt.wall_ns > since for attempt in attempts]
    return {
        "confirmed": not any(doubtful) and state.serial_number is not None,
        "serial_number": state.serial_number,
        "positions_not_confirmed": [name for name, doubt in zip(names, doubtful, strict=True) if doubt],
        "entries": state.doubts,
    }


def identity_comments(identity: Mapping[str, Any]) -> dict[str, str]:
    """Comments of a file of position means about the identity of the instrument."""
    serial, doubtful = identity["serial_number"], identity["positions_not_confirmed"]
    if not doubtful:
        return {"serial_number": str(serial)} if serial else {}
    texts = "; ".join(entry["text"] for entry in identity["entries"] if "text" in entry)
    comments = {NOT_CONFIRMED: f"position {', '.join(doubtful)}: {texts or 'no serial number stated'}"}
    return comments | ({"serial_number_not_confirmed": str(serial)} if serial else {})


def _places(attempts: Sequence[Attempt], plan: CapturePlan) -> list[Place]:
    """The positions of attempts; each soak of a plan with new pitch settings is a run."""
    places = [Place("").at_step(plan, attempt.position) for attempt in attempts]
    if not (plan.soak.new_pitch_settings and plan.over_temperature):
        return places
    runs = [f"{plan.session.run}.{plan.soaks[attempt.position] + 1}" for attempt in attempts]
    return [replace(place, run=run) for place, run in zip(places, runs, strict=True)]


def _decoded(
    raw: Path, name: str, attempt: Attempt, device: Protocol, run: tuple[CapturePlan, RunState], rate_hz: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], float, dict[str, Any], dict[str, Any]]:
    """One position: good samples (n, 3) in local g, their temperatures, degC, time of the middle, s, entries of
    reduction.json, and arguments of `check_dwell`."""
    plan, state = run
    settings = _settings_of(state, plan, device)
    options = device.decoder_options(*state.text_columns(plan.port.columns, plan.port.unit), whole=True)
    samples, host_s, attempted, specials = _stretch(raw, attempt, device, settings, options)
    losses = losses_of(device, samples, host_s, rate_hz, attempted, specials)
    guard = round(plan.dwell.guard_s * rate_hz)
    inside = samples[attempted.start + guard : attempted.stop - guard]
    use = (inside.status == 0) & np.isfinite(inside.force).all(1)
    if use.sum() < _FEWEST_GOOD:
        raise InputError(f"{raw}: position {name}: only {use.sum()} good samples; repeat it")
    full = settings.range_g if settings and settings.range_g else (np.inf,) * 3
    near_full = (np.abs(inside.force) > _NEAR_FULL_SCALE * np.array(full)).any(1)
    stated = {key: attempt.summary[key] for key in ("requested_degc", "chamber_degc") if key in attempt.summary}
    return (
        inside.force[use] * (STANDARD_GRAVITY_MS2 / plan.site.gravity.value_ms2),
        inside.temperature[use],
        _middle_s(host_s[attempted.start : attempted.stop], attempt, state) * plan.port.speed,
        {"attempt": attempt.number, "flagged": int((~use).sum()), "sha256": attempt.sha256} | stated,
        {
            "saturated": int((near_full | ((inside.status & Status.OVERLOAD) != 0)).sum()),
            "lost": losses.lost,
            "lost_unresolved": losses.unresolved,
            "rate_fault": losses.rates.words(rate_hz * plan.port.speed),
        },
    )


def _settings_of(state: RunState, plan: CapturePlan, device: Protocol) -> Settings | None:
    """Range and rate: as the device stated when the run began, otherwise from the plan."""
    stated = state.configuration
    if stated is not None and "range_g" in stated:
        return settings_of(stated)
    return device.settings(plan.port.range_g, float(state.device["rate_hz"]))


def _stretch(
    raw: Path, attempt: Attempt, device: Protocol, settings: Settings | None, options: dict[str, Any]
) -> tuple[Samples, NDArray[np.float64], range, list[int]]:
    """Samples of an attempt and shortly before and after it: with stamps, range of the attempt, and places of replies."""
    records = [
        r for r in read_log(raw, attempt.log_before, attempt.log_stop + _AFTER_BYTES) if r.kind == RecordKind.BYTES
    ]
    decoded = decode_all(device.decoder(settings, **options), b"".join(r.payload for r in records))
    stops = np.cumsum([len(r.payload) for r in records])
    which = np.minimum(np.searchsorted(stops, decoded.samples.stop), len(records) - 1)
    host_s = np.array([r.stamp_ns * 1e-9 for r in records])[which]
    first = sum(r.offset < attempt.log_start for r in records)
    last = sum(r.stop <= attempt.log_stop for r in records) - 1
    inside = range(*map(int, np.searchsorted(which, [first, last + 1])))
    # After a restart of the recorder the stamps may jump back (a new boot): only samples in order are used.
    ordered = inside.stop + int(np.argmax(np.append(np.diff(host_s[inside.stop - 1 :]) < 0, True))) if inside else 0
    specials = [event.stop for event in decoded.events if event.counted]
    return decoded.samples[:ordered], host_s[:ordered], inside, specials


def _rate_of(attempts: Sequence[Attempt], at_contact_hz: float, speed: float) -> float:
    """The sample rate: that at the contact with the device, unless most dwells contradict it by the host's clock."""
    rate = float(np.median([attempt.summary.get("rate_hz") or np.nan for attempt in attempts])) / speed
    return rate if abs(rate / at_contact_hz - 1) > SAME_RATE else at_contact_hz


def _middle_s(host_s: NDArray[np.float64], attempt: Attempt, state: RunState) -> float:
    """Middle of the attempt in s since the session began, by the monotonic clock of its recording.

    That clock stops while the machine sleeps: the sleeping time is added, from the clock that continues.
    """
    begun = [d for d in state.devices if d["log_position"] <= attempt.log_start] or [state.device]
    before, after = begun[-1]["clocks"], attempt.clocks
    asleep_ns = 0
    if before.get("boot_ns") and after.get("boot_ns"):
        asleep_ns = (after["boot_ns"] - before["boot_ns"]) - (after["monotonic_ns"] - before["monotonic_ns"])
    middle = float(host_s[0] + host_s[-1]) / 2
    wall = before["wall_ns"] + (middle * 1e9 - before["monotonic_ns"]) + asleep_ns
    return (wall - state.devices[0]["clocks"]["wall_ns"]) * 1e-9


def _temperatures(
    warmth: Sequence[NDArray[np.float64]], attempts: Sequence[Attempt]
) -> tuple[NDArray[np.float64] | None, str]:
    """Temperature of each position: mean of the sensor, otherwise of the chamber, otherwise as requested; None if a position
    has none. And the thermometer, "" for that of the sensor."""
    summaries, degc = [attempt.summary for attempt in attempts], []
    for values, summary in zip(warmth, summaries, strict=True):
        known = values[np.isfinite(values)]
        of_chamber = summary.get("chamber_degc")
        degc.append(
            float(known.mean()) if len(known) else summary.get("requested_degc") if of_chamber is None else of_chamber
        )
    source = ""
    if not any(np.isfinite(values).any() for values in warmth):
        by_chamber = all(summary.get("chamber_degc") is not None for summary in summaries)
        requested = any("requested_degc" in summary for summary in summaries)
        source = "chamber" if by_chamber else "requested temperature, not measured" if requested else ""
    return (np.array(degc, float) if all(value is not None for value in degc) else None), source

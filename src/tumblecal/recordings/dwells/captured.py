"""Dwells of the folder of a capture: the accepted stretches of its raw log, decoded."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tumblecal.capture.capture_plan import SETUP, CapturePlan, CaptureSetup
from tumblecal.capture.decoding.framing import decode_all
from tumblecal.capture.decoding.losses import SAME_RATE
from tumblecal.capture.decoding.samples import Floats, Status, usable
from tumblecal.capture.journal import JOURNAL_NAME, RAW_NAME, Attempt, RunState, read_journal, replayed, sha256_of
from tumblecal.capture.log import RecordKind, read_log
from tumblecal.capture.protocols import protocol
from tumblecal.capture.run.dwell import losses_of
from tumblecal.capture.run.run_folder import plan_of_run, settings_of_run
from tumblecal.data.joined_clocks import TIME_SPEED, TIME_ZERO, moment
from tumblecal.data.position_comments import NOT_CONFIRMED, identity_words
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2
from tumblecal.ground.numbers_shown import counted
from tumblecal.ground.suggested_command import suggested
from tumblecal.recordings.dwells.dwell_samples import DwellSamples, dwell_samples
from tumblecal.recordings.dwells.places import places_of
from tumblecal.recordings.options import KnownContext


_NEAR_FULL_SCALE = 0.98
_AFTER_BYTES = 1 << 20
_FEWEST_GOOD = 8
# Thermometers of a position, the most direct first, and their entries of an attempt.
_THERMOMETERS = {"chamber": "chamber_degc", "requested temperature, not measured": "requested_degc"}


class _Dwell(NamedTuple):
    """A position: good samples (n, 3) in local g, their temperatures, degC, and the time of the middle, s; its temperature,
    degC, and thermometer ("" for that of the sensor); entries of reduction.json, and arguments of `check_dwell`."""

    force: Floats
    warmth: Floats
    time_s: float
    degc: float
    thermometer: str
    entries: dict[str, Any]
    counted: dict[str, Any]


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
    plan, raw = plan_of_run(folder, state), folder / RAW_NAME
    attempts, steps = [attempt for _, attempt in sorted(state.accepted.items())], places_of(plan)
    places = [steps[attempt.position] for attempt in attempts]
    if plan.soak.new_pitch_settings and plan.over_temperature:
        # Each soak is a run.
        runs = [f"{plan.session.run}.{plan.soaks[attempt.position] + 1}" for attempt in attempts]
        places = [replace(place, run=run) for place, run in zip(places, runs, strict=True)]
    # The rate is that at the contact with the device, unless most dwells contradict it by the host's clock.
    rate_hz, speed = float(state.device["rate_hz"]), plan.port.speed
    measured = float(np.median([attempt.summary.get("rate_hz") or np.nan for attempt in attempts])) / speed
    rate_hz = measured if abs(measured / rate_hz - 1) > SAME_RATE else rate_hz
    decoded = [
        _decoded(raw, place.position, attempt, (plan, state), rate_hz)
        for attempt, place in zip(attempts, places, strict=True)
    ]
    identity, comments = identity_of(state, attempts, [place.position for place in places])
    degc, thermometers = np.array([one.degc for one in decoded]), {one.thermometer for one in decoded}
    comments = (
        {"captured_in": folder.name}
        | comments
        | {
            "protocol": state.device["protocol"],
            "operator": state.session.get("operator", ""),
            "gravity_ms2": f"{plan.site.gravity.value_ms2:.6f}",
            "gravity_source": plan.site.gravity.source,
            TIME_ZERO: moment(state.devices[0]["clocks"]["wall_ns"] * 1e-9),
            TIME_SPEED: f"{speed:g}" if speed != 1 else "",
            "raw_sha256": sha256_of(raw),
            SETUP: CaptureSetup.of(plan).text,
            # The least direct one of several; none if the sensor states some.
            "temperature_source": "" if "" in thermometers else max(thermometers),
        }
    )
    dwells = dwell_samples(
        str(folder),
        places,
        [one.force for one in decoded],
        rate_hz,
        {key: value for key, value in comments.items() if value},
        (context, plan),
        temperatures=[one.warmth for one in decoded],
        fewest=_FEWEST_GOOD,
        remedy="; repeat it",
        columns={
            "time_s": np.array([one.time_s for one in decoded]),
            "temperature_degc": degc if np.isfinite(degc).all() else None,
        },
        recording=attempts[0].sha256[:16],
        counted=[one.counted for one in decoded],
        entries={"session": state.session, "device": state.device, "damage": faults, "identity": identity},
        dwell_entries=[one.entries for one in decoded],
        lines=(f"{len(places)} of {counted(len(plan.steps), 'position')} of the plan",),
    )
    warnings = [*faults, *filter(None, [identity_words(dwells.positions)])]
    return replace(dwells, warnings=((str(folder), warnings),))


def identity_of(
    state: RunState, attempts: Sequence[Attempt], names: Sequence[str]
) -> tuple[dict[str, Any], dict[str, str]]:
    """The identity of the instrument for reduction.json, with the positions at which it was not confirmed; and as comments of a
    file of position means."""
    serial = state.serial_number
    since = min((entry["wall_ns"] for entry in state.doubts), default=np.inf)
    # If the instrument never states a serial number: the attempts after an interruption of the line.
    doubts = [attempt.serial_number is None if serial else attempt.wall_ns > since for attempt in attempts]
    doubtful = [name for name, doubt in zip(names, doubts, strict=True) if doubt]
    identity = {
        "confirmed": bool(serial) and not doubtful,
        "serial_number": serial,
        "positions_not_confirmed": doubtful,
        "entries": state.doubts,
    }
    comments = {"serial_number_not_confirmed" if doubtful else "serial_number": str(serial)} if serial else {}
    if doubtful:
        texts = "; ".join(entry["text"] for entry in state.doubts if "text" in entry)
        comments[NOT_CONFIRMED] = f"position {', '.join(doubtful)}: {texts or 'no serial number stated'}"
    return identity, comments


def _decoded(raw: Path, name: str, attempt: Attempt, run: tuple[CapturePlan, RunState], rate_hz: float) -> _Dwell:
    """One position.

    **Raises:** `InputError` if its bytes were changed.
    """
    if sha256_of(raw, attempt.log_start, attempt.log_stop) != attempt.sha256:
        raise InputError(f"{raw}: the bytes of position {name} were changed after recording; restore the file")
    plan, state = run
    device = protocol(state.device["protocol"])
    settings = settings_of_run(state, plan, device)
    # Bytes shortly before and after the attempt: its first and last frame may begin or end there.
    stop = attempt.log_stop + _AFTER_BYTES
    records = [r for r in read_log(raw, attempt.log_before, stop) if r.kind == RecordKind.BYTES]
    decoder = device.decoder(replace(settings, whole=True))
    decoded = decode_all(decoder, b"".join(r.payload for r in records))
    stops = np.cumsum([len(r.payload) for r in records])
    which = np.minimum(np.searchsorted(stops, decoded.samples.stop), len(records) - 1)
    host_s = np.array([r.stamp_ns * 1e-9 for r in records])[which]
    first = sum(r.offset < attempt.log_start for r in records)
    last = sum(r.stop <= attempt.log_stop for r in records)
    inside = range(*map(int, np.searchsorted(which, [first, last])))
    # After a restart of the recorder the stamps may jump back (a new boot): only samples in order are used.
    ordered = inside.stop + int(np.argmax(np.append(np.diff(host_s[inside.stop - 1 :]) < 0, True))) if inside else 0
    samples, host_s = decoded.samples[:ordered], host_s[:ordered]
    specials = [event.stop for event in decoded.events if event.counted]
    losses = losses_of(device, samples, host_s, rate_hz, inside, specials)
    guard = round(plan.dwell.guard_s * rate_hz)
    dwell = samples[inside.start + guard : inside.stop - guard]
    use = usable(dwell)
    full = settings.range_g if settings and settings.range_g else (np.inf,) * 3
    saturated = (np.abs(dwell.force) > _NEAR_FULL_SCALE * np.array(full)).any(1) | (dwell.status & Status.OVERLOAD != 0)
    warmth, thermometer = dwell.temperature[use], ""
    known = warmth[np.isfinite(warmth)]
    temperatures = {key: attempt.summary[key] for key in ("requested_degc", "chamber_degc") if key in attempt.summary}
    degc = float(known.mean()) if len(known) else np.nan
    if not len(known):
        thermometer = next((one for one, key in _THERMOMETERS.items() if temperatures.get(key) is not None), "")
        degc = temperatures.get(_THERMOMETERS.get(thermometer, ""), np.nan)
    return _Dwell(
        dwell.force[use] * (STANDARD_GRAVITY_MS2 / plan.site.gravity.value_ms2),
        warmth,
        _middle_s(host_s[inside.start : inside.stop], attempt, state) * plan.port.speed,
        degc,
        thermometer,
        {"attempt": attempt.number, "flagged": int((~use).sum()), "sha256": attempt.sha256} | temperatures,
        {
            "saturated": int(saturated.sum()),
            "lost": losses.lost,
            "lost_unresolved": losses.unresolved,
            "rate_fault": losses.rate_words(rate_hz * plan.port.speed),
        },
    )


def _middle_s(host_s: Floats, attempt: Attempt, state: RunState) -> float:
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

"""From a capture's folder to position means: decode, check, average, say how sure.

The sd of a mean comes from the coloured noise: an average over the noise models that the dwells allow, and its closed
form of the means over them. sd / sqrt(n) would be too small. What neighbouring means have in common is written beside it.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.capture_plan import CapturePlan, read_plan
from tumblecal.capture.dwell import losses_of
from tumblecal.capture.dwell_checks import DwellChecks, check_dwell
from tumblecal.capture.framing import decode_all
from tumblecal.capture.journal import PLAN_NAME, RAW_NAME, Attempt, Standing, read_journal, replayed, sha256_of
from tumblecal.capture.kept_setup import SETUP, KeptSetup
from tumblecal.capture.log import Kind, read_log
from tumblecal.capture.protocols import Protocol, protocol
from tumblecal.capture.protocols.stim300 import settings_of
from tumblecal.capture.samples import Samples, Settings, Status
from tumblecal.data.files import write_positions
from tumblecal.data.positions import PositionSet
from tumblecal.ground.atomic import write_text
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2
from tumblecal.noise.allan import AllanDeviation, averaging_factors, overlapping_allan
from tumblecal.noise.allan_fit import quantisation_and_misfit
from tumblecal.noise.dwell_fit import ordinary_dwells
from tumblecal.noise.dwell_sd import batch_means_sd, sd_of_means, white_sd
from tumblecal.noise.recorded import NOISE_MODEL, RecordedNoise


_NEAR_FULL_SCALE = 0.98
_AFTER_BYTES = 1 << 20


@dataclass(frozen=True)
class Reduced:
    """One position.

    **Arguments:**

    - `position`: index in the plan. `force`: good samples in local g, shape (n, 3). `time_s`: its middle.
    - `mean`: local g, shape (3,).
    """

    position: int
    attempt: Attempt
    force: NDArray[np.float64]
    time_s: float
    temperature_degc: float | None
    saturated: int
    flagged: int
    lost: int
    lost_unresolved: int
    mean: NDArray[np.float64]


@dataclass(frozen=True)
class Reduction:
    """All positions of a capture, with the noise of the three axes.

    `recorded` is the noise that the sd of the means and their correlation come from.
    """

    positions: list[Reduced]
    checks: list[DwellChecks]
    sd_of_mean: NDArray[np.float64]
    recorded: RecordedNoise
    rate_hz: float
    plan: CapturePlan
    standing: Standing


def reduce(folder: Path, said: Callable[[str], None] = lambda text: None) -> Reduction:
    """Reduce a capture.

    **Arguments:**

    - `folder`: of `tumblecal capture`.
    - `said`: told what is going on.

    **Raises:** `InputError` when the folder holds no capture, nothing was accepted, or the raw log was changed.
    """
    standing = replayed(read_journal(folder))
    if not standing.accepted:
        raise InputError(f"{folder}: no position was accepted yet; go on with: tumblecal capture --resume {folder}")
    plan = read_plan(folder / PLAN_NAME)
    spoken = protocol(standing.device["protocol"])
    rate = float(standing.device["rate_hz"])
    raw = folder / RAW_NAME
    positions = []
    for position, attempt in sorted(standing.accepted.items()):
        said(f"position {plan.steps[position].name}")
        if sha256_of(raw, attempt.log_start, attempt.log_stop) != attempt.sha256:
            raise InputError(
                f"{raw}: position {plan.steps[position].name} was changed since it was recorded; restore the file"
            )
        positions.append(_reduced(raw, attempt, plan, spoken, rate, standing))
    forces, middle_s = [p.force for p in positions], np.array([p.time_s for p in positions])
    recorded = RecordedNoise.of(forces, rate, float(np.ptp(middle_s)), positions[0].attempt.sha256[:16])
    sd = sd_of_means(recorded, forces, middle_s)
    checks = [
        check_dwell(p.force, rate, row, saturated=p.saturated, lost=p.lost, lost_unresolved=p.lost_unresolved)
        for p, row in zip(positions, sd, strict=True)
    ]
    return Reduction(positions, checks, sd, recorded, rate, plan, standing)


def _allan(forces: list[NDArray[np.float64]], rate_hz: float) -> list[AllanDeviation]:
    factors = averaging_factors(max(len(force) for force in forces), per_octave=2)
    calm = ordinary_dwells(forces)
    return [overlapping_allan([force[:, axis] for force in calm], rate_hz, factors) for axis in range(3)]


def decoded_stretch(
    raw: Path, attempt: Attempt, spoken: Protocol, settings: Settings | None, options: dict
) -> tuple[Samples, NDArray[np.float64], int, list[int]]:
    """Samples of an attempt and a little after it: with stamps, how many belong to it, and where replies stand."""
    records = [r for r in read_log(raw, attempt.log_start, attempt.log_stop + _AFTER_BYTES) if r.kind == Kind.BYTES]
    decoder = spoken.decoder(settings, **options)
    decoded = decode_all(decoder, b"".join(r.payload for r in records))
    stops = np.cumsum([len(r.payload) for r in records])
    stamps = np.array([r.stamp_ns * 1e-9 for r in records])
    which = np.minimum(np.searchsorted(stops, decoded.samples.stop), len(records) - 1)
    last = sum(r.stop <= attempt.log_stop for r in records) - 1
    own = int(np.searchsorted(which, last, side="right"))
    # After a restart of the recorder the stamps may jump back (another boot): only what is in order is used.
    host_s = stamps[which]
    ordered = own + int(np.argmax(np.append(np.diff(host_s[own - 1 :]) < 0, True))) if own else 0
    specials = [event.stop for event in decoded.events if event.counted]
    return decoded.samples[:ordered], host_s[:ordered], own, specials


def device_settings(standing: Standing, plan: CapturePlan, spoken: Protocol) -> Settings | None:
    """Range and rate: as the device told when the run began, else as the plan says."""
    for event in standing.device["events"]:
        if event["kind"] == "configuration" and "range_g" in event:
            return settings_of(event)
    rate = float(standing.device["rate_hz"])
    if plan.port.range_g is not None:
        return spoken.with_range(Settings(rate_hz=rate), float(plan.port.range_g))
    return Settings(rate_hz=rate)


def _reduced(
    raw: Path, attempt: Attempt, plan: CapturePlan, spoken: Protocol, rate: float, standing: Standing
) -> Reduced:
    settings = device_settings(standing, plan, spoken)
    options = spoken.asked(plan.port.columns, plan.port.unit, whole=True)
    samples, host_s, own, specials = decoded_stretch(raw, attempt, spoken, settings, options)
    losses = losses_of(spoken, samples, host_s, rate, own, specials)
    guard = round(plan.dwell.guard_s * rate)
    inside = samples[guard : own - guard]
    use = (inside.status == 0) & np.isfinite(inside.force).all(1)
    if use.sum() < 8:
        raise InputError(f"{raw}: position {plan.steps[attempt.position].name}: only {use.sum()} good samples; redo it")
    force = inside.force[use] * (STANDARD_GRAVITY_MS2 / plan.site.gravity.value_ms2)
    full = settings.range_g if settings and settings.range_g else (np.inf,) * 3
    near_full = (np.abs(inside.force) > _NEAR_FULL_SCALE * np.array(full)).any(1)
    overloaded = (inside.status & Status.OVERLOAD) != 0
    temperature = inside.temperature[use]
    known = temperature[np.isfinite(temperature)]
    return Reduced(
        position=attempt.position,
        attempt=attempt,
        force=force,
        time_s=_wall_s(host_s[:own], attempt, standing) * plan.port.speed,
        temperature_degc=float(known.mean()) if len(known) else None,
        saturated=int((near_full | overloaded).sum()),
        flagged=int((~use).sum()),
        lost=losses.lost,
        lost_unresolved=losses.unresolved,
        mean=force.mean(0),
    )


def _wall_s(host_s: NDArray[np.float64], attempt: Attempt, standing: Standing) -> float:
    """Middle of the attempt in s since the session began, by the monotonic clock of the recording it belongs to."""
    begun = [d for d in standing.devices if d["log_position"] <= attempt.log_start] or [standing.device]
    clock = begun[-1]["clocks"]
    middle = float(host_s[0] + host_s[-1]) / 2
    wall = clock["wall_ns"] + (middle * 1e9 - clock["monotonic_ns"])
    return (wall - standing.devices[0]["clocks"]["wall_ns"]) * 1e-9


def position_set(reduction: Reduction, folder: Path) -> PositionSet:
    """The means as a position set, for `calibrate` and `diagnose`."""
    r, plan = reduction, reduction.plan
    steps = [plan.steps[p.position] for p in r.positions]
    temperatures = [p.temperature_degc for p in r.positions]
    approaches = [s.approach for s in steps]
    session, device = r.standing.session, r.standing.device
    serial = device.get("serial_number")
    comments = {
        "captured_in": folder.name,
        **({"serial_number": str(serial)} if serial else {}),
        "protocol": device["protocol"],
        "operator": session.get("operator", ""),
        "gravity_ms2": f"{plan.site.gravity.value_ms2:.6f}",
        "gravity_source": plan.site.gravity.source,
        "raw_sha256": sha256_of(folder / RAW_NAME, 0, (folder / RAW_NAME).stat().st_size),
        SETUP: KeptSetup.of(plan).text,
        NOISE_MODEL: r.recorded.text(),
    }
    return PositionSet(
        names=tuple(str(s.name) for s in steps),
        alpha_deg=np.array([s.alpha_deg for s in steps], float),
        beta_deg=np.array([s.beta_deg for s in steps], float),
        readings=np.array([p.mean for p in r.positions]),
        sd=r.sd_of_mean,
        run=(plan.session.run,) * len(steps) if plan.session.run != "1" else None,
        mount=(plan.session.mount,) * len(steps) if plan.session.mount != "1" else None,
        time_s=np.array([p.time_s for p in r.positions]),
        temperature_degc=np.array(temperatures, float) if all(t is not None for t in temperatures) else None,
        approach=np.array(approaches, float) if all(a is not None for a in approaches) else None,
        n=np.array([len(p.force) for p in r.positions], float),
        recorded_noise=(comments[NOISE_MODEL],) * len(steps),
        comments={k: v for k, v in comments.items() if v},
        source=str(folder),
    )


def write_reduction(reduction: Reduction, folder: Path, out: Path | None = None) -> list[Path]:
    """Write positions.csv, positions.parquet and reduction.json of a capture's folder, into it or into `out`."""
    data, out = position_set(reduction, folder), out or folder
    paths = [out / "positions.csv", out / "positions.parquet", out / "reduction.json"]
    write_positions(paths[0], data)
    write_positions(paths[1], data)
    write_text(paths[2], json.dumps(_content(reduction), indent=1) + "\n")
    return paths


def axes_content(dwells: list[NDArray[np.float64]], rate_hz: float, recorded: RecordedNoise) -> dict:
    """Noise coefficients and Allan deviation of each axis, for a file."""
    axes = {}
    coefficients = recorded.reported.coefficients()
    for axis, a in enumerate(_allan(dwells, rate_hz)):
        axes["xyz"[axis]] = {
            "noise": {**coefficients[axis], **quantisation_and_misfit(a, recorded.reported, axis)},
            "allan": {
                "tau_s": a.tau_s.tolist(),
                "deviation_g": a.deviation.tolist(),
                "low_g": a.low.tolist(),
                "high_g": a.high.tolist(),
            },
        }
    return axes


def dwell_content(force: NDArray[np.float64], sd: NDArray[np.float64], checks: DwellChecks) -> dict:
    """Mean, its sd three ways, and the checks of a dwell, for a file."""
    return {
        "n": len(force),
        "mean_g": force.mean(0).tolist(),
        "sd_of_mean_g": sd.tolist(),
        "batch_means_sd_g": batch_means_sd(force).tolist(),
        "white_noise_sd_g": white_sd(force).tolist(),
        "checks": checks.as_dict(),
    }


def _content(reduction: Reduction) -> dict:
    r = reduction
    return {
        "schema": "tumblecal.reduction/1",
        "rate_hz": r.rate_hz,
        "noise_model": json.loads(r.recorded.text()),
        "session": r.standing.session,
        "device": r.standing.device,
        "axes": axes_content([p.force for p in r.positions], r.rate_hz, r.recorded),
        "positions": [
            {
                "name": r.plan.steps[p.position].name,
                "attempt": p.attempt.number,
                "flagged": p.flagged,
                "sha256": p.attempt.sha256,
                **dwell_content(p.force, r.sd_of_mean[k], r.checks[k]),
            }
            for k, p in enumerate(r.positions)
        ],
    }

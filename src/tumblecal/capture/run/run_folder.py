"""The folder of a capture, locked by one process at a time: a new run, or a resumed one."""

import platform
import shutil
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from tumblecal.capture.capture_plan import OPERATOR, CapturePlan, SoakTable, read_plan
from tumblecal.capture.decoding.samples import Settings
from tumblecal.capture.journal import JOURNAL_NAME, PLAN_NAME, Journal, RunState, sha256_of
from tumblecal.capture.port.recorder import clocks
from tumblecal.capture.protocols import Protocol, protocol
from tumblecal.capture.protocols.stim300 import settings_of
from tumblecal.ground.atomic import writable_folder, written_aside
from tumblecal.ground.errors import InputError
from tumblecal.ground.strict_toml import checked
from tumblecal.ground.toml_faults import faults_at


# Options of a call, and keys of the plan.
_CRITERION = {
    "soak_tolerance": "tolerance_degc",
    "soak_rate": "rate_degc_per_min",
    "soak_minutes": "stable_min",
    "soak_timeout": "timeout_min",
}


@dataclass
class RunFolder:
    """A capture's folder, locked by this process: the open journal is the lock, which ends with the process.

    **Arguments:**

    - `folder`: the folder. `plan`: the plan. `journal`: open for writing, with the state of the run.
    """

    folder: Path
    plan: CapturePlan
    journal: Journal

    @property
    def complete(self) -> bool:
        """Whether all positions are done."""
        return len(self.journal.state.accepted) == len(self.plan.steps)


@contextmanager
def begin(plan_path: Path, folder: Path, port: str | None = None) -> Iterator[RunFolder]:
    """Lock a folder while entered, and begin a capture there, with a copy of the plan.

    A run that found no device is begun again: its entries remain, and a new session follows them.

    **Arguments:**

    - `plan_path`: the plan. `folder`: created if it does not exist. `port`: replaces the port of the plan.

    **Raises:** `InputError` if the plan is faulty, another process has locked the folder, it contains a capture already,
    or the disk is too small.
    """
    plan = _with_port(read_plan(plan_path), port)
    with faults_at(plan_path, "port.protocol"):
        protocol(plan.port.protocol)
    writable_folder(folder)
    _check_room(plan, folder)
    with closing(Journal(folder)) as journal:
        if journal.state.devices or journal.state.attempts:
            raise InputError(
                f"{folder}: contains a capture already; resume it by --resume {folder}, or give another folder"
            )
        copy = folder / PLAN_NAME
        with written_aside(copy) as aside:
            aside.write_bytes(plan_path.read_bytes())
        journal.write(
            "session",
            plan_sha256=sha256_of(copy),
            **plan.session.model_dump(),
            gravity_ms2=plan.site.gravity.value_ms2,
            gravity_source=plan.site.gravity.source,
            site=plan.site.model_dump(),
            host=platform.node(),
            system=platform.platform(),
            versions={name: version(name) for name in ("tumblecal", "numpy", "pyserial")}
            | {"python": platform.python_version()},
            clocks=clocks(),
        )
        yield RunFolder(folder, plan, journal)


@contextmanager
def resume(folder: Path, port: str | None = None) -> Iterator[RunFolder]:
    """Lock the folder of an interrupted capture while entered.

    **Raises:** `InputError` if there is none, another process has locked it, or its plan was changed.
    """
    path = folder / JOURNAL_NAME
    if not path.is_file():
        raise InputError(f"{folder}: no {JOURNAL_NAME} here; give the folder of a capture")
    with closing(Journal(folder)) as journal:
        if not journal.state.session:
            raise InputError(f"{path}: contains no capture; it may have been ended before the first entry")
        yield RunFolder(folder, _with_port(plan_of_run(folder, journal.state), port), journal)


def plan_of_run(folder: Path, state: RunState) -> CapturePlan:
    """The plan with which the capture in a folder began.

    **Raises:** `InputError` if it is missing or was changed: it contains the angles and gravity of the positions.
    """
    path = folder / PLAN_NAME
    if not path.is_file():
        raise InputError(f"{path}: this file is missing; restore the plan of this capture")
    plan = read_plan(path)
    if state.session.get("plan_sha256") not in (None, sha256_of(path)):
        raise InputError(f"{path}: this file was changed after the capture began; restore the original")
    if max(state.accepted, default=0) >= len(plan.steps):
        raise InputError(
            f"{folder}: the journal has positions that {PLAN_NAME} does not have; restore both from a copy"
        )
    return plan


def settings_of_run(state: RunState, plan: CapturePlan, device: Protocol) -> Settings:
    """Range and rate of the device: as it stated them in the run, otherwise from the plan; columns and unit of text lines:
    those of the plan, otherwise those of the header line when the run began."""
    if state.configuration is not None:
        return settings_of(state.configuration)
    port, layout = plan.port, state.stated("layout")
    columns, unit = port.columns or ",".join(layout.get("columns", ())), port.unit or layout.get("unit", "")
    return device.settings(port.range_g, state.device.get("rate_hz") or port.rate_hz, columns, unit)


def with_temperatures(plan: CapturePlan, chamber: str | None = None, **soak: float | None) -> CapturePlan:
    """The plan with a chamber at a port (or the `operator`), and a criterion of a stable temperature; None: as in the plan.

    **Raises:** `InputError` for a value that is not above 0, or for options that the plan does not need.
    """
    stated = {_CRITERION[name]: value for name, value in soak.items() if value is not None}
    if (stated or chamber is not None) and not plan.over_temperature:
        raise InputError(
            "capture: the plan requests no temperature; remove --chamber and --soak-..., or add positions.temperature_degc"
        )
    criterion = checked(Path("--soak-..."), plan.soak.model_dump() | stated, SoakTable)
    url = plan.chamber.url if chamber is None else chamber.removeprefix(OPERATOR)
    return plan.model_copy(update={"soak": criterion, "chamber": plan.chamber.model_copy(update={"url": url})})


def _with_port(plan: CapturePlan, port: str | None) -> CapturePlan:
    if port is not None:
        plan = plan.model_copy(update={"port": plan.port.model_copy(update={"url": port})})
    if not plan.port.url:
        raise InputError("capture: no port; set port.url in the plan or give --port (`tumblecal ports` lists them)")
    return plan


def _check_room(plan: CapturePlan, folder: Path) -> None:
    """Raise if the disk is too small for twice the dwells, at 80 bytes a sample."""
    need = 2 * len(plan.steps) * (plan.dwell.seconds + plan.dwell.settle_s) * (plan.port.rate_hz or 2000.0) * 80
    free = shutil.disk_usage(folder).free
    if free < min(need, 5e9):
        raise InputError(
            f"{folder}: {free / 1e9:.2f} GB free, {need / 1e9:.2f} GB wanted; make room or give another folder"
        )

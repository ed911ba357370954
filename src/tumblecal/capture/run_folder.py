"""The folder of a capture, held by one process at a time: begun, or taken up again."""

import platform
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from tumblecal.capture.capture_plan import CapturePlan, read_plan
from tumblecal.capture.journal import PLAN_NAME, Journal, Standing, read_journal, replayed, sha256_of
from tumblecal.capture.protocols import protocol
from tumblecal.capture.recorder import clocks
from tumblecal.ground.atomic import writable_folder, written_aside
from tumblecal.ground.errors import InputError
from tumblecal.ground.toml_faults import faults_at


@dataclass
class RunFolder:
    """A capture's folder while this process holds it: the open journal is the lock, and it dies with the process.

    **Arguments:**

    - `folder`: where. `plan`: what is wanted.
    - `standing`: what is done already.
    - `journal`: open for writing. `damage`: a line for each stretch of it that holds no entry.
    """

    folder: Path
    plan: CapturePlan
    standing: Standing
    journal: Journal
    damage: tuple[str, ...] = ()

    def __enter__(self) -> "RunFolder":
        return self

    def __exit__(self, *_: object) -> None:
        self.journal.close()


def begin(plan_path: Path, folder: Path, port: str | None = None) -> RunFolder:
    """Hold a folder and begin a capture there, with its own copy of the plan.

    A run that met no device is begun again: its entries stay, and a new session follows them.

    **Arguments:**

    - `plan_path`: the plan. `folder`: made if it is not there. `port`: in place of the plan's.

    **Raises:** `InputError` when the plan is faulty, another process holds the folder, it holds a capture already,
    or the disk is too small.
    """
    plan = _with_port(read_plan(plan_path), port)
    with faults_at(plan_path, "port.protocol"):
        protocol(plan.port.protocol)
    writable_folder(folder)
    _check_room(plan, folder)

    def start(journal: Journal) -> RunFolder:
        if any(entry["entry"] == "device" for entry in journal.entries()):
            raise InputError(f"{folder}: holds a capture already; go on with --resume {folder}, or give another folder")
        copy = folder / PLAN_NAME
        with written_aside(copy) as aside:
            aside.write_bytes(plan_path.read_bytes())
        journal.write(
            "session",
            plan_sha256=sha256_of(copy, 0, copy.stat().st_size),
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
        return RunFolder(folder, plan, Standing(), journal)

    return _held(folder, start)


def resume(folder: Path, port: str | None = None) -> RunFolder:
    """Hold the folder of a capture that was stopped.

    **Raises:** `InputError` when there is none, another process holds it, or its plan was changed.
    """
    read_journal(folder)

    def take_up(journal: Journal) -> RunFolder:
        damage = list[str]()
        standing = replayed(journal.entries(damage))
        path = folder / PLAN_NAME
        if not path.is_file():
            raise InputError(f"{path}: is missing; put back the plan this capture began with")
        if sha256_of(path, 0, path.stat().st_size) != standing.session["plan_sha256"]:
            raise InputError(f"{path}: was changed since the capture began; put back the original")
        return RunFolder(folder, _with_port(read_plan(path), port), standing, journal, tuple(damage))

    return _held(folder, take_up)


def _held(folder: Path, use: Callable[[Journal], RunFolder]) -> RunFolder:
    """What `use` makes of the folder's journal, which nobody else can have open; closed again when it fails."""
    journal = Journal(folder)
    try:
        return use(journal)
    except BaseException:
        journal.close()
        raise


def _with_port(plan: CapturePlan, port: str | None) -> CapturePlan:
    if port is not None:
        plan = plan.model_copy(update={"port": plan.port.model_copy(update={"url": port})})
    if not plan.port.url:
        raise InputError("capture: no port; set port.url in the plan or give --port (`tumblecal ports` lists them)")
    return plan


def _check_room(plan: CapturePlan, folder: Path) -> None:
    need = 2 * len(plan.steps) * (plan.dwell.seconds + plan.dwell.settle_s) * (plan.port.rate_hz or 2000.0) * 80
    free = shutil.disk_usage(folder).free
    if free < min(need, 5e9):
        raise InputError(
            f"{folder}: {free / 1e9:.2f} GB free, {need / 1e9:.2f} GB wanted; make room or give another folder"
        )

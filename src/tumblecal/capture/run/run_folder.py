"""The folder of a capture, locked by one process at a time: a new run, or a resumed one."""

import platform
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from tumblecal.capture.capture_plan import CapturePlan, PlanPosition, read_plan
from tumblecal.capture.journal import PLAN_NAME, Journal, RunState, read_journal, recording_s, replayed, sha256_of
from tumblecal.capture.port.recorder import clocks
from tumblecal.capture.protocols import protocol
from tumblecal.ground.atomic import writable_folder, written_aside
from tumblecal.ground.errors import InputError
from tumblecal.ground.toml_faults import faults_at


# Copies of the files of an adaptive run.
RIG_NAME, TARGET_NAME = "capture_rig.toml", "capture_target.toml"


@dataclass(frozen=True)
class AdaptiveFiles:
    """An adaptive run: its time, min, and the contents of the rig file and of the target file (None: no target)."""

    minutes: float
    rig: bytes
    target: bytes | None = None

    @property
    def contents(self) -> dict[str, bytes]:
        """The contents by the name of the copy."""
        return {RIG_NAME: self.rig} | ({} if self.target is None else {TARGET_NAME: self.target})


@dataclass
class RunFolder:
    """A capture's folder, locked by this process: the open journal is the lock, which ends with the process.

    **Arguments:**

    - `folder`: the folder. `plan`: the plan.
    - `state`: state of the run.
    - `journal`: open for writing. `damage`: a line for each stretch of it without an entry.
    - `spent_s`: time of the earlier sittings, s of the host's clock.
    """

    folder: Path
    plan: CapturePlan
    state: RunState
    journal: Journal
    damage: tuple[str, ...] = ()
    spent_s: float = 0.0

    @property
    def complete(self) -> bool:
        """Whether nothing remains to be measured."""
        if self.state.minutes is not None:
            return self.state.finished
        return len(self.state.accepted) == len(self.plan.steps)

    @property
    def total_words(self) -> str:
        """The number of positions of the plan; empty for an adaptive run, which has no fixed number."""
        return "" if self.state.minutes is not None else f" of {len(self.plan.steps)}"

    def __enter__(self) -> "RunFolder":
        return self

    def __exit__(self, *_: object) -> None:
        self.journal.close()


def begin(plan_path: Path, folder: Path, port: str | None = None, adaptive: AdaptiveFiles | None = None) -> RunFolder:
    """Lock a folder and begin a capture there, with a copy of the plan.

    A run that found no device is begun again: its entries remain, and a new session follows them.

    **Arguments:**

    - `plan_path`: the plan. `folder`: created if it does not exist. `port`: replaces the port of the plan.
    - `adaptive`: further positions are chosen during the run.

    **Raises:** `InputError` if the plan is faulty, another process has locked the folder, it contains a capture already,
    or the disk is too small.
    """
    plan = _with_port(read_plan(plan_path), port)
    with faults_at(plan_path, "port.protocol"):
        protocol(plan.port.protocol)
    writable_folder(folder)
    _check_room(plan, folder)

    def start(journal: Journal) -> RunFolder:
        if any(entry["entry"] == "device" for entry in journal.entries()):
            raise InputError(
                f"{folder}: contains a capture already; resume it by --resume {folder}, or give another folder"
            )
        copy = folder / PLAN_NAME
        with written_aside(copy) as aside:
            aside.write_bytes(plan_path.read_bytes())
        for name, content in adaptive.contents.items() if adaptive else ():
            with written_aside(folder / name) as aside:
                aside.write_bytes(content)
        entry = journal.write(
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
            **_adaptive_entry(adaptive, folder, len(plan.steps)),
        )
        return RunFolder(folder, plan, replayed([entry]), journal)

    return _held(folder, start)


def resume(folder: Path, port: str | None = None) -> RunFolder:
    """Lock the folder of an interrupted capture.

    **Raises:** `InputError` if there is none, another process has locked it, or its plan was changed.
    """
    read_journal(folder)

    def take_up(journal: Journal) -> RunFolder:
        damage = list[str]()
        entries = journal.entries(damage)
        state = replayed(entries)
        plan = plan_of_run(folder, state)
        return RunFolder(folder, _with_port(plan, port), state, journal, tuple(damage), recording_s(entries))

    return _held(folder, take_up)


def plan_of_run(folder: Path, state: RunState) -> CapturePlan:
    """The plan with which the capture in a folder began, with the positions that were chosen since.

    **Raises:** `InputError` if it is missing or was changed: it contains the angles and gravity of the positions.
    """
    path = folder / PLAN_NAME
    _check_unchanged(path, state.session.get("plan_sha256"))
    plan = read_plan(path)
    further = list[PlanPosition]()
    for number in range(len(plan.steps), max(state.chosen, default=-1) + 1):
        chosen = state.chosen.get(number)
        if chosen is None and number in state.accepted:
            raise InputError(f"{folder}: the journal has no angles of position {number + 1}; restore it from a copy")
        if chosen is None:  # never measured, and its entry is damaged: another one replaces it
            state.skipped.add(number)
            further.append(plan.steps[0].model_copy(update={"name": str(number + 1)}))
        else:
            further.append(PlanPosition(alpha_deg=chosen.alpha_deg, beta_deg=chosen.beta_deg, name=chosen.name))
    return plan.continued(further)


def adaptive_files(folder: Path, state: RunState) -> AdaptiveFiles | None:
    """The files of an adaptive run; None for a run of fixed positions.

    **Raises:** `InputError` if one is missing or was changed.
    """
    stated = state.session.get("adaptive")
    if stated is None or state.minutes is None:
        return None
    contents = list[bytes | None]()
    for name in (RIG_NAME, TARGET_NAME):
        if name in stated["sha256"]:
            _check_unchanged(folder / name, stated["sha256"][name])
        contents.append((folder / name).read_bytes() if name in stated["sha256"] else None)
    return AdaptiveFiles(state.minutes, contents[0] or b"", contents[1])


def _adaptive_entry(adaptive: AdaptiveFiles | None, folder: Path, positions: int) -> dict[str, Any]:
    if adaptive is None:
        return {}
    sha256 = {name: sha256_of(folder / name) for name in adaptive.contents}
    return {"adaptive": {"minutes": adaptive.minutes, "positions": positions, "sha256": sha256}}


def _check_unchanged(path: Path, sha256: str | None) -> None:
    if not path.is_file():
        raise InputError(f"{path}: this file is missing; restore the one of this capture")
    if sha256 not in (None, sha256_of(path)):
        raise InputError(f"{path}: this file was changed after the capture began; restore the original")


def _held(folder: Path, use: Callable[[Journal], RunFolder]) -> RunFolder:
    """The result of `use` for the folder's journal, which is opened exclusively, and closed if `use` fails."""
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
    seconds = 2 * len(plan.steps) * (plan.dwell.seconds + plan.dwell.settle_s)
    seconds += 4 * 60 * plan.soak.stable_min * (plan.soaks[-1] + 1) * plan.over_temperature
    need = seconds * (plan.port.rate_hz or 2000.0) * 80
    free = shutil.disk_usage(folder).free
    if free < min(need, 5e9):
        raise InputError(
            f"{folder}: {free / 1e9:.2f} GB free, {need / 1e9:.2f} GB wanted; make room or give another folder"
        )

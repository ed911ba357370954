"""Options of an adaptive capture, and its chooser."""

from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from tomllib import loads
from typing import TYPE_CHECKING

from cyclopts import Parameter

from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    from tumblecal.capture.capture_plan import CapturePlan
    from tumblecal.capture.run.choice import Choice, Ending, Progress
    from tumblecal.capture.run.run_folder import AdaptiveFiles, RunFolder
    from tumblecal.design.sequential.adaptive import AdaptiveChooser

_LONGEST_MIN = 1e5


@Parameter(name="*")
@dataclass(frozen=True)
class AdaptiveOptions:
    """Positions chosen during the measurement, after those of the plan. --resume keeps them.

    Parameters
    ----------
    adaptive
        Time for the whole measurement, min, without interruptions. With --resume: a new total time. Example: --adaptive 60.
    rig
        Rig file with the table [head]: settings, times and noise of the head. Default: the angles of the plan, with a noise of
        0.1 mg. Example: --rig configs/plan_head.toml.
    target
        File of standard uncertainties that end the measurement (TOML, bias_x = "0.05 mg"). Default: the whole time is used.
        Example: --target target.toml.
    """

    adaptive: float | None = None
    rig: Path | None = None
    target: Path | None = None

    def begun(self, plan_path: Path) -> "tuple[AdaptiveFiles, RunChooser] | tuple[None, None]":
        """The files and the chooser of a new capture; None for fixed positions. Assumptions and targets out of reach are
        printed.

        **Raises:** `InputError` for options that contradict each other or the plan.
        """
        if self.adaptive is None:
            if self.rig is not None or self.target is not None:
                raise InputError("capture: --rig and --target are for an adaptive capture; add --adaptive MINUTES")
            return None, None
        from tumblecal.capture.capture_plan import read_plan
        from tumblecal.capture.run.run_folder import AdaptiveFiles
        from tumblecal.ground.examples import file_or_example
        from tumblecal.ground.strict_toml import read_toml

        minutes, plan = _checked(self.adaptive), read_plan(plan_path)
        needed = len(plan.steps) * (plan.dwell.seconds + plan.dwell.settle_s) / 60
        if needed > minutes:
            raise InputError(
                f"{plan_path}: the {len(plan.steps)} positions of the plan take {needed:.3g} min or more, but --adaptive is "
                f"{minutes:g} min; remove positions or allow more time"
            )
        contents = dict[str, bytes]()
        for name, path in (("rig", self.rig), ("target", self.target)):
            if path is not None:
                file = file_or_example(path)
                read_toml(file)
                contents[name] = file.read_bytes()
        if self.rig is None:
            from tumblecal.design.sequential.adaptive_rig import assumed_rig

            contents["rig"] = assumed_rig(plan).encode()
            print("no --rig: the head sets the angles of the plan in all combinations; noise of a position 0.1 mg")
        chooser = RunChooser(plan, contents["rig"], self.rig or Path("assumed rig"), self.target)
        if warning := chooser.loaded.unreachable(minutes):
            print(f"warning: {self.target}: {warning}")
        return AdaptiveFiles(minutes, contents["rig"], contents.get("target")), chooser

    def extend(self, run: "RunFolder") -> None:
        """With --resume: the new time of an adaptive capture.

        **Raises:** `InputError` if the capture is not adaptive, or for a rig or a target, which are those of the beginning.
        """
        if not run.state.device:
            return
        if self.rig is not None or self.target is not None:
            raise InputError("capture: --resume keeps the rig and the target; remove --rig and --target")
        if self.adaptive is None:
            return
        if run.state.minutes is None:
            raise InputError(f"{run.folder}: this capture has fixed positions; begin a new one with --adaptive")
        minutes = _checked(self.adaptive)
        if minutes != run.state.minutes:
            run.journal.write("more_minutes", minutes=minutes)
            run.state.minutes, run.state.finished = minutes, False


class RunChooser:
    """The chooser of a run, loaded at its first use, which may be in a thread: its modules need seconds.

    **Arguments:**

    - `plan`: of the run. `rig`: content of the rig file; `source`: its name in messages. `target`: file; None: no target.
    """

    def __init__(self, plan: "CapturePlan", rig: bytes, source: Path, target: Path | None):
        self._plan, self._rig, self._source, self._target = plan, rig, source, target
        self._lock = Lock()
        self._chooser: AdaptiveChooser | None = None

    @property
    def loaded(self) -> "AdaptiveChooser":
        """The chooser.

        **Raises:** `InputError` for a rig or a target that do not suit an adaptive capture.
        """
        with self._lock:
            if self._chooser is None:
                from tumblecal.cli.start import start

                start()
                from tumblecal.chain.rig_file import rig_of
                from tumblecal.design.sequential.adaptive import chooser_of
                from tumblecal.effects import catalogue
                from tumblecal.effects.catalogue import links_and_units

                rig = rig_of(loads(self._rig.decode()), self._source, *links_and_units(catalogue()))
                self._chooser = chooser_of(rig, self._plan, self._target)
            return self._chooser

    def __call__(self, progress: "Progress") -> "Choice | Ending":
        """The next position, or the end of the run."""
        from tumblecal.ground.blas import single_blas_thread

        chooser = self.loaded
        with single_blas_thread():
            return chooser(progress)

    def all_positions(self) -> "CapturePlan":
        """The plan with all positions that can be chosen."""
        return self._plan.continued(self.loaded.positions())


def chooser_of_run(run: "RunFolder") -> RunChooser | None:
    """The chooser of a resumed capture; None for fixed positions.

    **Raises:** `InputError` if a file of the capture is missing or was changed.
    """
    from tumblecal.capture.run.run_folder import RIG_NAME, TARGET_NAME, adaptive_files

    files = adaptive_files(run.folder, run.state)
    if files is None:
        return None
    target = None if files.target is None else run.folder / TARGET_NAME
    return RunChooser(run.plan, files.rig, run.folder / RIG_NAME, target)


def _checked(minutes: float) -> float:
    if not 0 < minutes <= _LONGEST_MIN:
        raise InputError(f"--adaptive {minutes:g}: minutes, above 0, at most {_LONGEST_MIN:g}")
    return minutes

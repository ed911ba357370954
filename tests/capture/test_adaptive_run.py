"""Adaptive captures: a guide with a scripted chooser, and a whole run that is killed, reduced and resumed."""

import re
import time
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from bench import CaptureProcess, Emulator
from test_guide import arrived

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.capture.journal import JOURNAL_NAME, read_journal, recording_s, replayed
from tumblecal.capture.log import read_log
from tumblecal.capture.port.live import Tally
from tumblecal.capture.protocols import protocol
from tumblecal.capture.reduction.reduce import reduce
from tumblecal.capture.run.choice import Choice, Ending, Progress
from tumblecal.capture.run.guide import Guide, Phase
from tumblecal.capture.run.run_folder import AdaptiveFiles, RunFolder, adaptive_files, begin, plan_of_run
from tumblecal.capture.run.session import view_of
from tumblecal.cli.adaptive_options import AdaptiveOptions
from tumblecal.ground.errors import InputError


ONE = """
[port]
url = "imu"
[positions]
listed = [{ alpha_deg = 0, beta_deg = 0 }]
[dwell]
seconds = 8.0
settle_s = 0.0
"""


class Bench:
    """A guide whose head is where it must be; the positions are chosen from a list."""

    def __init__(self, folder: Path, answers: list[Choice | Ending]):
        (folder / "given.toml").write_text(ONE)
        self.folder, self.asked = folder, list[Progress]()
        self.run = begin(folder / "given.toml", folder / "run", adaptive=AdaptiveFiles(10.0, b"rig", b"target"))
        self._answers = answers
        self.guide = self._guide(self.run)
        self._rng = np.random.default_rng(3)

    def _guide(self, run: RunFolder) -> Guide:
        self.stream = SimpleNamespace(
            recording=SimpleNamespace(position=0, sync=lambda: None, log=self.folder / "given.toml"),
            tally=Tally(status=Counter()),
            protocol=protocol("witmotion"),
        )
        return Guide(run, self.stream, 20.0, chooser=self._choose)  # type: ignore[arg-type]

    def _choose(self, progress: Progress) -> Choice | Ending:
        self.asked.append(progress)
        return self._answers[len(progress.done) + len(progress.skipped) - 1]

    def feed(self) -> None:
        guide = self.guide
        assert guide.phase != Phase.FINISHED
        part = arrived(20)
        part.samples.force[:] = guide.plan.expected(guide.position) + 1e-4 * self._rng.normal(size=(20, 3))
        guide.take(part)
        if guide.phase == Phase.CHOOSING:
            time.sleep(0.01)

    def until(self, *phases: Phase) -> None:
        while self.guide.phase not in phases:
            self.feed()

    def close(self) -> list[dict]:
        self.guide.close()
        self.run.journal.close()
        return [record.content() for record in read_log(self.folder / "run" / JOURNAL_NAME)]


def kinds(entries: list[dict]) -> list[str]:
    told = {"chosen", "prompted", "accepted", "skipped", "withdrawn", "finished"}
    return [f"{e['entry']} {e.get('position', '')}".strip() for e in entries if e["entry"] in told]


def test_a_chosen_position_is_in_the_journal_before_its_prompt(tmp_path: Path) -> None:
    """Keys: a skipped position is replaced by another, the previous one is repeated, and the choice made before is kept."""
    listed = [Choice(180.0, 0.0, "for bias_z"), Choice(90.0, 0.0, "for bias_y"), Choice(270.0, 0.0, "for dK_y")]
    bench = Bench(tmp_path, [*listed, Ending("target", "the target is reached")])
    guide = bench.guide
    assert view_of(guide).purpose == "" and view_of(guide).place == "position 1, 0 done"
    bench.until(Phase.RECORDING)
    while not bench.asked:  # prepared while the first position is recorded, which counts as done
        time.sleep(0.01)
    assert [(one.alpha_deg, one.sd_g) for one in bench.asked[0].done] == [(0.0, ())]
    assert bench.asked[0].remaining_s == pytest.approx(592.0, abs=3.0)
    assert bench.asked[0].end_s - bench.asked[0].done[0].start_s == pytest.approx(8.0)
    while guide.position == 0:
        bench.feed()
    assert view_of(guide).purpose == "for bias_z" and view_of(guide).place == "position 2, 1 done"
    assert len(bench.asked) == 1
    guide.press("s")
    while guide.position == 1:
        bench.feed()
    assert bench.asked[1].skipped == ((180.0, 0.0),) and view_of(guide).purpose == "for bias_y"
    bench.until(Phase.RECORDING)
    guide.press("b")
    assert guide.position == 0
    bench.until(Phase.RECORDING)
    while guide.position == 0:
        bench.feed()
    # The choice of before, without another question.
    assert guide.position == 2 and view_of(guide).purpose == "for bias_y"
    while guide.position == 2:
        bench.feed()
    for key in "sr\n":
        guide.press(key)
    bench.until(Phase.FINISHED)
    assert view_of(guide).note == "the target is reached" and bench.run.complete
    entries = bench.close()
    steps = ["prompted 0", "accepted 0", "chosen 1", "prompted 1", "skipped 1", "chosen 2", "prompted 2", "withdrawn 0"]
    steps += ["prompted 0", "accepted 0", "prompted 2", "accepted 2", "chosen 3", "prompted 3", "skipped 3", "finished"]
    assert kinds(entries) == steps
    state = replayed(entries)
    assert state.finished and state.ending == "the target is reached" and sorted(state.accepted) == [0, 2]


def test_a_run_is_known_from_its_journal_after_any_entry(tmp_path: Path) -> None:
    """Ended after each entry, also after one that was damaged: the positions, the time and the next step are known."""
    bench = Bench(tmp_path, [Choice(180.0, 0.0, "for bias_z"), Choice(90.0, 0.0, "for bias_y"), Ending("time", "over")])
    bench.until(Phase.FINISHED)
    entries, folder = bench.close(), tmp_path / "run"
    for count in range(1, len(entries)):
        state = replayed(entries[:count])
        plan = plan_of_run(folder, state)
        steps = [(step.name, step.alpha_deg) for step in plan.steps]
        assert steps == [("1", 0.0), ("2", 180.0), ("3", 90.0)][: len(steps)]
        assert state.accepted.keys() <= set(range(len(steps))) and state.minutes == 10.0
        files = adaptive_files(folder, state)
        assert files == AdaptiveFiles(10.0, b"rig", b"target")
    damaged = replayed([e for e in entries if e["entry"] != "chosen"])
    assert [step.alpha_deg for step in plan_of_run(folder, damaged).steps] == [0.0, 180.0, 90.0]
    with pytest.raises(InputError, match="the journal has no angles of position 2; restore it from a copy"):
        lost = [e for e in entries if not (e["entry"] in ("chosen", "prompted") and e["position"] == 1)]
        plan_of_run(folder, replayed(lost))
    assert plan_of_run(folder, damaged).dwell.seconds == 8.0
    (folder / "capture_target.toml").write_text("other")
    with pytest.raises(InputError, match=r"capture_target.toml: this file was changed after the capture began"):
        adaptive_files(folder, damaged)


def test_the_time_of_a_run_is_that_of_its_sittings() -> None:
    """Interrupted for an hour, killed, and started without a device in between."""
    second = 10**9
    listed = [
        ("session", 0), ("device", 10), ("accepted", 70), ("stopped", 100), ("resumed", 3700), ("stopped", 3705),
        ("resumed", 3800), ("device", 3810), ("recording", 3850), ("resumed", 9000), ("device", 9001), ("prompted", 9011),
    ]  # fmt: skip
    entries = [{"entry": name, "wall_ns": at * second} for name, at in listed]
    assert recording_s(entries) == pytest.approx(90 + 40 + 10)


RIG = """
schema = "tumblecal.rig/1"
[plan]
alpha_deg = [0, 90, 180, 270]
beta_deg = [0, 90]
[noise]
sd = "0.15 mg"
[priors]
dbeta = "3 arcmin"
[head]
beta_deg = [-90, -45, 0, 45, 90]
times = { turn_s = 1, pitch_change_s = 1 }
"""
PLAN = """
[port]
url = "imu"
speed = 20.0
[positions]
beta_deg = [0]
alpha_deg = [0, 180]
[dwell]
seconds = 3.0
settle_s = 0.5
"""


def test_a_killed_run_is_reduced_and_resumed_until_the_target(tmp_path: Path) -> None:
    for name, text in (("plan", PLAN), ("rig", RIG), ("target", 'bias = "0.5 mg"\ndK = "0.5e-3"\n')):
        (tmp_path / f"{name}.toml").write_text(text)
    with Emulator(tmp_path, "[head]\nturn_s = 0.5\n", follow="run"):
        files = ("--rig", "rig.toml", "--target", "target.toml")
        capture = CaptureProcess(
            tmp_path, "plan.toml", "--out", "run", "--adaptive", "9", *files, "--plain", "--no-estimate"
        )
        capture.wait_for(lambda: any("RECORDING position 4" in line for line in capture.seen))
        capture.kill()
        before = read_journal(tmp_path / "run")
        assert sorted(replayed(before).accepted) == [0, 1, 2] and len(reduce(tmp_path / "run").data) == 3
        for name in ("rig", "target"):
            (tmp_path / f"{name}.toml").unlink()
        capture = CaptureProcess(tmp_path, "--resume", "run", "--yes", "--plain")
        assert capture.close() == 0, capture.seen[-20:]
    entries = read_journal(tmp_path / "run")
    state = replayed(entries)
    chosen = [e for e in entries if e["entry"] == "chosen"]
    assert state.finished and state.ending == "the target is reached; 6 of 6 targets reached" == capture.seen[-1]
    # The position of the kill is prompted again with its purpose, and then others are chosen.
    assert f"position 4: {state.chosen[3].purpose}" in capture.seen and chosen[1]["purpose"] == state.chosen[3].purpose
    assert re.search(r"(reduces the uncertainty of|determines) (bias|dK)_", state.chosen[3].purpose)
    assert [e["position"] for e in chosen] == list(range(2, len(state.accepted)))
    data = reduce(tmp_path / "run").data
    assert data.names == tuple(str(k + 1) for k in range(len(chosen) + 2)) and 5 <= len(data) < 16
    alpha, beta = np.radians(data.alpha_deg), np.radians(data.beta_deg)
    ideal = np.stack([-np.sin(beta), np.cos(beta) * np.sin(alpha), np.cos(beta) * np.cos(alpha)], axis=1)
    np.testing.assert_allclose(data.readings, ideal, atol=4e-4)
    assert next(e for e in entries if e["entry"] == "finished")["reason"] == "target"


def test_options_that_do_not_suit_are_one_line(tmp_path: Path) -> None:
    plan, rig = tmp_path / "plan.toml", tmp_path / "rig.toml"
    plan.write_text(PLAN)
    rig.write_text(RIG.partition("[head]")[0])
    for options, words in (
        (AdaptiveOptions(rig=rig), "--rig and --target are for an adaptive capture; add --adaptive MINUTES"),
        (AdaptiveOptions(adaptive=-1.0), "--adaptive -1: minutes, above 0"),
        (
            AdaptiveOptions(adaptive=0.1),
            "the 2 positions of the plan take 0.117 min or more, but --adaptive is 0.1 min",
        ),
        (AdaptiveOptions(adaptive=9.0, rig=rig), f"{rig}: no table [head]; an adaptive capture needs"),
        (AdaptiveOptions(adaptive=9.0, rig=tmp_path / "none.toml"), "none.toml"),
    ):
        with pytest.raises(InputError, match=re.escape(words)) as error:
            options.begun(plan)
        assert len(error.value.faults) == 1
    fixed_plan = CapturePlan.model_validate({"positions": {"beta_deg": [0], "alpha_deg": [0]}})
    fixed = RunFolder(tmp_path, fixed_plan, replayed([]), None)  # type: ignore[arg-type]
    fixed.state.device = {"entry": "device"}
    with pytest.raises(InputError, match="this capture has fixed positions; begin a new one with --adaptive"):
        AdaptiveOptions(adaptive=9.0).extend(fixed)
    with pytest.raises(InputError, match="--resume keeps the rig and the target"):
        AdaptiveOptions(rig=rig).extend(fixed)

"""The guide fed by hand."""

import re
import time
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.capture.decoding.samples import blank
from tumblecal.capture.journal import JOURNAL_NAME, Journal, RunState, replayed
from tumblecal.capture.log import read_log
from tumblecal.capture.port.live import Arrived, Tally
from tumblecal.capture.protocols import protocol
from tumblecal.capture.run.guide import Guide, Phase
from tumblecal.capture.run.identity import Identity
from tumblecal.capture.run.run_folder import RunFolder
from tumblecal.capture.run.session import view_of
from tumblecal.ground.errors import InputError
from tumblecal.recordings.dwells.captured import identity_comments, identity_of


def arrived(count: int, *events: str) -> Arrived:
    samples = blank(count)
    samples.force[:] = [0.0, 0.0, 1.0] + 1e-4 * np.random.default_rng(count).normal(size=(count, 3))
    samples.rate[:] = 0.0
    places = np.zeros(count, np.int64)
    return Arrived(samples, np.zeros(count), places, places, [], [{"event": event} for event in events])


def guide_of(folder: Path, positions: dict, seconds: float, rate_hz: float, name: str, **more) -> Guide:
    """A guide of a device of this protocol, fed by hand."""
    plan = CapturePlan.model_validate({"positions": positions, "dwell": {"seconds": seconds, "settle_s": 0.0}})
    recording = SimpleNamespace(position=0, sync=lambda: None, log=folder / "journal.log")
    stream = SimpleNamespace(recording=recording, tally=Tally(status=Counter()), protocol=protocol(name))
    run = RunFolder(folder, plan, RunState(), Journal(folder))
    return Guide(run, stream, rate_hz, **more)  # type: ignore[arg-type]


def test_the_alarm_of_a_lost_device_outlasts_the_samples_of_the_same_poll(tmp_path: Path) -> None:
    guide = guide_of(tmp_path, {"listed": [{"alpha_deg": 0, "beta_deg": 0}]}, 1000.0, 20.0, "stim300")
    while guide.phase != Phase.RECORDING:
        guide.take(arrived(20))
    guide.take(arrived(20))
    guide.take(arrived(40, "port_lost"))
    for _ in range(2):
        assert view_of(guide).alarm.startswith("the device is disconnected: plug it in again")
        guide.take(arrived(40))
    guide.take(arrived(20, "reopened"))
    assert view_of(guide).alarm == ""
    guide.worker.close()


def test_exchanged_frames_are_no_loss_and_the_screen_says_why_an_attempt_was_rejected(tmp_path: Path) -> None:
    """A STIM300 at 125 Hz: pairs of frames exchanged, then 4 % of the frames dropped, then whole again."""
    guide = guide_of(tmp_path, {"beta_deg": [0], "alpha_deg": [0, 180]}, 4.0, 125.0, "stim300")
    numbers = np.arange(20_000)
    numbers[5::9], numbers[6::9] = numbers[6::9].copy(), numbers[5::9].copy()
    pieces = iter(np.array_split(numbers, 20_000 // 50))

    def go_on(turned: float, dropped: bool) -> None:
        own = next(pieces)
        own = own[own % 25 != 0] if dropped else own
        part = arrived(len(own))
        part.samples.force[:, 2] *= turned
        part.samples.counter[:] = own * 16 % 256
        part.host_s[:] = np.maximum.accumulate(own) / 125.0
        guide.take(part)

    for _ in range(60):
        if 0 not in guide.state.accepted:
            go_on(1.0, dropped=False)
    assert guide.state.accepted[0].summary["lost"] == 0
    while not guide.rejected:
        go_on(-1.0, dropped=True)
    why = r"attempt 1 was rejected: 2\d of 5\d\d samples lost \((3.\d|4.0) %\) in 2\d gaps; limits.lost_fraction allows 1 %"
    shown = set()
    while 1 not in guide.state.accepted:
        assert re.fullmatch(why, view_of(guide).rejected)
        shown.add(guide.phase)
        go_on(-1.0, dropped=False)
    assert {Phase.TURN, Phase.RECORDING} <= shown and view_of(guide).rejected == ""
    guide.worker.close()


@pytest.mark.parametrize(
    ("notice", "other_g"), [({"event": "reopened"}, 0.0), ({"event": "data_again", "after_s": 4.0}, 3e-4)]
)
def test_an_instrument_of_a_kind_without_serial_numbers_is_compared(
    tmp_path: Path, notice: dict, other_g: float
) -> None:
    """Interrupted in the middle of the second position: the first one is measured again before anything is accepted."""
    rng, identity = np.random.default_rng(5), Identity(lambda query: None, (), None, None, confirmed=False)
    positions = {"beta_deg": [0], "alpha_deg": [0, 180]}
    guide = guide_of(tmp_path, positions, 8.0, 20.0, "witmotion", identity=identity)

    def feed(turned: float, error_g: float = 0.0, notices: tuple[dict, ...] = ()) -> None:
        part = arrived(20)
        part.samples.force[:] = [0.0, 0.0, turned + error_g] + 1e-4 * rng.normal(size=(20, 3))
        part.notices.extend(notices)
        guide.take(part)

    while 0 not in guide.state.accepted:
        feed(1.0)
    while guide.phase != Phase.RECORDING:
        feed(-1.0)
    feed(-1.0, notices=(notice,))
    assert guide.position == 0 and guide.doubt.comparing is not None
    assert "identity not confirmed" in view_of(guide).doubt and "measured again" in view_of(guide).doubt
    stopped = ""
    while not stopped and guide.doubt.comparing is not None:
        try:
            feed(1.0, other_g)
        except InputError as error:
            stopped = str(error)
    assert bool(stopped) == bool(other_g) and 1 not in guide.state.accepted
    while not stopped and guide.phase != Phase.FINISHED:
        feed(-1.0)
    guide.worker.close()
    state = replayed([record.content() for record in read_log(tmp_path / JOURNAL_NAME)])
    assert state.to_compare == bool(other_g) and [entry["entry"] for entry in state.doubts] == [
        "identity_not_confirmed",
        "compared",
    ]
    attempts, names = [attempt for _, attempt in sorted(state.accepted.items())], ["1", "2"]
    identity = identity_of(state, attempts, names)
    assert identity["positions_not_confirmed"] == ([] if other_g else ["2"])
    comments = identity_comments(identity)
    assert "serial_number" not in comments and ("identity_not_confirmed" in comments) == (not other_g)


def test_a_plan_of_hundreds_of_positions_does_not_hold_up_the_guide() -> None:
    """What is asked at every poll: where a position is, and how near is near enough (half the smallest separation)."""
    own = {"beta_deg": [0, 30, 60, 90], "alpha_deg": [2.0 * k for k in range(180)]}
    plan = CapturePlan.model_validate({"positions": own})
    begun = time.process_time()
    for _ in range(20):
        assert plan.tolerance_deg == pytest.approx(0.5, rel=0.01)  # at beta 60 two degrees of alpha are one apart
        plan.expected(700)
    assert time.process_time() - begun < 1.0

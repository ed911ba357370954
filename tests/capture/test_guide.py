"""The guide fed by hand."""

import io
import re

import numpy as np
import pytest
from hand_fed import HandFed
from rich.console import Console

from tumblecal.capture.run.guide import Phase
from tumblecal.capture.run.screen import line_of, rendered
from tumblecal.recordings.dwells.captured import identity_of


TWO = {"beta_deg": [0], "alpha_deg": [0, 180]}


def test_the_alarm_of_a_lost_device_outlasts_the_samples_of_the_same_poll(tmp_path):
    fed = HandFed(
        tmp_path, "stim300", positions={"listed": [{"alpha_deg": 0, "beta_deg": 0}]}, dwell={"seconds": 1000.0}
    )
    fed.feed(40, {"event": "port_lost"})
    for _ in range(2):
        assert fed.guide.alarm.startswith(
            "the device is disconnected: plug it in again"
        ) and fed.guide.alarm in line_of(fed.guide)
        fed.feed(40)
    fed.feed(20, {"event": "reopened"})
    assert fed.guide.alarm == ""


def test_exchanged_frames_are_no_loss_and_the_screen_says_why_an_attempt_was_rejected(tmp_path):
    """A STIM300 at 125 Hz: pairs of frames exchanged, then 4 % of the frames dropped, then whole again."""
    fed = HandFed(tmp_path, "stim300", 125.0, positions=TWO)
    numbers = np.arange(20_000)
    numbers[5::9], numbers[6::9] = numbers[6::9].copy(), numbers[5::9].copy()
    pieces = iter(np.array_split(numbers, 20_000 // 50))

    def go_on(dropped: bool) -> None:
        piece = next(pieces)
        piece = piece[piece % 25 != 0] if dropped else piece
        fed.feed(len(piece), counter=piece * 16 % 256, host_s=np.maximum.accumulate(piece) / 125.0)

    while 0 not in fed.state.accepted:
        go_on(dropped=False)
    assert fed.state.accepted[0].summary["lost"] == 0
    fed.turned = -1.0
    while not fed.guide.rejected:
        go_on(dropped=True)
    why = (
        r"attempt 1 was rejected: 2\d of 5\d\d samples lost \((3.\d|4.0) %\), 2\d gaps; limits.lost_fraction allows 1 %"
    )
    shown = set()
    while 1 not in fed.state.accepted:
        assert re.fullmatch(why, fed.guide.rejected) and fed.guide.rejected.partition(": ")[2] in line_of(fed.guide)
        shown.add(fed.guide.phase)
        go_on(dropped=False)
    assert {Phase.TURN, Phase.RECORDING} <= shown and fed.guide.rejected == ""


@pytest.mark.parametrize("notice", [{"event": "reopened"}, {"event": "data_again", "after_s": 4.0}])
def test_an_instrument_of_a_kind_without_serial_numbers_is_confirmed_by_the_operator(tmp_path, notice):
    """Interrupted in the middle of the second position: its attempt is rejected, and nothing is recorded until Enter."""
    fed = HandFed(tmp_path, positions=TWO)
    while 0 not in fed.state.accepted:
        fed.feed()
    fed.turned = -1.0
    fed.until(Phase.RECORDING)
    fed.feed(20, notice)
    for _ in range(20):
        fed.feed()
    assert fed.guide.phase == Phase.SETTLING and fed.entries("rejected")[0]["reason"] == "identity not confirmed"
    assert "identity not confirmed" in line_of(fed.guide) and "press Enter if it is the same one" in line_of(fed.guide)
    fed.press("\n")
    fed.until(Phase.FINISHED)
    assert [entry["entry"] for entry in fed.state.doubts] == ["identity_not_confirmed", "identity_trusted"]
    assert not fed.state.to_confirm
    attempts, names = [attempt for _, attempt in sorted(fed.state.accepted.items())], ["1", "2"]
    identity, comments = identity_of(fed.state, attempts, names)
    assert identity["positions_not_confirmed"] == ["2"]
    assert "serial_number" not in comments and "identity_not_confirmed" in comments


def test_a_knock_sounds_and_a_turn_during_the_dwell_repeats_it(tmp_path):
    fed = HandFed(tmp_path, positions=TWO, dwell={"seconds": 30.0, "settle_s": 2.0})
    fed.until(Phase.SETTLING)
    fed.turned = 0.99
    fed.feed()
    assert fed.guide.phase == Phase.TURN  # the time at rest begins again
    fed.turned = 1.0
    fed.until(Phase.RECORDING)
    for _ in range(12):
        fed.feed()
    fed.turned = 1.002
    fed.feed()
    assert fed.guide.alarm.startswith("knock: ") and fed.entries("warned")[0]["text"].startswith("knock: ")
    fed.turned = 1.05
    fed.feed()
    assert fed.guide.rejected == "attempt 1 was rejected: the head moved while recording"
    assert fed.entries("rejected")[0]["attempt"] == 1 and not fed.state.accepted


@pytest.mark.parametrize(("height", "lost"), [(40, ()), (24, ()), (9, ("expected mg",))])
def test_the_most_important_parts_are_on_a_screen_of_any_height(tmp_path, height, lost):
    fed = HandFed(tmp_path, positions=TWO, dwell={"seconds": 30.0})
    fed.until(Phase.RECORDING)
    for _ in range(15):
        fed.feed()
    console = Console(width=80, height=height, file=io.StringIO(), color_system=None)
    lines = console.render_lines(rendered(fed.guide, console))[:height]
    shown = " ".join("".join(segment.text for segment in line) for line in lines)
    words = (
        "RECORDING position 1, 0 of 2 done",
        "300 of 600 good samples",
        "frames ",
        "lost >=",
        "q: interrupt",
        "expected mg",
    )
    assert [word for word in words if word not in shown] == list(lost), shown

"""Plans of next positions take over how the first positions were captured."""

from dataclasses import replace

import pytest

from tumblecal.capture.capture_plan import CaptureSetup, read_plan
from tumblecal.data import write_positions
from tumblecal.plan.next.next_capture import LABELS
from tumblecal.plan.next.proposals import SIDES


FIRST = """[session]
operator = 'A. "N"'
head = "head 4711"
mount = "B"
[port]
url = "socket://imu:7000"
protocol = "text"
columns = "time_s,ax,ay,az"
unit = "mg"
speed = 20
[positions]
alpha_deg = [0, 90]
beta_deg = [0, 45]
mount_rotation_deg = [0, 0, 90]
[dwell]
seconds = 10
settle_s = 3.5
[limits]
still_mg = 5
[soak]
stable_min = 20
[chamber]
url = "/dev/ttyUSB1"
set = "TEMP,S{:.1f}"
"""


def plans_after(tumblecal, folder, table1, setup, *options):
    """The plans that a diagnosis of Table 1 with this comment writes, by their files."""
    comments = {"serial_number": "N1", "protocol": "text", "capture_setup": setup}
    write_positions(folder / "positions.csv", replace(table1, comments=comments))
    outcome = tumblecal("diagnose", folder / "positions.csv", "--no-figures", "--out", folder / "out", *options)
    assert outcome.code == 0, outcome.lines
    return {path: read_plan(path) for path in (folder / "out").glob("next_positions*.toml")}


@pytest.mark.parametrize("mount", ["none", "turns"])
def test_a_plan_takes_over_how_the_first_was_captured(tumblecal, tmp_path, table1, mount):
    (tmp_path / "first.toml").write_text(FIRST)
    first = read_plan(tmp_path / "first.toml")
    plans = plans_after(tumblecal, tmp_path, table1, CaptureSetup.of(first).text, "--allow-mount", mount)
    assert plans and ("turned" in "".join(path.name for path in plans)) == (mount == "turns")
    for path, plan in plans.items():
        assert (plan.dwell, plan.limits) == (first.dwell, first.limits)
        assert (plan.soak, plan.chamber) == (first.soak, first.chamber) and plan.chamber.url == "/dev/ttyUSB1"
        assert plan.port == first.port.model_copy(update={"serial_number": "N1"})
        assert (plan.session.operator, plan.session.head) == ('A. "N"', "head 4711")
        assert plan.session.title == f"next positions for {tmp_path / 'positions.csv'}"
        assert "--port" not in path.read_text()
        turned = next((side for side, label in LABELS.items() if label == plan.session.mount), None)
        assert plan.positions.mount_rotation_deg == (list(SIDES[turned]) if turned else [0, 0, 90])

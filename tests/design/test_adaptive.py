"""The choice of positions of an adaptive capture, against generalised least squares in numpy."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.capture.run.choice import Choice, DonePosition, Ending, Progress
from tumblecal.design.sequential.adaptive import AdaptiveChooser, chooser_of
from tumblecal.design.sequential.target import read_target
from tumblecal.estimation.visits import visit_precision
from tumblecal.ground.errors import InputError


NAMES = [f"{kind}_{axis}" for kind in ("dK", "bias") for axis in "xyz"] + ["gamma_21", "gamma_31", "gamma_32"]
UNITS = {"mg": 1e-3, "mrad": 1e-3, "e-3": 1e-3}
COMMON, AGAIN = np.radians(3 / 60), np.radians(20 / 3600)


def plan_of(*angles: tuple[float, float], mount: str = "A") -> CapturePlan:
    listed = [{"alpha_deg": alpha, "beta_deg": beta} for alpha, beta in angles]
    dwell = {"seconds": 60.0, "settle_s": 10.0}
    return CapturePlan.model_validate({"session": {"mount": mount}, "positions": {"listed": listed}, "dwell": dwell})


def sd_of(angles: list[tuple[float, float]], noise_g: float) -> np.ndarray:
    """Standard uncertainties (1, g, rad) of `NAMES`: an unknown mount, pitch errors of each setting and of each visit."""
    alpha, beta = np.radians(angles).T
    force = np.stack([-np.sin(beta), np.cos(beta) * np.sin(alpha), np.cos(beta) * np.cos(alpha)], axis=1)
    pitch = np.stack([-np.cos(beta), -np.sin(beta) * np.sin(alpha), -np.sin(beta) * np.cos(alpha)], axis=1)
    columns = np.zeros((len(force), 3, 12))
    for axis in range(3):
        columns[:, axis, axis], columns[:, axis, 3 + axis] = force[:, axis], 1.0
        columns[:, :, 9 + axis] = np.cross(force, np.eye(3)[axis])
    columns[:, 1, 6] = columns[:, 2, 7] = force[:, 0]
    columns[:, 2, 8] = force[:, 1]
    visit = np.concatenate([[0], np.cumsum(np.diff(beta) != 0)])
    same = COMMON**2 * (beta[:, None] == beta) + AGAIN**2 * (visit[:, None] == visit)
    noise = np.kron(same, np.ones((3, 3))) * np.outer(pitch, pitch) + noise_g**2 * np.eye(pitch.size)
    flat = columns.reshape(-1, 12)
    information = flat.T @ np.linalg.solve(noise, flat)
    values, vectors = np.linalg.eigh(information)
    covariance = vectors / np.maximum(values, 1e-3) @ vectors.T
    return np.sqrt(np.diag(covariance))[:9]


@pytest.fixture(scope="module")
def plain(head) -> AdaptiveChooser:
    """Without a target."""
    return chooser_of(head, plan_of((0.0, 0.0)))


def aimed(plain: AdaptiveChooser, folder: Path, text: str) -> AdaptiveChooser:
    path = folder / "target.toml"
    path.write_text(text)
    return replace(plain, target=read_target(path, plain.responses.names))


def run(
    chooser: AdaptiveChooser, noise_g: float, minutes: float
) -> tuple[list[tuple[float, float]], list[str], Ending]:
    """Positions, purposes and end of a run in which everything takes its stated time."""
    done, purposes, now = [DonePosition(0.0, 0.0, 0.0, (noise_g,) * 3)], [], 60.0
    while True:
        decided = chooser(Progress(tuple(done), now, 60 * minutes - now))
        if isinstance(decided, Ending):
            return [(one.alpha_deg, one.beta_deg) for one in done], purposes, decided
        assert isinstance(decided, Choice)
        done.append(DonePosition(decided.alpha_deg, decided.beta_deg, now + 60.0, (noise_g,) * 3))
        purposes.append(decided.purpose)
        now += 120.0


@pytest.mark.parametrize("noise_g", [1.5e-4, 2.5e-4])
def test_a_run_ends_with_the_first_position_that_reaches_the_target(
    plain: AdaptiveChooser, tmp_path: Path, noise_g: float
) -> None:
    """Dwells that are noisier than the rig states need more positions; a purpose is the change that least squares gives."""
    text = 'bias = "0.3 mg"\ndK = "400 ppm"\ngamma = "0.3 mrad"\nbias_x = "0.35 mg"\n'
    target = np.array([4e-4] * 3 + [3.5e-4, 3e-4, 3e-4] + [3e-4] * 3)
    chooser = aimed(plain, tmp_path, text)
    angles, purposes, ending = run(chooser, noise_g, 1000.0)
    assert ending.reason == "target" and ending.text == "the target is reached; 9 of 9 targets reached"
    assert np.all(sd_of(angles, noise_g) <= target) and np.any(sd_of(angles[:-1], noise_g) > target)
    assert len(angles) < (12 if noise_g < 2e-4 else 25)
    stated = 0
    for count, purpose in enumerate(purposes, 2):
        found = re.fullmatch(
            r"reduces the uncertainty of (\w+) from ([\d.]+)\S* ?\w* to ([\d.]+)\S* ?\w* \(target .*\)", purpose
        )
        if found:
            before, after = (1e3 * sd_of(angles[:k], noise_g)[NAMES.index(found[1])] for k in (count - 1, count))
            assert [before, after] == pytest.approx([float(found[2]), float(found[3])], rel=0.06), purpose
            stated += 1
    assert stated >= 1


def test_without_a_target_the_time_is_used(plain: AdaptiveChooser) -> None:
    chooser = plain
    angles, _, ending = run(chooser, 0.0, 31.0)
    assert ending.reason == "time" and ending.text.startswith("the time is over; largest uncertainty: ")
    assert 14 <= len(angles) <= 16
    sd = sd_of(angles, 1.5e-4)
    stated = re.search(r"uncertainty: (\w+) ([\d.]+)", ending.text)
    assert stated is not None
    name, words = stated.groups()
    assert (
        float(words) == pytest.approx(1e3 * sd[NAMES.index(name)], rel=0.06) == pytest.approx(1e3 * sd.max(), rel=0.06)
    )
    assert re.search(r'Next: \d+ positions in mounting B, a capture of its own with session.mount = "B"', ending.text)
    # Skipped positions, and a repeat of the last one, are not chosen.
    progress = Progress((DonePosition(0.0, 0.0, 0.0, ()),), 60.0, 3600.0)
    for _ in range(3):
        chosen = chooser(progress)
        assert isinstance(chosen, Choice) and (chosen.alpha_deg, chosen.beta_deg) not in (*progress.skipped, (0.0, 0.0))
        progress = replace(progress, skipped=(*progress.skipped, (chosen.alpha_deg, chosen.beta_deg)))
    every = tuple((alpha, beta) for alpha in np.arange(0, 360, 45.0) for beta in (-90.0, -45.0, 0.0, 45.0, 90.0))
    assert chooser(replace(progress, skipped=every)).reason == "no position"  # type: ignore[union-attr]


def test_a_target_out_of_reach_is_reported_with_the_parameters_in_reach(plain: AdaptiveChooser, tmp_path: Path) -> None:
    words = aimed(plain, tmp_path, 'bias_x = "0.01 mg"\nbias_z = "1 mg"\n').unreachable(30.0)
    assert re.fullmatch(
        r"30 min do not suffice for 1 of 2 parameters: the best plan found gives bias_x 0\.\d+ mg \(target 0.01 mg\); "
        "the other 1 can be reached",
        words,
    )
    assert aimed(plain, tmp_path, 'bias = "5 mg"\n').unreachable(60.0) == ""


def test_rigs_plans_and_targets_that_do_not_suit_are_one_line(head, plain: AdaptiveChooser, tmp_path: Path) -> None:
    path = tmp_path / "target.toml"
    for text, words in (
        ('bais_x = "1 mg"\n', "bais_x: no such parameter of the sensor; a target can be set for dK_x, dK_y"),
        ('dbeta = "1 mrad"\n', "dbeta: no such parameter of the sensor"),
        ('bias_x = "1 mrad"\n', "bias_x: 'mrad' cannot be converted to 'g'"),
        ('bias_x = "0 mg"\n', "bias_x: '0 mg' is not a size"),
        ("bias_x = 0.1\n", 'bias_x: write an uncertainty with its unit, such as "0.05 mg"'),
        ("", 'no parameter; write for example bias_x = "0.05 mg"'),
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=re.escape(words)) as error:
            read_target(path, plain.responses.names)
        assert len(error.value.faults) == 1
    plan = plan_of((0.0, 0.0))
    with pytest.raises(InputError, match=r"rig.toml: no table \[head\]; an adaptive capture needs"):
        chooser_of(replace(head, ability=None), plan)
    with pytest.raises(
        InputError, match=r"the plan is for mounting 1, but the head of rig.toml has A, B; correct session.mount"
    ):
        chooser_of(head, plan_of((0.0, 0.0), mount="1"))
    warm = replace(head, ability=replace(head.ability, temperatures_degc=(20.0, 40.0)))
    with pytest.raises(
        InputError, match=r"head.temperatures_degc requests temperatures, but an adaptive capture is at one"
    ):
        chooser_of(warm, plan)


def test_settings_that_repeat_exactly_have_one_error() -> None:
    """A repeatability of 0: two visits of one setting are one unknown of the stated size."""
    precision = visit_precision(1.7, 0.0, np.array([0, 1, 0]))
    seen = np.array([[1.0, 0, 0], [0, 0, 1.0]])
    covariance = np.linalg.inv(precision + seen.T @ seen * 2.0)
    assert np.sqrt(covariance[[0, 2], [0, 2]]) == pytest.approx((1 / 1.7**2 + 4.0) ** -0.5, rel=1e-4)

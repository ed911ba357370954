"""Captures over temperature: criterion, order, chamber, and the guide's waits, fed by hand."""

import contextlib
import math
import os
import select
import threading
import tty
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hand_fed import HandFed

from tumblecal.capture import chamber as soak
from tumblecal.capture.capture_plan import CapturePlan, ChamberTable, SoakTable
from tumblecal.capture.chamber import Chamber, Stability
from tumblecal.capture.journal import RunState
from tumblecal.capture.run.guide import Phase
from tumblecal.capture.run.run_folder import with_temperatures
from tumblecal.capture.run.screen import header_of, line_of, note_of
from tumblecal.ground.errors import InputError


CRITERION = SoakTable(tolerance_degc=1.0, rate_degc_per_min=0.1, stable_min=5.0, timeout_min=60.0)
MINUTES = np.arange(0, 60, 1 / 60)


def stable_times(values: np.ndarray) -> np.ndarray:
    """The times at which a temperature is stable, min."""
    stability, stable = Stability(CRITERION, 40.0), []
    for t, value in zip(MINUTES, values, strict=False):
        stability.take(t, value)
        stable += [t] if stability.stable_min >= CRITERION.stable_min else []
    return np.array(stable)


def test_a_lagging_die_is_stable_when_rate_and_distance_have_been_small_for_long_enough() -> None:
    """T = 40 - 20 exp(-t/tau): near from tau ln 20 on, slow from about tau ln(20/(tau 0.1)) + 0.5 min on (line over 1 min)."""
    tau = 9.0
    near, slow = tau * math.log(20), tau * math.log(20 / (tau * 0.1)) + 0.5
    assert stable_times(40 - 20 * np.exp(-MINUTES / tau))[0] == pytest.approx(max(near, slow) + 5.0, abs=0.1)


@pytest.mark.parametrize(
    ("degc", "stable"),
    [
        (lambda t: 40.5 + 0.02 * np.sin(t), True),
        (lambda t: 40.0 + 0.15 * t - 4.5, False),  # a ramp through the target
        (lambda t: 40 + 0.5 * np.sin(2 * np.pi * t / 5), False),  # a whole period in the time of the criterion
        (lambda t: np.round(40 + 0.2 * np.random.default_rng(1).normal(size=len(t))), True),  # steps of 1 degC, and noise
    ],
)  # fmt: skip
def test_ramps_oscillations_and_other_temperatures_are_not_stable(degc: Callable, stable: bool) -> None:
    blocks = np.convolve(degc(MINUTES), np.ones(30) / 30, "valid")
    assert bool(len(stable_times(blocks))) == stable


def test_the_positions_of_a_plan_over_temperature_and_the_options_that_override_it() -> None:
    angles = {"beta_deg": [0, 90], "alpha_deg": [0, 180]}
    plan = CapturePlan.model_validate({"positions": angles | {"temperature_degc": [25, 60, 25]}})
    assert plan.soaks == [0] * 4 + [1] * 4 + [2] * 4 and [s.name for s in plan.steps] == [str(k) for k in range(1, 13)]
    assert [(s.alpha_deg, s.beta_deg) for s in plan.steps[4:8]] == [(0, 0), (180, 0), (0, 90), (180, 90)]
    listed = {"listed": [{"alpha_deg": a, "beta_deg": 0, "name": f"p{a}"} for a in (0, 90)], "temperature_degc": [0, 9]}
    named = CapturePlan.model_validate({"positions": listed})
    assert [s.name for s in named.steps] == ["p0", "p90", "p0 (2)", "p90 (2)"]
    listed["listed"][0]["temperature_degc"] = 30
    with pytest.raises(ValueError, match="temperature_degc"):
        CapturePlan.model_validate({"positions": listed})
    with pytest.raises(InputError, match="requests no temperature"):
        with_temperatures(CapturePlan.model_validate({"positions": angles}), soak_rate=0.1)
    applied = with_temperatures(plan, "oven", soak_minutes=3.0)
    assert applied.chamber.url == "oven" and applied.soak.stable_min == 3.0 and applied.soaks == plan.soaks


def test_a_soak_is_finished_before_the_next_one_begins() -> None:
    soaks, state = [0, 0, 0, 1, 1, 2], RunState()
    order, position = [], -1
    state.skipped |= {1}
    state.postponed |= {1}
    while (following := state.open_after(position, soaks)) is not None:
        order.append(following)
        state.accepted[following], position = None, following  # type: ignore[assignment]
    # A skipped position comes at the end of its soak, a postponed soak at the end.
    assert order == [0, 2, 1, 5, 3, 4]


def asked_at_once(asked: Callable, *arguments: object) -> Future:
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(asked, *arguments)


class FakeChamber:
    """A chamber whose set points are listed, and whose answer the test states."""

    name = "fake"

    def __init__(self, answer: float | None = None):
        self.set: list[float] = []
        self.answer: float | str | None = answer

    def set_temperature(self, degc: float) -> None:
        self.set.append(degc)

    def temperature(self) -> float | None:
        if isinstance(self.answer, str):
            raise InputError(self.answer)
        return self.answer

    def close(self) -> None:
        self.set.append(math.inf)


def over_temperature(folder: Path, monkeypatch: pytest.MonkeyPatch, chamber: FakeChamber, **more: float) -> HandFed:
    """Two positions at two temperatures; the clock is that of the fed samples, and the chamber is asked every second."""
    criterion = {"stable_min": 2.0, "rate_degc_per_min": 0.2, "tolerance_degc": 1.0, "timeout_min": 30.0}
    clock, beginning = [], 1000.0
    monkeypatch.setattr(soak, "time", SimpleNamespace(monotonic=lambda: clock[0].now_s if clock else beginning))
    monkeypatch.setattr(soak, "_QUERY_S", 1.0)
    thread = SimpleNamespace(submit=asked_at_once, shutdown=lambda: None)
    monkeypatch.setattr(soak, "ThreadPoolExecutor", lambda number: thread)
    positions = {"beta_deg": [0], "alpha_deg": [0, 180], "temperature_degc": [25, 40]}
    fed = HandFed(
        folder, chamber=chamber, positions=positions, soak=criterion | more, chamber_table={"finish_degc": 20.0}
    )
    clock.append(fed)
    return fed


def test_a_soak_is_waited_for_once_and_again_only_when_the_temperature_left(tmp_path, monkeypatch) -> None:
    chamber = FakeChamber(25.0)
    fed = over_temperature(tmp_path, monkeypatch, chamber)
    guide = fed.guide
    assert guide.phase == Phase.SOAK and "set the chamber to 25 degC" in line_of(guide) and chamber.set == [25]
    for _ in range(60):
        fed.feed(degc=25.3)
    assert "chamber to 25 degC (by fake): sensor 25.30 degC" in note_of(guide)
    fed.until(Phase.RECORDING, 25.3)
    fed.until(Phase.TURN, 25.3)
    # The second position of the soak: no wait.
    fed.turned = -1.0
    fed.until(Phase.RECORDING, 25.4)
    # The temperature leaves during the dwell, which is finished; another position of the soak would wait.
    fed.feed(degc=26.6)
    assert "left 25 +- 1 degC" in guide.alarm
    fed.until(Phase.SOAK, 25.4)
    assert (
        header_of(guide) == "SOAK soak 2 of 2, 2 of 4 done: set the chamber to 40 degC"
        and fed.entries("soak")[-1]["requested_degc"] == 40
    )
    fed.press("b")
    assert len(fed.state.accepted) == 2  # the previous position belongs to a soak that is over
    # Steady, but not at 40: reported, and accepted by Enter; this is then the temperature of the soak.
    chamber.answer = 40.0
    for _ in range(240):
        fed.feed(degc=43.2)
    assert "steady at 43.2 degC, +3.2 degC from 40" in guide.alarm and "soak.offset_degc = 3.2" in guide.alarm
    fed.press("\n")
    fed.turned = 1.0
    fed.until(Phase.RECORDING, 43.3)
    fed.until(Phase.TURN, 43.3)
    fed.feed(degc=45.0)
    fed.turned = -1.0
    fed.until(Phase.SOAK, 45.0)
    fed.until(Phase.FINISHED, 40.2)
    fed.soak.close(finished=True)
    kinds = [entry["entry"] for entry in fed.entries("soak", "soaked", "accepted", "temperature_left")]
    accepted, soaked = fed.entries("accepted"), fed.entries("soaked")
    assert kinds == ["soak", "soaked", "accepted", "temperature_left", "accepted", "soak", "soaked", "accepted",
                     "temperature_left", "soak", "soaked", "accepted"]  # fmt: skip
    assert accepted[2]["summary"]["temperature_degc"] == pytest.approx(43.3)
    assert accepted[2]["summary"]["requested_degc"] == 40 and accepted[2]["summary"]["chamber_degc"] == 40
    assert soaked[1]["accepted_by"] == "operator" and fed.entries("soak")[0]["criterion"]["stable_min"] == 2
    assert chamber.set == [25, 40, 40, 20, math.inf]


@pytest.mark.parametrize(
    ("degc", "chamber", "words"),
    [
        (lambda t: 77.0 + 1e-3 * (t % 2), 25.0, "steady at 77.0 degC, +52.0 degC from 25: check the set point and the"),
        (lambda t: 15.0 - 0.3 * t / 60, None, "sensor 13.80 degC, -0.300 degC/min"),
        (lambda t: 25 + 0.9 * np.sin(t / 20), None, "stable for 0."),
        (lambda t: np.nan, None, "neither instrument nor chamber state a temperature; press Enter when it is stable"),
    ],
)  # fmt: skip
def test_a_temperature_that_is_never_stable_ends_the_run_with_its_reason(
    tmp_path, monkeypatch, degc: Callable[[float], float], chamber: float | None, words: str
) -> None:
    fed = over_temperature(tmp_path, monkeypatch, FakeChamber(chamber), timeout_min=4.0)
    with pytest.raises(InputError) as error:
        for second in range(400):
            fed.feed(degc=degc(second))
    text = str(error.value)
    assert (
        words in text and "soak at 25 degC: not stable after 4 min" in text and "--resume" in text and "\n" not in text
    )


@contextlib.contextmanager
def scripted(path: Path, answers: Callable[[str], bytes]) -> Iterator[tuple[list[str], int]]:
    """A chamber behind a pseudo-terminal: the commands it got, and its end of the line."""
    master, slave = os.openpty()
    tty.setraw(slave)
    path.symlink_to(os.ttyname(slave))
    heard, ended = list[str](), threading.Event()

    def serve() -> None:
        rest = b""
        while not ended.is_set():
            if not select.select([master], [], [], 0.02)[0]:
                continue
            try:
                rest += os.read(master, 100)
            except OSError:  # nobody has the line open
                continue
            *lines, rest = rest.replace(b"\r", b"\n").split(b"\n")
            for line in filter(None, lines):
                heard.append(line.decode())
                os.write(master, answers(line.decode()))

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    try:
        yield heard, master
    finally:
        ended.set()
        thread.join()
        for descriptor in (slave, master):
            os.close(descriptor)


def test_dialects_of_chambers_on_a_serial_line(tmp_path: Path) -> None:
    """Default (SCPI); ESPEC: acknowledged, four numbers; Watlow F4T; one that echoes; one without line ends."""
    sets: dict[str, float] = {}

    def answers(command: str) -> bytes:
        match command.replace(",S", " ").split():
            case ["SOUR:TEMP:SPO" | "TEMP" | ":SOURCE:CLOOP1:SPOINT" | "SETP" as word, number]:
                sets[word] = float(number)
                return f"OK:{command}\r\n".encode() if word == "TEMP" else b""
            case ["MEAS:TEMP?"]:
                return b"+2.34500E+01\n"
            case ["TEMP?"]:
                return f"-40.1,{sets['TEMP']},150.0,-70.0\r\n".encode()
            case [":SOURCE:CLOOP1:PVALUE?"]:
                return b":SOURCE:CLOOP1:PVALUE?\r\n24.9\r\n"
            case ["T?"]:
                return b"25.0 C"
        return b""

    quick = {"url": str(tmp_path / "oven"), "timeout_s": 0.3}
    espec = {"set": "TEMP,S{:.1f}", "query": "TEMP?", "set_query": "TEMP?", "set_query_field": 2, "terminator": "CRLF"}
    watlow = {"set": ":SOURCE:CLOOP1:SPOINT {}", "query": ":SOURCE:CLOOP1:PVALUE?", "start": ["*IDN?"]}
    with scripted(tmp_path / "oven", answers) as (heard, _):
        for table, read in (({}, 23.45), (espec, -40.1), (watlow, 24.9), ({"set": "SETP {}", "query": "T?"}, 25.0)):
            chamber = Chamber(ChamberTable.model_validate(quick | table))
            chamber.set_temperature(40)
            assert chamber.temperature() == read
            chamber.close()
    assert sets == {"SOUR:TEMP:SPO": 40.0, "TEMP": 40.0, ":SOURCE:CLOOP1:SPOINT": 40.0, "SETP": 40.0}
    assert heard[:2] == ["SOUR:TEMP:SPO 40.0", "MEAS:TEMP?"] and heard[2] == "TEMP,S40.0" and "*IDN?" in heard
    for wrong in ("SOUR:TEMP:SPO", "SOUR {temperature}", "SOUR {"):
        with pytest.raises(ValueError, match="where the temperature is inserted"):
            ChamberTable(set=wrong)


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (
            b"",
            "'MEAS:TEMP?', asked 3 times, nothing came: no temperature in degC at field 1; check cable, baud rate (9600)",
        ),
        (b"NA: CMD ERR-1\r\n", "'NA: CMD ERR-1' came: no temperature in degC at field 1"),
        (b"104.0 F\r\n", "'104.0 F' came: no temperature in degC at field 1"),
    ],
)
def test_a_chamber_that_does_not_answer_or_answers_rubbish_is_one_line(
    tmp_path: Path, answer: bytes, words: str
) -> None:
    with scripted(tmp_path / "oven", lambda command: answer) as (heard, _):
        chamber = Chamber(ChamberTable(url=str(tmp_path / "oven"), timeout_s=0.05))
        with pytest.raises(InputError) as error:
            chamber.temperature()
        assert words in str(error.value) and "\n" not in str(error.value) and heard == ["MEAS:TEMP?"] * 3
        chamber.close()

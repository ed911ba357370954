"""The operator's screen, in letters that are readable from three metres, its bell and its keys."""

import os
import select
import sys
import termios
import tty
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from datetime import timedelta
from typing import TypeAlias

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.capture.journal import RunState
from tumblecal.capture.run.guide import Guide, Phase
from tumblecal.ground.axes import AXES


# Lines about the parameters so far, at once: the loop of a capture waits for them.
Estimate: TypeAlias = Callable[[RunState], list[str]]

_KEYS = "Enter: accept as it is   r: repeat this position   b: repeat the previous one   s: skip   q: interrupt"
# A lower terminal shows small letters; what is below its last line is not shown.
_LOWEST = 24
# The five rows of each letter.
_GLYPHS = {
    "0": "███/█ █/█ █/█ █/███",
    "1": " █ /██ / █ / █ /███",
    "2": "███/  █/███/█  /███",
    "3": "███/  █/███/  █/███",
    "4": "█ █/█ █/███/  █/  █",
    "5": "███/█  /███/  █/███",
    "6": "███/█  /███/█ █/███",
    "7": "███/  █/  █/  █/  █",
    "8": "███/█ █/███/█ █/███",
    "9": "███/█ █/███/  █/███",
    "-": "   /   /███/   /   ",
    ".": " / / / /█",
    "°": "██/██/  /  /  ",
    "C": "███/█  /█  /█  /███",
    " ": "  /  /  /  /  ",
    "α": "     /██ █ /█ ██ /█ ██ /██ █ ",
    "β": "███ /█ █ /██▄ /█  █/█▀▀ ",
}


class Screen:
    """Shows the guide, redrawn in place on a terminal, otherwise one line for each change; and reads keys, from a terminal each
    one separately, from a pipe each character."""

    def __init__(self, plain: bool = False, estimate: Estimate | None = None):
        self._console, self._shown, self._estimate = Console(highlight=False), list[str](), estimate
        drawn = not plain and self._console.is_terminal
        self._live = Live(console=self._console, screen=True, auto_refresh=False) if drawn else None
        self._end, self._keyboard = ExitStack(), [sys.stdin]

    def __enter__(self) -> "Screen":
        with suppress(termios.error):  # no terminal
            modes = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
            self._end.callback(termios.tcsetattr, sys.stdin, termios.TCSADRAIN, modes)
        if self._live is not None:
            self._end.enter_context(self._live)
        return self

    def __exit__(self, *_: object) -> None:
        with self._terminal_may_be_gone(), suppress(termios.error):
            self._end.close()

    def show(self, guide: Guide) -> None:
        """Show the present state."""
        estimate = self._estimate(guide.state) if self._estimate else []
        lines = [*estimate, line_of(guide)]
        with self._terminal_may_be_gone():
            if self._live is not None:
                self._live.update(Group(rendered(guide, self._console), *map(Text, estimate)), refresh=True)
            for line in lines if self._live is None else ():
                if line not in self._shown:
                    print(line, flush=True)
        self._shown = lines

    def bell(self) -> None:
        """Ring."""
        with self._terminal_may_be_gone():
            print(end="\a", flush=True)

    def pressed(self) -> str:
        """The keys pressed since the last call, in order."""
        data = b""
        if not select.select(self._keyboard, [], [], 0)[0]:
            return ""
        with suppress(OSError):  # the terminal is closed
            data = os.read(sys.stdin.fileno(), 1024)
        if not data:
            self._keyboard = []
        return data.decode(errors="replace")

    @contextmanager
    def _terminal_may_be_gone(self) -> Iterator[None]:
        """A closed terminal must not end a recording: later output is discarded."""
        try:
            yield
        except OSError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, sys.stdout.fileno())
            os.close(nowhere)


def line_of(guide: Guide) -> str:
    """The state in one line."""
    part, counted = _progress(guide)
    words = [header_of(guide), f"{25 * int(4 * part)} %" if counted else "", guide.alarm]
    words += [f"[{guide.rejected}]" if guide.rejected else "", f"({guide.contact.text})" if guide.contact.text else ""]
    return " ".join(filter(None, words))


def header_of(guide: Guide) -> str:
    """The phase; the position, or the soak that comes before it; the number of positions that are done; and what to set."""
    plan, step = guide.plan, guide.plan.steps[guide.position]
    place, target = f"position {step.name}", f"alpha {step.alpha_deg:g} beta {step.beta_deg:g}"
    if guide.phase == Phase.SOAK:
        place = f"soak {plan.soaks[guide.position] + 1} of {plan.soaks[-1] + 1}"
        target = f"set the chamber to {step.temperature_degc:g} degC"
    return f"{guide.phase.name} {place}, {len(guide.state.accepted)} of {len(plan.steps)} done: {target}"


def note_of(guide: Guide) -> str:
    """The present activity."""
    match guide.phase:
        case Phase.SOAK:
            return guide.soak.note
        case Phase.TURN if not guide.still and guide.moved:
            return "moving"
        case Phase.TURN:
            seen = " (gravity looks the same as before: turn it, or press Enter)" if guide.must_move else ""
            return f"turn the head there and take your hands away{seen}"
        case Phase.SETTLING:
            remaining_s = max(guide.plan.dwell.settle_s - guide.settled_s, 0) / guide.plan.port.speed
            return f"hands off: {remaining_s:.0f} s until recording"
    return "recording"


def _progress(guide: Guide) -> tuple[float, str]:
    """The finished part of a dwell or a soak, and what it counts; an empty text for none."""
    plan = guide.plan
    if guide.dwell is not None:
        part = min(guide.dwell.good / guide.dwell.needed, 1.0)
        left = _duration((1 - part) * plan.dwell.seconds, plan)
        return part, f"{guide.dwell.good} of {guide.dwell.needed} good samples, {left} left"
    if guide.phase == Phase.SOAK:
        stable_min = guide.soak.stability.stable_min
        return min(stable_min / plan.soak.stable_min, 1.0), f"{stable_min:.1f} of {plan.soak.stable_min:g} min stable"
    return 0.0, ""


def _duration(seconds: float, plan: CapturePlan) -> timedelta:
    """A duration of the device's time, by the host's clock."""
    return timedelta(seconds=round(seconds / plan.port.speed))


def rendered(guide: Guide, console: Console) -> RenderableType:
    """The screen: the axes come last, so that a low terminal has phase, alarm, rejection, progress, counters and keys."""
    plan, step, (part, counted), style = (
        guide.plan,
        guide.plan.steps[guide.position],
        _progress(guide),
        guide.phase.value,
    )
    target = (
        f"{step.temperature_degc:g} °C" if guide.phase == Phase.SOAK else f"α {step.alpha_deg:g}°  β {step.beta_deg:g}°"
    )
    large = "\n ".join(
        map("  ".join, zip(*(_GLYPHS[letter].split("/") for letter in target if letter in _GLYPHS), strict=True))
    )
    small = console.height < _LOWEST or max(map(len, large.split("\n"))) >= console.width
    lines = [(header_of(guide), f"{style} reverse"), (target if small else large, style)]
    if counted:
        bar = "█" * round(40 * part)
        lines.append((f"{bar:░<40} {part:4.0%}  {counted}", style))
    lines.append((guide.alarm, "bold white on red") if guide.alarm else (note_of(guide), ""))
    lines += [(guide.contact.text, "bold yellow"), (guide.rejected, "yellow")]
    # The shortest time for the positions and soaks after the present ones.
    later = {k for k in range(len(plan.steps)) if k not in guide.state.accepted} - {guide.position}
    soaks = {plan.soaks[k] for k in later} - {plan.soaks[guide.position]}
    later_s = len(later) * (plan.dwell.seconds + plan.dwell.settle_s) + 60 * plan.soak.stable_min * len(soaks)
    lines += [(f"{guide.stream.tally.line()}; rest of the run: {_duration(later_s, plan)}", "dim"), (_KEYS, "dim")]
    return Group(*(Text(f" {text}", style=style) for text, style in lines if text), _axes(guide))


def _axes(guide: Guide) -> Table:
    """Mean and noise of each axis, with the nominal output, mg."""
    names = "axis", "mean mg", "expected mg", "difference mg", "sd of a sample mg", "drift mg"
    table = Table(*names, box=None, pad_edge=False)
    blocks = (guide.dwell or guide).blocks
    if len(blocks.mean_g):
        mean, expected = blocks.mean_g.mean(0), guide.plan.expected(guide.position)
        columns = [mean, expected, mean - expected, blocks.sd_g.mean(0), blocks.stationarity().drift_g]
        for axis, cells in zip(AXES, np.transpose(columns), strict=True):
            table.add_row(axis, *(f"{1e3 * cell:+9.3f}" for cell in cells))
    return table

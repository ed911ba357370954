"""The operator's screen, in letters that are readable from three metres, its bell and its keys."""

import contextlib
import os
import select
import sys
import termios
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeAlias

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from tumblecal.capture.journal import RunState
from tumblecal.capture.run.guide import Guide, Phase
from tumblecal.ground.axes import AXES


# Lines about the parameters so far, at once: the loop of a capture waits for them.
Estimate: TypeAlias = Callable[[RunState], list[str]]

_KEYS = " Enter: accept as it is   r: repeat this position   b: repeat the previous one   s: skip   q: interrupt"
_STYLES = {
    Phase.SOAK: "bold magenta",
    Phase.TURN: "bold yellow",
    Phase.SETTLING: "bold cyan",
    Phase.FINISHED: "bold white",
}
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
    ":": " /█/ /█/ ",
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
        self._console, self._last, self._estimate = Console(highlight=False), [""], estimate
        shown = not plain and self._console.is_terminal
        self._live = Live(console=self._console, screen=True, auto_refresh=False) if shown else None
        self._saved: list | None = None
        self._open = True

    def __enter__(self) -> "Screen":
        with contextlib.suppress(termios.error):  # no terminal
            self._saved = termios.tcgetattr(sys.stdin.fileno())
            tty.setcbreak(sys.stdin.fileno())
        if self._live is not None:
            self._live.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            with self._terminal_may_be_gone():
                self._live.__exit__(None, None, None)
        if self._saved is not None:
            with contextlib.suppress(termios.error):  # the terminal may be closed
                termios.tcsetattr(sys.stdin.fileno(), termios.TCSADRAIN, self._saved)

    def show(self, guide: Guide) -> None:
        """Show the present state."""
        estimate = self._estimate(guide.state) if self._estimate else []
        lines = [*estimate, line_of(guide)]
        with self._terminal_may_be_gone():
            if self._live is not None:
                self._live.update(Group(rendered(guide, self._console), *map(Text, estimate)), refresh=True)
            elif new := [line for line in lines if line not in self._last]:
                print(*new, sep="\n", flush=True)
        self._last = lines

    def bell(self) -> None:
        """Ring."""
        with self._terminal_may_be_gone():
            print(end="\a", flush=True)

    def pressed(self) -> str:
        """The keys pressed since the last call, in order."""
        keys = ""
        while self._open and select.select([sys.stdin], [], [], 0)[0]:
            data = b""
            with contextlib.suppress(OSError):  # the terminal is closed
                data = os.read(sys.stdin.fileno(), 1024)
            self._open = bool(data)
            keys += data.decode(errors="replace")
        return keys

    @contextmanager
    def _terminal_may_be_gone(self) -> Iterator[None]:
        """A closed terminal must not end a recording: later output is discarded."""
        try:
            yield
        except OSError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, sys.stdout.fileno())
            os.close(nowhere)


def header_of(guide: Guide) -> str:
    """The phase; the position, or the soak that comes before it; and the number of positions that are done."""
    plan, phase = guide.plan, Phase.RECORDING if guide.phase == Phase.CLOSING else guide.phase
    place = f"position {plan.steps[guide.position].name}"
    if phase == Phase.SOAK:
        place = f"soak {plan.soaks[guide.position] + 1} of {plan.soaks[-1] + 1}"
    return f"{phase.value} {place}, {len(guide.state.accepted)} of {len(plan.steps)} done"


def note_of(guide: Guide) -> str:
    """The present activity."""
    match guide.phase:
        case Phase.SOAK:
            return guide.soak.note
        case Phase.TURN if not guide.still and guide.watch.moved:
            return "moving"
        case Phase.TURN:
            seen = " (gravity looks the same as before: turn it, or press Enter)" if guide.must_move else ""
            return f"turn the head there and take your hands away{seen}"
        case Phase.SETTLING:
            remaining_s = max(guide.plan.dwell.settle_s - guide.settled_s, 0) / guide.plan.port.speed
            return f"hands off: {remaining_s:.0f} s until recording"
        case Phase.CLOSING:
            return "done; checking for lost samples"
    return "recording"


def _progress(guide: Guide) -> tuple[float, str]:
    """The finished part of a dwell or a soak, and what it counts; an empty text for none."""
    if guide.dwell is not None:
        return guide.dwell.good / guide.dwell.needed, f"{guide.dwell.good} of {guide.dwell.needed} good samples"
    if guide.phase == Phase.SOAK and guide.soak.stability is not None:
        stable, needed = guide.soak.stability.stable_min, guide.plan.soak.stable_min
        return stable / needed, f"{stable:.1f} of {needed:g} min stable"
    return 0.0, ""


def line_of(guide: Guide) -> str:
    """The state in one line."""
    step, (part, counted) = guide.plan.steps[guide.position], _progress(guide)
    target = f"alpha {step.alpha_deg:g} beta {step.beta_deg:g}"
    if guide.phase == Phase.SOAK:
        target = f"set the chamber to {guide.soak.wanted_degc:g} degC"
    words = [f"{header_of(guide)}: {target}", f"{25 * int(4 * min(part, 1.0))} %" if counted else "", guide.alarm]
    words.append(f"[{guide.rejected}]" if guide.rejected and guide.rejected not in guide.alarm else "")
    words.append(f"({guide.identity.text})" if guide.identity.text else "")
    return " ".join(filter(None, words))


def rendered(guide: Guide, console: Console) -> RenderableType:
    """The screen: the axes come last, so that a low terminal has phase, alarm, rejection, progress, counters and keys."""
    plan, style, (part, counted) = guide.plan, _STYLES.get(guide.phase, "bold green"), _progress(guide)
    step = plan.steps[guide.position]
    target = f"α {step.alpha_deg:g}°  β {step.beta_deg:g}°"
    if guide.phase == Phase.SOAK:
        target = f"{guide.soak.wanted_degc:g} °C"
    left_s = (1 - part) * plan.dwell.seconds / plan.port.speed if guide.dwell is not None else 0.0
    small = console.height < _LOWEST or max(map(len, _big(target).split("\n"))) > console.width
    shown = (lambda text: f" {text}") if small else _big
    lines = [Text(f" {header_of(guide)}", style=f"{style} reverse"), Text(shown(target), style=style)]
    if guide.dwell is not None:
        lines.append(Text(shown(_clock(left_s)), style=style))
    if counted:
        filled = round(40 * min(part, 1.0))
        lines.append(Text(f" {'█' * filled}{'░' * (40 - filled)} {part:4.0%}  {counted}", style=style))
    lines.append(Text(f" {guide.alarm}", "bold white on red") if guide.alarm else Text(f" {note_of(guide)}"))
    doubts = ((guide.identity.text, "bold yellow"), (guide.rejected, "yellow"))
    lines += [Text(f" {text}", style=colour) for text, colour in doubts if text]
    # The shortest time for the positions and soaks after the present ones.
    accepted, here = guide.state.accepted, guide.position
    soaks = {plan.soaks[k] for k in range(len(plan.steps)) if k not in accepted} - {plan.soaks[here]}
    rest_s = (len(plan.steps) - len({*accepted, here})) * (plan.dwell.seconds + plan.dwell.settle_s)
    run_s = left_s + (rest_s + 60 * plan.soak.stable_min * len(soaks)) / plan.port.speed
    counters = f" run: {_clock(run_s)} left   {guide.stream.tally.line()}"
    return Group(*lines, Text(counters, style="dim"), Text(_KEYS, style="dim"), _axes(guide))


def _axes(guide: Guide) -> Table:
    """Mean and noise of each axis, with the nominal output, mg."""
    table = Table(box=None, pad_edge=False)
    for name in ("axis", "mean mg", "expected mg", "difference mg", "sd of a sample mg", "drift mg"):
        table.add_column(name, justify="right")
    blocks = (guide.dwell or guide.watch).blocks
    if len(blocks.mean_g):
        mean, expected = blocks.mean_g.mean(0), guide.plan.expected(guide.position)
        columns = [mean, expected, mean - expected, blocks.sd_g.mean(0), blocks.stationarity().drift_g]
        for axis, cells in zip(AXES, np.transpose(columns), strict=True):
            table.add_row(axis, *(f"{1e3 * cell:+.3f}" for cell in cells))
    return table


def _big(text: str) -> str:
    """Text in letters five lines high; characters without a glyph are skipped."""
    rows = zip(*(_GLYPHS[letter].split("/") for letter in text if letter in _GLYPHS), strict=True)
    return "\n".join(map("  ".join, rows))


def _clock(seconds: float) -> str:
    """1:05:09 or 5:09."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02d}:{rest:02d}" if minutes >= 60 else f"{minutes}:{rest:02d}"

"""The operator's screen, in letters that are readable from three metres, and the bell."""

import contextlib
import os
import select
import sys
import termios
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import TracebackType

import numpy as np
from numpy.typing import NDArray
from rich import box
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text


class Keyboard:
    """Keys pressed since the last call.

    On a terminal each key is read separately; from a pipe, each character is a key.
    """

    def __init__(self) -> None:
        self._saved: list | None = None
        self._open = True

    def __enter__(self) -> "Keyboard":
        if sys.stdin.isatty():
            with contextlib.suppress(termios.error):
                self._saved = termios.tcgetattr(sys.stdin.fileno())
                tty.setcbreak(sys.stdin.fileno())
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._saved is not None:
            with contextlib.suppress(termios.error):  # the terminal may be closed
                termios.tcsetattr(sys.stdin.fileno(), termios.TCSADRAIN, self._saved)

    def pressed(self) -> str:
        """The keys pressed since the last call, in order."""
        keys = ""
        while self._open and select.select([sys.stdin], [], [], 0)[0]:
            data = b""
            with contextlib.suppress(OSError):  # the terminal is closed
                data = os.read(sys.stdin.fileno(), 1024)
            if not data:
                self._open = False
                break
            keys += data.decode(errors="replace")
        return keys


_GLYPHS = {
    "0": ("███", "█ █", "█ █", "█ █", "███"),
    "1": (" █ ", "██ ", " █ ", " █ ", "███"),
    "2": ("███", "  █", "███", "█  ", "███"),
    "3": ("███", "  █", "███", "  █", "███"),
    "4": ("█ █", "█ █", "███", "  █", "  █"),
    "5": ("███", "█  ", "███", "  █", "███"),
    "6": ("███", "█  ", "███", "█ █", "███"),
    "7": ("███", "  █", "  █", "  █", "  █"),
    "8": ("███", "█ █", "███", "█ █", "███"),
    "9": ("███", "█ █", "███", "  █", "███"),
    "-": ("   ", "   ", "███", "   ", "   "),
    ".": (" ", " ", " ", " ", "█"),
    ":": (" ", "█", " ", "█", " "),
    "°": ("██", "██", "  ", "  ", "  "),
    "C": ("███", "█  ", "█  ", "█  ", "███"),
    " ": ("  ", "  ", "  ", "  ", "  "),
    "α": ("     ", "██ █ ", "█ ██ ", "█ ██ ", "██ █ "),
    "β": ("███ ", "█ █ ", "██▄ ", "█  █", "█▀▀ "),
}


def big(text: str) -> str:
    """Text in letters five lines high; characters without a glyph are skipped."""
    rows = ["  ".join(_GLYPHS[c][row] for c in text if c in _GLYPHS) for row in range(5)]
    return "\n".join(rows)


def clock(seconds: float) -> str:
    """1:05:09 or 5:09."""
    seconds = max(0, round(seconds))
    hours, minutes, rest = seconds // 3600, seconds // 60 % 60, seconds % 60
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


@dataclass
class View:
    """The contents of the screen.

    **Arguments:**

    - `phase`: "SOAK", "TURN", "SETTLING", "RECORDING", "FINISHED" or a different word.
    - `soak_degc`: the requested temperature, shown in place of the angles during a soak.
    - `alpha_deg`, `beta_deg`: the prompted position; `place`: e.g. "position 3 of 24".
    - `alarm`: present fault; empty for none. `note`: present activity.
    - `rejected`: why the last attempt at this position was rejected; empty if none was.
    - `doubt`: doubt about the instrument; empty for none.
    - `done`, `needed`: good samples; of a soak, seconds of stable temperature.
    - `left_s`: remaining time of this position; `run_left_s`: of the run.
    - `mean_g`, `sd_g`, `expected_g`: per axis, NaN before the first value.
    """

    phase: str = ""
    soak_degc: float = 0.0
    alpha_deg: float = 0.0
    beta_deg: float = 0.0
    place: str = ""
    alarm: str = ""
    note: str = ""
    rejected: str = ""
    doubt: str = ""
    done: int = 0
    needed: int = 0
    left_s: float = 0.0
    run_left_s: float = 0.0
    mean_g: NDArray[np.float64] = field(default_factory=lambda: np.full(3, np.nan))
    sd_g: NDArray[np.float64] = field(default_factory=lambda: np.full(3, np.nan))
    expected_g: NDArray[np.float64] = field(default_factory=lambda: np.full(3, np.nan))
    drift_g: NDArray[np.float64] = field(default_factory=lambda: np.full(3, np.nan))
    counters: str = ""
    estimate: list[tuple[str, float, float, str]] = field(default_factory=list)
    keys: str = ""


_STYLES = {
    "SOAK": "bold magenta",
    "TURN": "bold yellow",
    "SETTLING": "bold cyan",
    "RECORDING": "bold green",
    "FINISHED": "bold white",
}


# Parts that a low terminal shows smaller or not at all, the least important first; all other parts are always shown.
_LEAST_FIRST = ("above", "between", "below", "estimate", "clock", "axes", "angles")


def rendered(view: View, console: Console) -> RenderableType:
    """The screen, no higher than the terminal: phase, alarm, rejection, progress, counters and keys are always visible."""
    style = _STYLES.get(view.phase, "bold")
    soak = view.phase == "SOAK"
    angles = f"{view.soak_degc:g} °C" if soak else f"α {view.alpha_deg:g}°  β {view.beta_deg:g}°"
    parts: dict[str, RenderableType] = {
        "header": Text(f" {view.phase}   {view.place}", style=f"{style} reverse"),
        "above": Text(""),
        "angles": Text(big(angles), style=style),
        "between": Text(""),
    }
    if view.phase == "RECORDING":
        parts |= {"clock": Text(big(clock(view.left_s)), style=style), "bar": _bar(view.done, view.needed, style)}
    alarm, note = Text(f" {view.alarm}", style="bold white on red"), Text(f" {view.note}")
    parts |= {"note": alarm if view.alarm else note}
    if view.doubt:
        parts["doubt"] = Text(f" {view.doubt}", style="bold yellow")
    if view.rejected:
        parts["rejected"] = Text(f" {view.rejected}", style="yellow")
    parts |= {"axes": _axes(view), "estimate": _estimate(view.estimate)}
    parts |= {
        "below": Text(""),
        "counters": Text(f" run: {clock(view.run_left_s)} left   {view.counters}", style="dim"),
        "keys": Text(f" {view.keys}", style="dim"),
    }
    small = {"angles": Text(f" {angles}", style=style), "clock": Text(f" {clock(view.left_s)} left", style=style)}
    if len(big(angles).split("\n")[0]) > console.width:
        parts["angles"] = small["angles"]
    for name in _LEAST_FIRST:
        over = sum(len(console.render_lines(part)) for part in parts.values()) - console.height
        if over <= 0:
            break
        if name == "estimate":
            parts[name] = _estimate(view.estimate, over)
        elif name in small and name in parts:
            parts[name] = small[name]
        else:
            parts.pop(name, None)
    return Group(*parts.values())


def _bar(done: int, needed: int, style: str) -> Text:
    part = min(done / needed, 1.0) if needed else 0.0
    filled = round(40 * part)
    return Text(f" {'█' * filled}{'░' * (40 - filled)} {part:4.0%}  {done} of {needed} good samples", style=style)


def _mg(value: float) -> str:
    return "-" if not np.isfinite(value) else f"{value * 1e3:+.3f}"


def _axes(view: View) -> Table:
    table = Table(box=box.SIMPLE, pad_edge=False)
    for name in ("axis", "mean mg", "expected mg", "difference mg", "sd of a sample mg", "drift mg"):
        table.add_column(name, justify="right")
    for axis, name in enumerate("xyz"):
        mean, expected = float(view.mean_g[axis]), float(view.expected_g[axis])
        cells = (mean, expected, mean - expected, float(view.sd_g[axis]), float(view.drift_g[axis]))
        table.add_row(name, *(_mg(c) for c in cells))
    return table


def _estimate(rows: list[tuple[str, float, float, str]], over: int = 0) -> RenderableType:
    """The parameters in two columns, with `over` lines fewer than needed; nothing if no line remains."""
    half = (len(rows) + 1) // 2
    shown = half - over
    if shown <= 0:
        return Group()
    title = "estimate so far" + (f", {2 * shown} of {len(rows)}: enlarge the window to see all" if over else "")
    table = Table(box=box.SIMPLE, pad_edge=False, title=title, title_justify="left")
    for _ in range(2):
        for name in ("parameter", "value", "sd", "unit"):
            table.add_column(name, justify="right")
    for k in range(shown):
        cells = []
        for row in rows[k : k + 1] + rows[half + k : half + k + 1]:
            cells += [row[0], f"{row[1]:+.3f}", f"{row[2]:.3f}", row[3]]
        table.add_row(*cells)
    return table


class Screen:
    """Shows a view: redrawn in place on a terminal, otherwise one line for each change."""

    def __init__(self, plain: bool = False):
        self._console = Console(highlight=False)
        self._plain = plain or not self._console.is_terminal
        self._live: Live | None = None
        self._last = ""

    def __enter__(self) -> "Screen":
        if not self._plain:
            self._live = Live(console=self._console, screen=True, auto_refresh=False)
            self._live.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        if self._live is not None:
            with self._terminal_may_be_gone():
                self._live.__exit__(None, None, None)
            self._live = None

    def show(self, view: View) -> None:
        """Show this view."""
        if self._live is not None:
            with self._terminal_may_be_gone():
                self._live.update(rendered(view, self._console), refresh=True)
            return
        progress = view.phase in ("SOAK", "RECORDING") and view.needed
        part = f"{100 * view.done // view.needed // 25 * 25} %" if progress else ""
        angles = f"alpha {view.alpha_deg:g} beta {view.beta_deg:g}"
        target = f"set the chamber to {view.soak_degc:g} degC" if view.phase == "SOAK" else angles
        line = f"{view.phase} {view.place}: {target} {part} {view.alarm}"
        line = f"{line.rstrip()} [{view.rejected}]" if view.rejected and view.rejected not in view.alarm else line
        line = f"{line.rstrip()} ({view.doubt})" if view.doubt else line
        if line != self._last:
            with self._terminal_may_be_gone():
                print(line.rstrip(), flush=True)
            self._last = line

    def bell(self) -> None:
        """Ring."""
        with self._terminal_may_be_gone():
            sys.stdout.write("\a")
            sys.stdout.flush()

    @contextmanager
    def _terminal_may_be_gone(self) -> Iterator[None]:
        """A closed terminal must not end a recording: later output is discarded."""
        try:
            yield
        except OSError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, sys.stdout.fileno())
            os.close(nowhere)

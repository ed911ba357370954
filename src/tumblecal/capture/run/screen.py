"""The operator's screen, in letters that are readable from three metres, its bell and its keys."""

import contextlib
import os
import select
import sys
import termios
import tty
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from rich import box
from rich.columns import Columns
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from tumblecal.capture.run.guide import Guide, Phase
from tumblecal.ground.axes import AXES


# Name, value, standard uncertainty and unit.
Parameter = tuple[str, float, float, str]

_KEYS = "Enter: accept as it is   r: repeat this position   b: repeat the previous one   s: skip   q: interrupt"
_STYLES = {
    Phase.SOAK: "bold magenta",
    Phase.TURN: "bold yellow",
    Phase.SETTLING: "bold cyan",
    Phase.RECORDING: "bold green",
    Phase.CLOSING: "bold green",
    Phase.FINISHED: "bold white",
}
# Parts that a low terminal shows smaller or not at all, the least important first; all other parts are always shown.
_LEAST_FIRST = ("above", "between", "below", "parameters", "clock", "axes", "target")
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

    def __exit__(self, *_: object) -> None:
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
            self._open = bool(data)
            keys += data.decode(errors="replace")
        return keys


class Screen:
    """Shows the guide: redrawn in place on a terminal, otherwise one line for each change.

    `parameters`: estimate from the positions so far; empty for none.
    """

    parameters: list[Parameter]

    def __init__(self, plain: bool = False):
        self._console = Console(highlight=False)
        shown = not plain and self._console.is_terminal
        self._live = Live(console=self._console, screen=True, auto_refresh=False) if shown else None
        self._last = ""
        self.parameters = []

    def __enter__(self) -> "Screen":
        if self._live is not None:
            self._live.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        if self._live is not None:
            with self._terminal_may_be_gone():
                self._live.__exit__(None, None, None)

    def show(self, guide: Guide) -> None:
        """Show the present state."""
        line = line_of(guide)
        with self._terminal_may_be_gone():
            if self._live is not None:
                self._live.update(rendered(guide, self.parameters, self._console), refresh=True)
            elif line != self._last:
                print(line, flush=True)
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


def place_of(guide: Guide) -> str:
    """The position, or the soak that comes before it, and the number of positions that are done."""
    plan, position = guide.plan, max(guide.position, 0)
    soak = f"soak {plan.soaks[position] + 1} of {plan.soaks[-1] + 1}"
    place = soak if guide.phase == Phase.SOAK else f"position {plan.steps[position].name}"
    return f"{place}, {len(guide.state.accepted)} of {len(plan.steps)} done"


def note_of(guide: Guide) -> str:
    """The present activity."""
    match guide.phase:
        case Phase.SOAK:
            return guide.soak.note
        case Phase.TURN if not guide.watch.still and guide.watch.moved:
            return "moving"
        case Phase.TURN:
            seen = " (gravity looks the same as before: turn it, or press Enter)" if guide.must_move else ""
            return f"turn the head there and take your hands away{seen}"
        case Phase.SETTLING:
            remaining_s = guide.plan.dwell.settle_s - guide.settled / guide.rate_hz
            return f"hands off: {max(remaining_s, 0) / guide.plan.port.speed:.0f} s until recording"
        case Phase.CLOSING:
            return "done; checking for lost samples"
        case Phase.FINISHED:
            return "all positions are done"
    return "recording"


def _progress(guide: Guide) -> tuple[int, int]:
    """Good samples so far and needed; of a soak, seconds of stable temperature."""
    if guide.phase == Phase.SOAK and guide.soak.stability is not None:
        return round(60 * guide.soak.stability.stable_min), round(60 * guide.plan.soak.stable_min)
    return (guide.dwell.good, guide.dwell.needed) if guide.dwell else (0, 0)


def _shown_phase(guide: Guide) -> str:
    return (Phase.RECORDING if guide.phase == Phase.CLOSING else guide.phase).value


def line_of(guide: Guide) -> str:
    """The state in one line."""
    step, (done, needed) = guide.plan.steps[max(guide.position, 0)], _progress(guide)
    target = f"alpha {step.alpha_deg:g} beta {step.beta_deg:g}"
    if guide.phase == Phase.SOAK:
        target = f"set the chamber to {guide.soak.wanted_degc:g} degC"
    words = [
        f"{_shown_phase(guide)} {place_of(guide)}: {target}",
        f"{100 * done // needed // 25 * 25} %" if needed else "",
    ]
    words += [guide.alarm, f"[{guide.rejected}]" if guide.rejected and guide.rejected not in guide.alarm else ""]
    words += [f"({guide.identity.text})" if guide.identity.text else ""]
    return " ".join(filter(None, words))


def rendered(guide: Guide, parameters: list[Parameter], console: Console) -> RenderableType:
    """The screen, no higher than the terminal: phase, alarm, rejection, progress, counters and keys are always visible."""
    plan, style, (done, needed) = guide.plan, _STYLES[guide.phase], _progress(guide)
    step = plan.steps[max(guide.position, 0)]
    target = f"α {step.alpha_deg:g}°  β {step.beta_deg:g}°"
    if guide.phase == Phase.SOAK:
        target = f"{guide.soak.wanted_degc:g} °C"
    remaining_s = max(needed - done, 0) / guide.rate_hz / plan.port.speed
    parts: dict[str, RenderableType] = {
        "header": Text(f" {_shown_phase(guide)}   {place_of(guide)}", style=f"{style} reverse"),
        "above": Text(""),
        "target": Text(_big(target), style=style),
        "between": Text(""),
    }
    if guide.dwell is not None:
        filled = round(40 * min(done / needed, 1.0))
        bar = f" {'█' * filled}{'░' * (40 - filled)} {done / needed:4.0%}  {done} of {needed} good samples"
        parts |= {"clock": Text(_big(_clock(remaining_s)), style=style), "bar": Text(bar, style=style)}
    alarm = Text(f" {guide.alarm}", style="bold white on red")
    parts["note"] = alarm if guide.alarm else Text(f" {note_of(guide)}")
    parts |= {
        name: Text(f" {text}", style=f"{weight}yellow")
        for name, text, weight in (("doubt", guide.identity.text, "bold "), ("rejected", guide.rejected, ""))
        if text
    }
    parts["axes"] = _axes(guide)
    if parameters:
        entries = [f" {name} {value:+.3f} ± {u:.3f} {unit} " for name, value, u, unit in parameters]
        parts["parameters"] = Columns(entries, title="estimate so far", equal=True, column_first=True)
    parts |= {
        "below": Text(""),
        "counters": Text(
            f" run: {_clock(_run_left_s(guide) + remaining_s)} left   {guide.stream.tally.line()}", style="dim"
        ),
        "keys": Text(f" {_KEYS}", style="dim"),
    }
    small = {"target": Text(f" {target}", style=style), "clock": Text(f" {_clock(remaining_s)} left", style=style)}
    if len(_big(target).split("\n")[0]) > console.width:
        parts["target"] = small["target"]
    for name in _LEAST_FIRST:
        if sum(len(console.render_lines(part)) for part in parts.values()) <= console.height:
            break
        if name in parts and name in small:
            parts[name] = small[name]
        else:
            parts.pop(name, None)
    return Group(*parts.values())


def _run_left_s(guide: Guide) -> float:
    """Shortest time for the positions and soaks after the present ones, s."""
    plan, accepted = guide.plan, guide.state.accepted
    positions = [k for k in range(len(plan.steps)) if k not in accepted]
    dwells = max(len(positions) - (guide.dwell is not None), 0) * (plan.dwell.seconds + plan.dwell.settle_s)
    soaks = (len({plan.soaks[k] for k in positions}) - (guide.phase != Phase.SOAK)) * plan.over_temperature
    return (dwells + 60 * plan.soak.stable_min * max(soaks, 0)) / plan.port.speed


def _axes(guide: Guide) -> Table:
    """Mean and noise of each axis, with the nominal output, mg."""
    table = Table(box=box.SIMPLE, pad_edge=False)
    for name in ("axis", "mean mg", "expected mg", "difference mg", "sd of a sample mg", "drift mg"):
        table.add_column(name, justify="right")
    dwell, expected = guide.dwell, guide.plan.expected(max(guide.position, 0))
    mean, sd = (dwell.mean, dwell.sd) if dwell else np.vstack([np.full((2, 3), np.nan), *guide.watch.blocks[-1:]])[-2:]
    for axis, cells in zip(AXES, np.transpose([mean, expected, mean - expected, sd, guide.drift_g]), strict=True):
        table.add_row(axis, *(f"{cell * 1e3:+.3f}" if np.isfinite(cell) else "-" for cell in cells))
    return table


def _big(text: str) -> str:
    """Text in letters five lines high; characters without a glyph are skipped."""
    return "\n".join("  ".join(_GLYPHS[c][row] for c in text if c in _GLYPHS) for row in range(5))


def _clock(seconds: float) -> str:
    """1:05:09 or 5:09."""
    minutes, rest = divmod(max(0, round(seconds)), 60)
    return f"{minutes // 60}:{minutes % 60:02d}:{rest:02d}" if minutes >= 60 else f"{minutes}:{rest:02d}"

"""A guide of a plan that is fed by hand, a block of a second at a time."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.capture.chamber import Soak
from tumblecal.capture.decoding.samples import Event, blank
from tumblecal.capture.decoding.tally import Tally
from tumblecal.capture.journal import JOURNAL_NAME, Journal
from tumblecal.capture.log import read_log
from tumblecal.capture.port.live import Arrived
from tumblecal.capture.protocols import protocol
from tumblecal.capture.run.contact import Contact
from tumblecal.capture.run.guide import Guide, Phase
from tumblecal.capture.run.run_folder import RunFolder
from tumblecal.capture.run.screen import line_of


class HandFed:
    """`turned`: z of the readings, g; `now_s`: stamp of the last ones."""

    def __init__(self, folder: Path, name: str = "witmotion", rate_hz: float = 20.0, chamber=None, **plan):
        dwell, table = {"seconds": 4.0, "settle_s": 0.0} | plan.pop("dwell", {}), plan.pop("chamber_table", {})
        self.plan = CapturePlan.model_validate({"dwell": dwell, "chamber": table} | plan)
        recording = SimpleNamespace(position=0, sync=lambda: None, send=lambda query: None, log=folder / "journal.log")
        stream = SimpleNamespace(recording=recording, tally=Tally(), protocol=protocol(name))
        stream.poll = lambda: self.part
        self.folder, self.journal = folder, Journal(folder)
        self.rng, self.turned, self.now_s = np.random.default_rng(0), 1.0, 1000.0
        run = RunFolder(folder, self.plan, self.journal)
        contact, self.soak = Contact(run, stream), Soak(self.plan, self.journal, rate_hz, chamber)  # type: ignore[arg-type]
        contact.rate_hz = rate_hz
        self.guide = Guide(run, contact, self.soak, lambda: self.keys, lambda: None)
        self.state, self.keys, self._steps = self.guide.state, "", self.guide.run()
        next(self._steps)

    def feed(self, count: int = 20, *notices: dict, degc: float = np.nan, counter=None, host_s=None, events=()) -> None:
        self.now_s += 1.0
        samples, places = blank(count), np.zeros(count, np.int64)
        samples.force[:] = [0.0, 0.0, self.turned] + 1e-4 * self.rng.normal(size=(count, 3))
        samples.rate[:], samples.temperature[:] = 0.0, degc
        samples.counter[:] = -1 if counter is None else counter
        host_s = np.full(count, self.now_s) if host_s is None else host_s
        self.part = Arrived(samples, host_s, places, places, [Event(0, *event) for event in events], list(notices))
        next(self._steps, None)

    def press(self, keys: str) -> None:
        self.keys = keys
        self.feed(0)
        self.keys = ""

    def until(self, phase: Phase, degc: float = np.nan) -> None:
        for _ in range(400):
            if self.guide.phase == phase:
                return
            self.feed(degc=degc)
        raise AssertionError(line_of(self.guide))

    def entries(self, *kinds: str) -> list[dict]:
        entries = [record.content() for record in read_log(self.folder / JOURNAL_NAME)]
        return [entry for entry in entries if entry["entry"] in kinds]

"""Another instrument, the same one that does not answer, and one that answers late: after an unplug and on resuming."""

import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tumblecal.capture.decoding.samples import Event
from tumblecal.capture.journal import Journal
from tumblecal.capture.protocols import protocol
from tumblecal.capture.run.contact import WAITS_S, Contact
from tumblecal.capture.run.run_folder import RunFolder
from tumblecal.ground.errors import InputError


def test_questions_are_bounded_and_grow_and_a_late_answer_counts(tmp_path, monkeypatch):
    now, sent = [0.0], []
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    monkeypatch.setattr(time, "sleep", lambda seconds: None)
    journal = Journal(tmp_path)
    journal.write("device", serial_number="N1", events=[{"kind": "configuration", "raw": "aa"}])
    journal.write("accepted", position=0, attempt=1, log_start=0, log_stop=1, sha256="", summary={})
    plan = SimpleNamespace(port=SimpleNamespace(speed=1.0))
    recording = SimpleNamespace(send=lambda query: sent.append(now[0]))
    stream = SimpleNamespace(recording=recording, protocol=replace(protocol("stim300"), queries=(b"I\r",)))
    identity = Contact(RunFolder(tmp_path, plan, journal), stream)  # type: ignore[arg-type]
    identity.interrupted({"event": "reopened"})
    while not identity.hear([], 1):
        now[0] += 0.01
    np.testing.assert_allclose(sent, np.concatenate([[0], np.cumsum(WAITS_S)[:-1]]), atol=0.1)
    assert (np.diff(WAITS_S) > 0).all() and identity.doubted and not identity.asking
    assert not identity.hear([Event(0, "serial_number", {"serial_number": "N1"})], 1) and not identity.doubted
    with pytest.raises(InputError, match="began with other settings of the instrument"):
        identity.hear([Event(0, "configuration", {"raw": "bb"})], 1)
    with pytest.raises(InputError, match="N2 is connected"):
        identity.hear([Event(0, "serial_number", {"serial_number": "N2"})], 1)
    journal.close()

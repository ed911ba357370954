"""The screen of a guided run."""

import numpy as np

from tumblecal.capture.guide import Guide, Phase
from tumblecal.capture.terminal_screen import View


KEYS = "Enter: accept as it is   r: repeat this position   b: repeat the previous one   s: skip   q: interrupt"


def view_of(guide: Guide) -> View:
    """The present content of the screen."""
    guide.worker.look()
    plan, dwell, accepted = guide.plan, guide.dwell, guide.state.accepted
    steps, position = plan.steps, max(guide.position, 0)
    speed, last = plan.port.speed, guide.watch.last
    each = (plan.dwell.seconds + plan.dwell.settle_s) / speed
    left = len(steps) - len(accepted)
    done = dwell.good if dwell else 0
    needed = dwell.needed if dwell else 0
    remaining = max(needed - done, 0) / guide.rate_hz / speed
    blank = np.full(3, np.nan)
    return View(
        phase=guide.phase.value if guide.phase != Phase.CLOSING else "RECORDING",
        alpha_deg=steps[position].alpha_deg,
        beta_deg=steps[position].beta_deg,
        place=f"position {steps[position].name}, {len(accepted)} of {len(steps)} done",
        alarm=guide.alarm,
        note=_note(guide),
        rejected=guide.rejected,
        doubt=guide.doubt.text,
        done=done,
        needed=needed,
        left_s=remaining,
        run_left_s=remaining + each * max(left - (dwell is not None), 0),
        mean_g=dwell.mean if dwell else (last.mean if last else blank),
        sd_g=dwell.sd if dwell else (last.sd if last else blank),
        expected_g=plan.expected(position),
        drift_g=guide.drift_g if dwell and len(dwell.blocks) > 3 else blank,
        counters=guide.stream.tally.line(),
        estimate=guide.worker.rows,
        keys=KEYS,
    )


def _note(guide: Guide) -> str:
    match guide.phase:
        case Phase.TURN:
            if not guide.watch.still and guide.watch.moved:
                return "moving"
            seen = " (gravity looks the same as before: turn it, or press Enter)" if guide.must_move else ""
            return f"turn the head there and take your hands away{seen}"
        case Phase.SETTLING:
            left = guide.plan.dwell.settle_s - guide.settled / guide.rate_hz
            return f"hands off: {max(left, 0) / guide.plan.port.speed:.0f} s until recording"
        case Phase.CLOSING:
            return "done; checking for lost samples"
        case Phase.FINISHED:
            return "all positions are done"
    return "recording"

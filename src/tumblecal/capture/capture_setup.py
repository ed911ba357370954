"""The set-up that a plan of further positions copies from the capture before: a comment of the means, and tables of a plan."""

import json
from collections.abc import Iterator

from pydantic import ValidationError

from tumblecal.capture.capture_plan import CapturePlan, DwellTable, LimitsTable, PortTable, Session
from tumblecal.ground.strict_toml import Number, Strict, toml_string


SETUP = "capture_setup"
# The next plan has different ones of these.
_NOT_COPIED = {"session": {"title", "mount", "run", "notes"}, "port": {"serial_number"}}


class CaptureSetup(Strict):
    """The set-up of a capture: session, port, dwell times, limits, and the rotation of the triad (deg)."""

    session: Session = Session()
    port: PortTable = PortTable()
    dwell: DwellTable = DwellTable()
    limits: LimitsTable = LimitsTable()
    mount_rotation_deg: list[Number] | None = None

    @classmethod
    def of(cls, plan: CapturePlan) -> "CaptureSetup":
        """The set-up of a plan."""
        return cls(
            session=plan.session,
            port=plan.port,
            dwell=plan.dwell,
            limits=plan.limits,
            mount_rotation_deg=plan.positions.mount_rotation_deg,
        )

    @property
    def text(self) -> str:
        """One line for a comment: the stated keys of the plan, and all of the dwell."""
        content = self.model_dump(exclude_unset=True, exclude=_NOT_COPIED) | {"dwell": self.dwell.model_dump()}
        return json.dumps({name: value for name, value in content.items() if value not in ({}, None)})

    def lines(self, table: str) -> Iterator[str]:
        """The stated keys of one of its tables, as in a plan; all keys of the dwell."""
        stated = getattr(self, table)
        for key, value in stated.model_dump(exclude_unset=table != "dwell", exclude=_NOT_COPIED.get(table)).items():
            yield f"{key} = {toml_string(value) if isinstance(value, str) else repr(value)}"


def setup_of_comment(text: str | None) -> CaptureSetup | None:
    """The set-up from a comment; None if there is none, or it is not valid."""
    if not text:
        return None
    try:
        return CaptureSetup.model_validate_json(text)
    except ValidationError:
        return None

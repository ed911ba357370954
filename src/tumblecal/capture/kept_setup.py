"""What a plan of more positions takes over from the capture before: a comment of its position means, and tables of a plan."""

import json
from collections.abc import Iterator

from pydantic import ValidationError

from tumblecal.capture.capture_plan import CapturePlan, DwellTable, LimitsTable, PortTable, Session
from tumblecal.ground.strict_toml import Number, Strict, toml_string


SETUP = "capture_setup"
# Of these the next plan has its own.
_OWN = {"session": {"title", "mount", "run", "notes"}, "port": {"serial_number"}}


class KeptSetup(Strict):
    """How a capture was set up: who and with what, the port, how long, when a dwell is good, how the triad was turned (deg)."""

    session: Session = Session()
    port: PortTable = PortTable()
    dwell: DwellTable = DwellTable()
    limits: LimitsTable = LimitsTable()
    mount_rotation_deg: list[Number] | None = None

    @classmethod
    def of(cls, plan: CapturePlan) -> "KeptSetup":
        """That of a plan."""
        return cls(
            session=plan.session,
            port=plan.port,
            dwell=plan.dwell,
            limits=plan.limits,
            mount_rotation_deg=plan.positions.mount_rotation_deg,
        )

    @property
    def text(self) -> str:
        """One line, for a comment: what the plan states, and all of the dwell."""
        content = self.model_dump(exclude_unset=True, exclude=_OWN) | {"dwell": self.dwell.model_dump()}
        return json.dumps({name: value for name, value in content.items() if value not in ({}, None)})

    def lines(self, table: str) -> Iterator[str]:
        """The keys of one of its tables that are stated, as a plan has them; of the dwell all."""
        own = getattr(self, table)
        for key, value in own.model_dump(exclude_unset=table != "dwell", exclude=_OWN.get(table)).items():
            yield f"{key} = {toml_string(value) if isinstance(value, str) else repr(value)}"


def kept_setup(text: str | None) -> KeptSetup | None:
    """The setup in a comment; None where there is none, or somebody changed it to what is none."""
    if not text:
        return None
    try:
        return KeptSetup.model_validate_json(text)
    except ValidationError:
        return None

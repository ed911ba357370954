"""The options of `tumblecal capture`: dialogue and temperatures."""

from typing import Annotated

from cyclopts import Parameter

from tumblecal.cli.options import options, within


@options
class OperatorOptions:
    """Dialogue with the operator.

    Parameters
    ----------
    wait
        Seconds to wait for a port that is not available yet. Example: --wait 60.
    estimate
        Display of the parameters and their standard uncertainties after each position. Example: --no-estimate.
    plain
        Printed lines instead of a redrawn screen. Example: --plain.
    yes
        With --resume: confirmation that the instrument has not been remounted. Example: --resume run1 --yes.
    trust_instrument
        With --resume: confirmation that an instrument that does not state its serial number is the same one. Example:
        --resume run1 --trust-instrument.
    """

    wait: Annotated[float, within(gte=0, lte=86400)] = 30.0
    estimate: Annotated[bool, Parameter(negative="--no-estimate")] = True
    plain: bool = False
    yes: bool = False
    trust_instrument: bool = False

    def still_mounted(self) -> bool:
        """Whether the operator confirms that the instrument was not remounted."""
        asked = "Is the instrument still in its fixture, without a remount? [y/n] "
        return self.yes or input(asked).strip().lower().startswith("y")


@options
class ChamberOptions:
    """Temperatures of the plan; the default is the table [soak] or [chamber] of the plan. --resume keeps them.

    Parameters
    ----------
    chamber
        Port of the temperature chamber, with the commands of the plan; "operator": the operator sets it. Example: --chamber
        /dev/ttyUSB1.
    soak_tolerance
        Largest distance of the sensor's temperature to the requested one, degC. Example: --soak-tolerance 2.
    soak_rate
        Largest rate of a stable temperature, degC/min. Example: --soak-rate 0.05.
    soak_minutes
        Time for which the temperature must be stable, min. Example: --soak-minutes 20.
    soak_timeout
        Longest wait for a stable temperature, min. Example: --soak-timeout 300.
    """

    chamber: str | None = None
    soak_tolerance: float | None = None
    soak_rate: float | None = None
    soak_minutes: float | None = None
    soak_timeout: float | None = None

"""The pitch settings that were assumed, if the angles of the data do not state them."""

import numpy as np

from tumblecal.estimation.fit import Fit


# More settings than these with so few rows each are not commanded settings.
_MANY, _ROWS_EACH = 8, 3
_MOST_SHOWN = 8


def read_settings_words(fit: Fit) -> str:
    """The pitch settings that read pitch angles were assigned to; "" if no pitch angle was read."""
    data = fit.data
    called = data.pitch_setting_deg
    read = ~np.isclose(called, data.beta_deg, rtol=0.0, atol=1e-6)
    settings = np.unique(called[np.isin(called, called[read])])
    if not len(settings):
        return ""
    read_rows = np.isin(called, settings)
    angles, spread = (
        len(np.unique(data.beta_deg[read_rows])),
        max(np.ptp(data.beta_deg[called == one]) for one in settings),
    )
    shown = ", ".join(f"{one:g}" for one in settings[:_MOST_SHOWN]) + (", ..." if len(settings) > _MOST_SHOWN else "")
    return (
        f"pitch settings: beta_deg contains read angles, {angles} of them at {len(settings)} "
        f"setting{'s' if len(settings) > 1 else ''} ({shown} deg; range of one setting up to {spread:.2g} deg). Each position "
        "uses the angle that was read; each setting has one error dbeta."
    )


def many_settings_words(fit: Fit) -> str:
    """A warning that nearly every row has a separate pitch setting, with the remedy; "" otherwise."""
    errors = [leaf for leaf in fit.chain.free if leaf.name == "dbeta" and leaf.by and leaf.by.endswith("pitch")]
    count = sum(len(leaf.names) for leaf in errors)
    if count <= _MANY or count * _ROWS_EACH <= len(fit.data):
        return ""
    return (
        f"pitch settings: beta_deg contains {count} in {len(fit.data)} rows. Each has a separate error dbeta, so few degrees "
        "of freedom remain. If an encoder read the angles (more than half a degree from the setting), write the commanded "
        "angle; if its readings are exact, use --fix dbeta."
    )

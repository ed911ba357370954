"""What the pitch settings were taken to be, where the angles of the data do not say so by themselves."""

import numpy as np

from tumblecal.estimation.fit import Fit


# More settings than these, that share so few rows among them, are no settings that anybody commanded.
_MANY, _ROWS_EACH = 8, 3
_MOST_SHOWN = 8


def read_settings_words(fit: Fit) -> str:
    """That pitch angles were read and not commanded, and which settings they belong to; empty where none were."""
    data = fit.data
    called = data.pitch_setting_deg
    read = ~np.isclose(called, data.beta_deg, rtol=0.0, atol=1e-6)
    settings = np.unique(called[np.isin(called, called[read])])
    if not len(settings):
        return ""
    own = np.isin(called, settings)
    angles, spread = len(np.unique(data.beta_deg[own])), max(np.ptp(data.beta_deg[called == one]) for one in settings)
    shown = ", ".join(f"{one:g}" for one in settings[:_MOST_SHOWN]) + (", ..." if len(settings) > _MOST_SHOWN else "")
    return (
        f"pitch settings: beta_deg holds angles that were read, {angles} of them at {len(settings)} "
        f"setting{'s' if len(settings) > 1 else ''} ({shown} deg; {spread:.2g} deg apart at most). Each position counts at "
        "the angle that was read; each setting has one error dbeta."
    )


def many_settings_words(fit: Fit) -> str:
    """That nearly every row is a pitch setting of its own, and what to do; empty where that is not so."""
    errors = [leaf for leaf in fit.chain.free if leaf.name == "dbeta" and leaf.by and leaf.by.endswith("pitch")]
    count = sum(len(leaf.names) for leaf in errors)
    if count <= _MANY or count * _ROWS_EACH <= len(fit.data):
        return ""
    return (
        f"pitch settings: beta_deg holds {count} in {len(fit.data)} rows, each with an error dbeta of its own, which leaves "
        "little to judge the rest by. Where an encoder read them (scattering by more than half a degree about what was set), "
        "write the commanded angle; where its readings are exact, give --fix dbeta."
    )

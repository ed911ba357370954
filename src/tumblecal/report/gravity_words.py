"""The gravity that is one g in the results, and its effect on the scale factors if it is not stated."""

from tumblecal.estimation.fit import Fit
from tumblecal.ground.gravity import normal_gravity


def gravity_words(fit: Fit) -> str:
    """A line for the reader; "" for readings in g without a stated gravity."""
    warning, gravity = gravity_warning(fit), fit.data.gravity
    return f"WARNING: {warning}" if warning else f"one g is {gravity}" if gravity else ""


def gravity_warning(fit: Fit) -> str:
    """Effect of an assumed gravity on the scale factors; "" if it is stated, or if nothing depends on it."""
    gravity = fit.data.gravity
    if gravity is None or not gravity.assumed:
        return ""
    least, most = normal_gravity(0.0), normal_gravity(90.0)
    shift = max(gravity.value_ms2 / least - 1.0, 1.0 - gravity.value_ms2 / most)
    words = (
        f"the readings are in m/s^2 and no gravity is stated; {gravity.value_ms2:g} m/s^2 is assumed. The "
        f"gravity of your site ({least:.3f} to {most:.3f} at sea level) changes every dK by up to {shift * 1e3:.1f}e-3"
    )
    spread = [float(sd) for name, sd in zip(fit.names, fit.sd, strict=True) if name.startswith("dK") and sd > 0]
    in_u = f", {shift / min(spread):.0f} u" if spread else ""
    return f"{words}{in_u}. State it: --gravity 9.8123, or --gravity lat=48.14,height=520"

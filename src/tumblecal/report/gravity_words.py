"""Which gravity one g of the results is, and what it does to the scale factors where nobody said."""

from tumblecal.estimation.fit import Fit
from tumblecal.ground.gravity import normal_gravity


def gravity_words(fit: Fit) -> str:
    """A line for the reader; empty for readings in g whose file says nothing of gravity."""
    warning, gravity = gravity_warning(fit), fit.data.gravity
    return f"WARNING: {warning}" if warning else f"one g is {gravity}" if gravity else ""


def gravity_warning(fit: Fit) -> str:
    """What it does to the scale factors that nobody stated the gravity; empty where somebody did, or nothing depends on it."""
    gravity = fit.data.gravity
    if gravity is None or not gravity.assumed:
        return ""
    least, most = normal_gravity(0.0), normal_gravity(90.0)
    shift = max(gravity.value_ms2 / least - 1.0, 1.0 - gravity.value_ms2 / most)
    words = (
        f"the readings are in m/s^2 and no gravity is stated: {gravity.value_ms2:g} was taken. That of your site "
        f"({least:.3f} to {most:.3f} at sea level) moves every dK by up to {shift * 1e3:.1f}e-3"
    )
    spread = [float(sd) for name, sd in zip(fit.names, fit.sd, strict=True) if name.startswith("dK") and sd > 0]
    in_sd = f", {shift / min(spread):.0f} sd" if spread else ""
    return f"{words}{in_sd}: give --gravity 9.8123, or --gravity lat=48.14,height=520"

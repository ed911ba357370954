"""Which gravity one g of the results is, and what it does to the scale factors where nobody said."""

from tumblecal.estimation.fit import Fit
from tumblecal.ground.gravity import normal_gravity


def gravity_words(fit: Fit) -> str:
    """A line for the reader; empty for readings in g whose file says nothing of gravity."""
    gravity = fit.data.gravity
    if gravity is None:
        return ""
    if not gravity.assumed:
        return f"one g is {gravity}"
    least, most = normal_gravity(0.0), normal_gravity(90.0)
    shift = max(gravity.value_ms2 / least - 1.0, 1.0 - gravity.value_ms2 / most)
    words = (
        f"WARNING: the readings are in m/s^2 and no gravity is stated: {gravity.value_ms2:g} was taken. That of your site "
        f"({least:.3f} to {most:.3f} at sea level) moves every dK by up to {shift * 1e3:.1f}e-3"
    )
    spread = [float(sd) for name, sd in zip(fit.names, fit.sd, strict=True) if name.startswith("dK") and sd > 0]
    in_sd = f", {shift / min(spread):.0f} sd" if spread else ""
    return f"{words}{in_sd}: give --gravity 9.8123, or --gravity lat=48.14,height=520"

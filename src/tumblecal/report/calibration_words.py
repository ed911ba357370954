"""Names of `show.fit` for results that are not converted yet."""

from tumblecal.estimation.fit import Fit
from tumblecal.show.fit import TITLES as TITLES
from tumblecal.show.fit import fit_words


def sensor_values(fit: Fit) -> list[str]:
    """Block `values`."""
    return fit_words(fit).lines("values")


def gravity_warning(fit: Fit) -> str:
    """Block `gravity warning`."""
    return fit_words(fit).text("gravity warning")


def gravity_words(fit: Fit) -> str:
    """Block `gravity`."""
    return fit_words(fit).text("gravity")


def read_settings_words(fit: Fit) -> str:
    """Block `read settings` with its heading."""
    text = fit_words(fit).text("read settings")
    return f"pitch settings: {text}" if text else ""


def many_settings_words(fit: Fit) -> str:
    """Block `many settings`."""
    return fit_words(fit).text("many settings")

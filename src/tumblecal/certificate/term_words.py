"""The nonlinear, thermal and drift terms of a calibration in words, each with its standard uncertainty."""

from collections.abc import Iterator

from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_terms import Term
from tumblecal.ground.axes import AXES
from tumblecal.ground.numbers_shown import rounded_together


_SENSOR = 12


def term_words(calibration: Calibration) -> Iterator[str]:
    """`A_z: (0.532 +- 0.062) mg/g^2 u_z^2 (second_order.z)`, a line for each term; +- is the standard uncertainty, where the
    file has it."""
    covariance = (calibration.extra.get("covariance_with_terms") or {}).get("covariance") or []
    for k, term in enumerate(calibration.terms, _SENSOR):
        size = f"{1e3 * term.coefficient:.4g}"
        if k < len(covariance) and covariance[k][k] > 0:
            size = f"({rounded_together(1e3 * term.coefficient, 1e3 * covariance[k][k] ** 0.5)})"
        shared = "" if term.determined else ", determined only together with other parameters"
        named = f" ({term.effect}{shared})" if term.effect else ""
        yield f"A_{term.axis}: {size} {_unit(term)}{''.join(f' {factor}' for factor in _factors(term))}{named}"


def _power(base: str, power: int) -> str:
    return base if power == 1 else f"{base}^{power}"


def _unit(term: Term) -> str:
    """Unit of the coefficient: mg for each factor of the term."""
    order = sum(term.powers) if term.kind != "sign" else 0
    parts = [_power("g", order)] if order else []
    parts += [_power("degC", term.degc_power)] if term.degc_power else []
    return "/".join(["mg", *parts, *(["h"] if term.per_hour else [])])


def _factors(term: Term) -> Iterator[str]:
    inputs = " ".join(_power(f"u_{axis}", power) for axis, power in zip(AXES, term.powers, strict=True) if power)
    if inputs:
        yield {"product": inputs, "abs": f"|{inputs}|", "sign": f"sign({inputs})"}[term.kind]
    if term.degc_power:
        yield _power(f"(T - {term.reference_degc:g} degC)", term.degc_power)
    if term.per_hour:
        yield f"(t - {term.reference_s:g} s)"

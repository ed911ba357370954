"""What calibrate or diagnose said of a calibration, as far as a certificate must say it too, or must not be made."""

from pathlib import Path

from tumblecal.data.calibration import Calibration
from tumblecal.ground.errors import InputError
from tumblecal.ground.json_file import read_json_object


_FILES = ("result.json", "diagnosis.json")
_WAY_OUT = (
    "mend the measurement, or what is stated of it (what is usual of such items: [usual] in a rig; priors; the head), and "
    "calibrate again"
)


def reservation(folder: Path, calibration: Calibration, *, use_anyway: bool = False) -> str:
    """What speaks against the calibration of a folder, in words for its certificate; "" where nothing does.

    **Arguments:**

    - `use_anyway`: of values that are not to be used as well.

    **Raises:** `InputError` for values that are not to be used: what certifies them would mislead who relies on it. And for
    a judgement of other data.
    """
    calibration.use.require(folder / "calibration.json", anyway=use_anyway)
    path = folder / _FILES["verdict" in calibration.provenance]
    if not path.exists():
        return ""
    content = read_json_object(path)
    source, own = content.get("source"), calibration.provenance.get("sha256")
    if isinstance(source, dict) and own and source.get("sha256") not in (None, own):
        raise InputError(f"{path}: of other data than calibration.json beside it; calibrate again")
    judged, implausible = content.get("judgement"), content.get("implausible")
    judged = judged if isinstance(judged, dict) and judged.get("tone") != "good" else {}
    headline = str(judged.get("headline", ""))
    if not use_anyway and isinstance(implausible, list) and implausible:
        named = ", ".join(str(own.get("parameter")) for own in implausible if isinstance(own, dict))
        raise InputError(
            f"{path}: implausible: {named}: no certificate is made of a calibration that needs what no instrument has; "
            f"{_WAY_OUT}"
        )
    if judged.get("refused") and not use_anyway:
        raise InputError(f"{path}: judgement: {headline} No certificate is made of it; {judged.get('advice')}")
    use = calibration.use
    limited = use.answer in ("only", "no") or use.size_g is not None
    said = [f"Judgement of the calibration: {headline}"] if headline else []
    return " ".join([*said, *([f"Use of the calibration: {use.words}."] if limited else [])])


def head_covariance(calibration: Calibration) -> bool:
    """Whether the covariance of a measured head's errors is in that of the calibration."""
    head = calibration.provenance.get("head")
    return isinstance(head, dict) and not head.get("exact")


def head_words(calibration: Calibration) -> str:
    """What was taken of a measured head, in words; "" where nothing was."""
    head = calibration.provenance.get("head")
    if not isinstance(head, dict):
        return ""
    names = ", ".join(map(str, head.get("parameters") or []))
    file = f" ({head['file']}, SHA-256 {head.get('sha256')})" if head.get("file") else ""
    counted = (
        "with the covariance that is stated of them" if head_covariance(calibration) else "at their values, as exact"
    )
    return f"measured errors of the dividing head{file} went into the fit, {counted}: {names}"

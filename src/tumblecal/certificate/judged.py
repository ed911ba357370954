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


def reservation(folder: Path, calibration: Calibration) -> str:
    """What speaks against the calibration of a folder, in words for its certificate; "" where nothing does.

    **Raises:** `InputError` for values that are not to be used: what certifies them would mislead who relies on it. And for
    a judgement of other data.
    """
    path = folder / _FILES["verdict" in calibration.provenance]
    if not path.exists():
        return ""
    content = read_json_object(path)
    source, own = content.get("source"), calibration.provenance.get("sha256")
    if isinstance(source, dict) and own and source.get("sha256") not in (None, own):
        raise InputError(f"{path}: of other data than calibration.json beside it; calibrate again")
    implausible = content.get("implausible")
    if isinstance(implausible, list) and implausible:
        named = ", ".join(str(own.get("parameter")) for own in implausible if isinstance(own, dict))
        raise InputError(
            f"{path}: implausible: {named}: no certificate is made of a calibration that needs what no instrument has; "
            f"{_WAY_OUT}"
        )
    judged = content.get("judgement")
    if not isinstance(judged, dict) or judged.get("tone") == "good":
        return ""
    headline = str(judged.get("headline"))
    if judged.get("refused"):
        raise InputError(f"{path}: judgement: {headline} No certificate is made of it; {judged.get('advice')}")
    return f"Judgement of the calibration: {headline}"


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

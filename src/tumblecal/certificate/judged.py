"""Judgements of calibrate or diagnose that a certificate must include, or that prevent a certificate."""

from pathlib import Path

from tumblecal.data.calibration import Calibration
from tumblecal.ground.errors import InputError
from tumblecal.ground.json_file import read_json_object


_FILES = ("result.json", "diagnosis.json")
_REMEDY = (
    "correct the measurement, or the statements on it (usual sizes: [usual] in a rig; priors; the head), and calibrate "
    "again"
)


def reservation(folder: Path, calibration: Calibration, *, use_anyway: bool = False) -> str:
    """Reservations about the calibration of a folder, in words for its certificate; "" if there are none.

    **Arguments:**

    - `use_anyway`: whether to accept values that must not be used.

    **Raises:** `InputError` for values that must not be used, because a certificate would mislead its users; and for a
    judgement of different data.
    """
    calibration.use.require(folder / "calibration.json", anyway=use_anyway)
    path = folder / _FILES["verdict" in calibration.provenance]
    if not path.exists():
        return ""
    content = read_json_object(path)
    source, digest = content.get("source"), calibration.provenance.get("sha256")
    if isinstance(source, dict) and digest and source.get("sha256") not in (None, digest):
        raise InputError(f"{path}: its data differ from those of calibration.json in this folder; calibrate again")
    judged, implausible = content.get("judgement"), content.get("implausible")
    judged = judged if isinstance(judged, dict) and judged.get("tone") != "good" else {}
    headline = str(judged.get("headline", ""))
    if not use_anyway and isinstance(implausible, list) and implausible:
        named = ", ".join(str(listed.get("parameter")) for listed in implausible if isinstance(listed, dict))
        raise InputError(
            f"{path}: implausible: {named}: no certificate for a calibration with values far outside the usual range; "
            f"{_REMEDY}"
        )
    if judged.get("refused") and not use_anyway:
        raise InputError(f"{path}: judgement: {headline} No certificate is written; {judged.get('advice')}")
    use = calibration.use
    limited = use.answer in ("only", "no") or use.size_g is not None
    words = [f"Judgement of the calibration: {headline}"] if headline else []
    return " ".join([*words, *([f"Use of the calibration: {use.words}."] if limited else [])])


def head_covariance(calibration: Calibration) -> bool:
    """Whether the covariance of the calibration includes that of the measured errors of the head."""
    head = calibration.provenance.get("head")
    return isinstance(head, dict) and not head.get("exact")


def head_words(calibration: Calibration) -> str:
    """The measured errors of the head in the fit, in words; "" if there are none."""
    head = calibration.provenance.get("head")
    if not isinstance(head, dict):
        return ""
    names = ", ".join(map(str, head.get("parameters") or []))
    file = f" ({head['file']}, SHA-256 {head.get('sha256')})" if head.get("file") else ""
    treatment = "with their stated covariance" if head_covariance(calibration) else "treated as exact"
    return f"the fit includes measured errors of the dividing head{file}, {treatment}: {names}"

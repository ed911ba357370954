"""A finished chunk of a study: arrays, what made them, and a checksum over both.

The bytes are those of an `.npz` file whose zip comment is the SHA-256 of all bytes before it. Workers send them and
files contain them, so that `unpacked` checks all data before they are summed.
"""

import hashlib
import io
import json
import platform
from collections.abc import Mapping
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np


COMPUTING = ("jax", "jaxlib", "numpy", "scipy", "optimistix")
# Instruction sets between which compiled programs differ in the last digit.
INSTRUCTIONS = ("fma", "avx2", "avx512f")
TABLES = ("kind", "study", "rig", "effects")
_DIGEST = 64


class NotThisChunk(ValueError):
    """Bytes that are not the chunk wanted; the text says why."""


@lru_cache
def maker() -> dict[str, Any]:
    """The properties of this process that determine the bits of its chunks: `versions` by name, `device`.

    The version of tumblecal includes a digest of its files: a changed working copy is another version.
    """
    import tumblecal

    package = Path(tumblecal.__file__).parent
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*")):
        if path.is_file() and path.suffix not in (".pyc", ".pyo"):
            digest.update(f"{path.relative_to(package)}\0{path.stat().st_size}\0".encode() + path.read_bytes())
    package_version = f"{version('tumblecal')}+{digest.hexdigest()[:12]}"
    return {
        "versions": {"tumblecal": package_version} | {name: version(name) for name in COMPUTING},
        "device": _device(),
    }


def _device() -> str:
    """The device; for a processor, the properties on which its last digits depend."""
    import jax

    device = jax.devices()[0]
    if device.platform != "cpu":
        return device.device_kind
    try:
        known = Path("/proc/cpuinfo").read_text(encoding="utf-8").split()
        names = [path.read_text().strip() for path in Path("/proc/self/task").glob("*/comm")]
    except OSError:
        return f"cpu, {platform.machine()}"
    threads = names.count("tf_XLAEigen")
    instructions = [name for name in INSTRUCTIONS if name in known]
    return " ".join(["cpu,", platform.machine(), *instructions]) + f", {threads} thread{'s' if threads != 1 else ''}"


def tables_of(study: Mapping[str, Any]) -> dict[str, Any]:
    """The part of the tables from `read_study` that determines the bits."""
    tables = {name: study[name] for name in TABLES if name in study}
    if "effects" in study:
        tables["effects"] = [entry["text"] for entry in study["effects"]]
    return tables


def study_hash(study: Mapping[str, Any]) -> str:
    """Digest of the tables."""
    return hashlib.sha256(json.dumps(tables_of(study), sort_keys=True).encode()).hexdigest()


def statement(study: str, chunk: int) -> dict[str, Any]:
    """The statement of a chunk made here; `study` from `study_hash`."""
    return {"schema": "tumblecal.chunk/1", "study": study, "chunk": chunk, **maker()}


def differences(stated: Mapping[str, Any], wanted: Mapping[str, Any]) -> list[str]:
    """Differences of study, chunk, versions and device between a statement and the wanted one, in words."""
    versions = stated.get("versions")
    versions = versions if isinstance(versions, Mapping) else {}
    different = [
        f"{name} {versions.get(name, 'of no stated version')} against {expected}"
        for name, expected in wanted["versions"].items()
        if versions.get(name) != expected
    ]
    if stated.get("device") != wanted["device"]:
        different.append(f"device {stated.get('device', 'not stated')} against {wanted['device']}")
    if stated.get("study") != wanted.get("study"):
        different.append("different study or seed")
    if stated.get("chunk") != wanted.get("chunk"):
        different.append(f"chunk {stated.get('chunk')} against {wanted.get('chunk')}")
    return different


def packed(states: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> bytes:
    """The bytes of a chunk."""
    file = io.BytesIO()
    text = np.frombuffer(json.dumps(states, sort_keys=True).encode(), np.uint8)
    np.savez(file, allow_pickle=False, statement=text, **arrays)
    # A zip file ends with the length of its comment.
    body = file.getvalue()[:-2] + _DIGEST.to_bytes(2, "little")
    return body + hashlib.sha256(body).hexdigest().encode()


def unpacked(content: bytes, wanted: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """The arrays of the chunk that states what is `wanted`.

    **Raises:** `NotThisChunk` if the bytes are damaged, or belong to another chunk.
    """
    body, digest = content[:-_DIGEST], content[-_DIGEST:]
    if hashlib.sha256(body).hexdigest().encode() != digest:
        raise NotThisChunk("its checksum does not fit")
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as file:
            arrays = dict(file)
        stated = json.loads(arrays.pop("statement").tobytes())
    except (BadZipFile, EOFError, KeyError, OSError, ValueError) as error:
        raise NotThisChunk("it is not a chunk") from error
    if different := differences(stated, wanted):
        raise NotThisChunk(", ".join(different))
    return arrays

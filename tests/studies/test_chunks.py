"""Chunks: what does not verify is computed again and told, and never summed up."""

import importlib
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest

from tumblecal.ground.errors import InputError
from tumblecal.ground.record import ResultRecord
from tumblecal.studies.chunk import NotThisChunk, packed, statement, study_hash
from tumblecal.studies.run import run
from tumblecal.studies.store import Store
from tumblecal.studies.study_tables import read_study
from tumblecal.studies.verification import check_counts


class SquaresResult(ResultRecord):
    sum: float


class Squares:
    """A study of three chunks whose numbers follow from its seed."""

    chunks, trials, chunk_bytes, seconds = 3, 3, 100, 0.0

    def __init__(self, tables):
        self._seed, self.computed = tables["study"].get("seed", 0), []

    def trials_of(self, chunk):
        return 1

    def compute(self, chunk):
        self.computed.append(chunk)
        return {"square": np.array([float(self._seed + chunk) ** 2]), "trials": np.array(1.0)}

    def trials_in(self, arrays):
        return arrays["trials"]

    def summary(self, chunks):
        return SquaresResult(sum=float(sum(chunk["square"][0] for chunk in chunks))), {"none": pl.DataFrame({"a": [0]})}


@pytest.fixture
def tables(configs):
    return lambda seed=1: read_study(configs / "study_coverage.toml", "coverage", {"seed": seed})


def outcome(tables, folder: Path):
    """Sum, chunks computed, lines told."""
    study, told = Squares(tables), []
    content, _ = run(tables, folder, study=study, tell=told.append)
    return content["sum"], study.computed, told


def delivered(tables, chunk: int, worker: str, factors=(1.0, 1.0)):
    """A chunk as a worker sends it, its square and its number of trials falsified by factors."""
    arrays = Squares(tables).compute(chunk)
    arrays = {name: part * factor for (name, part), factor in zip(arrays.items(), factors, strict=True)}
    return chunk, packed(statement(study_hash(tables), chunk), arrays), worker


def chunk_path(folder: Path, chunk: int) -> Path:
    return folder / "chunks" / f"{chunk:08d}.npz"


def test_flipped_bits_and_cuts_are_noticed(tmp_path, tables):
    assert outcome(tables(), tmp_path) == (14.0, [0, 1, 2], [])
    path = chunk_path(tmp_path, 1)
    whole = path.read_bytes()
    store = Store(tmp_path, tables(), 3)
    told = []
    places = range(0, len(whole), 3)
    for place in places:
        flipped = bytearray(whole)
        flipped[place] ^= 1 << place % 8
        path.write_bytes(flipped if place % 2 else whole[:place])
        assert store.missing(told.append) == [1], place
    assert len(told) == len(places)
    assert set(told) == {f"{path}: not used, computed again: its checksum does not fit"}
    store.close()
    assert outcome(tables(), tmp_path) == (14.0, [1], told[:1]) and path.read_bytes() == whole


def test_chunks_of_another_seed_are_not_used_when_the_manifest_is_gone(tmp_path, tables):
    outcome(tables(1), tmp_path)
    (tmp_path / "manifest.json").unlink()
    total, computed, told = outcome(tables(2), tmp_path)
    assert (total, computed) == (29.0, [0, 1, 2])
    assert told == [f"{chunk_path(tmp_path, 0)} and 2 more: not used, computed again: different study or seed"]
    (tmp_path / "manifest.json").unlink()
    assert outcome(tables(2), tmp_path) == (29.0, [], [])


def test_a_folder_of_another_study_says_what_differs_and_nothing_else(tmp_path, tables):
    outcome(tables(1), tmp_path)
    with pytest.raises(InputError, match=r"contains another study \(different: study.seed 1 against 2\)"):
        outcome(tables(2), tmp_path)
    manifest = tmp_path / "manifest.json"
    content = json.loads(manifest.read_text(encoding="utf-8"))
    content["identity"]["versions"]["jax"] = "0.0.1"
    manifest.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(InputError, match=r"\(different: jax 0\.0\.1 against [\d.]+\)"):
        outcome(tables(1), tmp_path)
    manifest.write_text("[1]")
    with pytest.raises(InputError, match="remove this file"):
        outcome(tables(1), tmp_path)


@pytest.mark.parametrize("part", ["tumblecal", "device"])
def test_a_chunk_of_another_version_or_device_is_named_and_not_used(tmp_path, tables, part):
    """Nor is one in the place of another."""
    outcome(tables(), tmp_path)
    chunk_path(tmp_path, 0).write_bytes(chunk_path(tmp_path, 1).read_bytes())
    total, computed, (told,) = outcome(tables(), tmp_path)
    assert (total, computed) == (14.0, [0]) and "chunk 1 against 0" in told
    states = statement(study_hash(tables()), 1)
    own = states["device"] if part == "device" else states["versions"][part]
    foreign = {"device": "abacus"} if part == "device" else {"versions": states["versions"] | {part: "abacus"}}
    chunk_path(tmp_path, 1).write_bytes(packed(states | foreign, {"square": np.array([100.0])}))
    total, computed, (told,) = outcome(tables(), tmp_path)
    assert (total, computed) == (14.0, [1]) and f"{part} abacus against {own}" in told


def test_a_chunk_changed_after_it_was_checked_stops_the_study(tmp_path, tables):
    outcome(tables(), tmp_path)
    store = Store(tmp_path, tables(), 3)
    assert store.missing() == []
    chunk_path(tmp_path, 1).write_bytes(b"")
    with pytest.raises(InputError, match="its checksum does not fit"):
        list(store.all())
    store.close()


def test_a_worker_of_which_one_chunk_is_wrong_is_named_and_all_its_chunks_are_removed(tmp_path, tables):
    """Its counts are right and its sums 1.5 times too large; the chunk of the other worker stays."""

    def computed(missing, /, check, tell):
        yield delivered(tables(), 0, "good")
        for chunk in missing[1:]:
            yield delivered(tables(), chunk, "bad", (1.5, 1.0))

    with pytest.raises(
        InputError, match=r"worker bad: chunk \d, computed again in this process, .*\(square\); 2 chunks of"
    ):
        run(tables(), tmp_path, study=Squares(tables()), computed=computed)
    assert [path.name for path in (tmp_path / "chunks").glob("*.npz")] == ["00000000.npz"]
    assert not (tmp_path / "coverage.json").exists()
    total, again, told = outcome(tables(), tmp_path)
    # The two removed, and then the one of the worker that was not yet verified.
    assert (total, again, told) == (14.0, [1, 2, 0], [])


def test_every_kind_of_study_counts_its_trials(configs):
    """The arrays are made by hand: what each kind keeps of so many trials."""
    for kind, arrays in {
        "coverage": {"trials": np.array(1000.0)},
        "sweep": {"trials": np.array(1000.0)},
        "power": {"counts": np.array([1000.0, 5.0, 5.0, 5.0, 2.0])},
        "linearization": {"count": np.array([1000.0, 990.0])},
        "convergence": {"settled": np.zeros((2, 3, 15, 20), np.int32), "count": np.full((50, 2), 20.0)},
    }.items():
        name = kind.capitalize()
        study = object.__new__(getattr(importlib.import_module(f"tumblecal.studies.{kind}"), name))
        study.table = SimpleNamespace(data_sets=50)
        assert study.trials_in(arrays) == 1000.0, kind
        study.trials_of = lambda chunk: 1000
        check_counts(study, 0, arrays)
        with pytest.raises(NotThisChunk, match="it counts 1500 trials, 1000 were requested"):
            check_counts(study, 0, {name: part if part.ndim > 3 else 1.5 * part for name, part in arrays.items()})
        with pytest.raises(NotThisChunk, match="does not count"):
            check_counts(study, 0, {})

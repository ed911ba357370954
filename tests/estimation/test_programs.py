"""Programs kept on disk: a second process loads them, gives the same bits, and survives every damage to them."""

import os
import random
import subprocess
import sys

import numpy as np
import pytest

from tumblecal.chain import nominal_chain, settings
from tumblecal.chain.plan import grid
from tumblecal.effects import catalogue
from tumblecal.estimation.programs import cached_program
from tumblecal.ground.program_cache import ProgramCache


# Says how many programs were compiled, then the estimate to the last bit. Threads of the linear algebra would wait in vain.
SCRIPT = """
from tumblecal.cli.start import start
start()
from tumblecal.ground import program_cache
stored = []
put = program_cache.ProgramCache.put
program_cache.ProgramCache.put = lambda *arguments: (stored.append(1), put(*arguments))[1]
from tumblecal.data import paper
from tumblecal.estimation import exact, problem_of
data = paper.table1()
result = exact.fit(problem_of(data))
from threadpoolctl import threadpool_info
assert {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"} == {1}
print(len(stored), result.code.name, result.values.tobytes().hex(), result.covariance.tobytes().hex())
"""


def run_in(folder):
    """Number of stored programs and the estimate of a process that keeps its programs in a folder; it must say nothing."""
    environment = {name: value for name, value in os.environ.items() if name != "OMP_NUM_THREADS"}
    environment |= {"TUMBLECAL_CACHE": str(folder)}
    done = subprocess.run([sys.executable, "-c", SCRIPT], env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0 and done.stderr == "", done.stderr
    stored, *estimate = done.stdout.split()
    return int(stored), estimate


@pytest.fixture(scope="module")
def filled(tmp_path_factory):
    """A folder that a process has filled, the number of its programs and its estimate; each test leaves it good again."""
    folder = tmp_path_factory.mktemp("cache")
    return folder, *run_in(folder)


def damaged(content: bytes, chance: random.Random) -> bytes:
    """One bit flipped, the end cut off, or nothing left."""
    kind = chance.choice(["flip", "flip", "flip", "cut", "empty"])
    if kind == "cut":
        return content[: chance.randrange(len(content))]
    if kind == "empty":
        return b""
    place = chance.randrange(len(content))
    return content[:place] + bytes([content[place] ^ (1 << chance.randrange(8))]) + content[place + 1 :]


@pytest.mark.long
def test_second_process_compiles_nothing_and_damaged_entries_are_made_again(filled, table1_fit):
    cache, stored, first = filled
    folder = cache / "programs"
    whole = {path: path.read_bytes() for path in folder.iterdir()}
    assert stored == len(whole) >= 1
    assert run_in(cache) == (0, first)
    assert {path: path.read_bytes() for path in folder.iterdir()} == whole
    values = np.frombuffer(bytes.fromhex(first[1]))
    np.testing.assert_allclose(values, table1_fit.values, rtol=0, atol=1e-15)

    chance = random.Random(20160319)
    for path, content in whole.items():
        place = chance.randrange(len(content) // 2, len(content))
        path.write_bytes(content[:place] + bytes([content[place] ^ 16]) + content[place + 1 :])
    assert run_in(cache) == (stored, first)
    assert run_in(cache) == (0, first)


def test_an_entry_is_whole_and_of_its_name_or_none(tmp_path):
    cache, chance = ProgramCache(tmp_path), random.Random(1)
    payload = chance.randbytes(3000)
    cache.put("a", payload)
    content = (tmp_path / "a").read_bytes()
    for _ in range(500):
        (tmp_path / "a").write_bytes(damaged(content, chance))
        assert cache.get("a") is None and not (tmp_path / "a").exists()
    (tmp_path / "b").write_bytes(content)
    assert cache.get("b") is None
    cache.put("a", b"older")
    cache.put("a", payload)
    assert cache.get("a") == payload


@pytest.mark.long
def test_programs_of_many_kinds_of_files_do_not_stay():
    """A row of files of as many lengths, in one process: each length is another program, of 5 to 20 MB."""
    import jax

    client = jax.devices()[0].client
    before = len(client.live_executables())
    program, own = cached_program(lambda x: 2.0 * x), cached_program(lambda x: 3.0 * x, 3.0)
    for rows in range(1, 61):
        for factor, of in ((2.0, program), (3.0, own)):
            np.testing.assert_array_equal(of(np.ones(rows)), np.full(rows, factor))
    assert 2 <= len(client.live_executables()) - before <= 48


def test_equal_chains_share_their_programs_and_others_never_get_them():
    def chain_with(power):
        return nominal_chain(where) + catalogue()[f"{power}_order.z"].make(None)[0]

    def program(chain):
        return cached_program(lambda where, vector: chain.at(vector)(where), chain)

    plan = grid(np.arange(0.0, 360.0, 90.0), [0.0, 45.0, 90.0])
    where = settings(plan.alpha, plan.beta)
    second = chain_with("second")
    assert program(second) is program(chain_with("second"))
    vector = second.vector + 1e-3 * np.cos(np.arange(len(second.names)))
    readings = np.asarray(program(second)(where, vector))
    np.testing.assert_allclose(readings, np.asarray(second.at(vector)(where)), rtol=0, atol=1e-14)
    assert not np.array_equal(program(chain_with("third"))(where, vector), readings)

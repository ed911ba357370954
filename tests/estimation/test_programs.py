"""Programs kept on disk: a second process loads them, gives the same bits, and survives a spoilt cache."""

import os
import subprocess
import sys

import pytest


# Says how many programs were exported, then the estimate to the last bit.
SCRIPT = """
from jax import export
exports = []
real = export.export
export.export = lambda *args, **kwargs: (exports.append(1), real(*args, **kwargs))[1]
from tumblecal.cli.start import start
start()
from tumblecal.data import paper
from tumblecal.estimation import exact, problem_of
data = paper.table1()
result = exact.fit(problem_of(data))
print(len(exports), result.code.name, result.values.tobytes().hex(), result.covariance.tobytes().hex())
"""


@pytest.fixture(scope="module")
def process(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cache")

    def run():
        environment = os.environ | {"TUMBLECAL_CACHE": str(folder)}
        done = subprocess.run(
            [sys.executable, "-c", SCRIPT], env=environment, capture_output=True, text=True, timeout=120, check=True
        )
        exports, *estimate = done.stdout.split()
        return int(exports), estimate

    return folder, run


def test_second_process_exports_nothing_and_gives_the_same_bits(process, table1_fit):
    folder, run = process
    exports, first = run()
    kept = sorted(folder.glob("tumblecal-*.stablehlo"))
    assert exports == len(kept) >= 1
    stamps = [path.stat().st_mtime_ns for path in kept]
    exports, second = run()
    assert exports == 0 and second == first
    assert [path.stat().st_mtime_ns for path in sorted(folder.glob("tumblecal-*.stablehlo"))] == stamps
    import numpy as np

    values = np.frombuffer(bytes.fromhex(first[1]))
    np.testing.assert_allclose(values, table1_fit.values, rtol=0, atol=1e-15)

    for path in folder.iterdir():
        if path.is_file():
            path.write_bytes(path.read_bytes()[:100] + b"spoilt")
    _, third = run()
    assert third == first

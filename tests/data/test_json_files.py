"""Files that the program wrote and reads again: each fault is one line with the file, the key and the remedy."""

import copy
import json
import math

import numpy as np
import pytest

from tumblecal import InputError
from tumblecal.data.budget_result import read_budget
from tumblecal.data.calibration import read_calibration
from tumblecal.data.result_records import REMEDY, DiagnosisFile, ResultFile
from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.ground.strict_json import read_record


CALIBRATION = {
    "schema": "tumblecal.calibration/1",
    "matrix": np.eye(3).tolist(),
    "bias": [0, 0.0, 0.0],
    "covariance": np.eye(12).tolist(),
    "provenance": {"dof": None, "sha256": None, "of a later version": [1]},
}
BUDGET = {
    "schema": "tumblecal.budget_result/1",
    "source": {"data": "a.csv", "sha256": "00"},
    "level": 0.95,
    "inputs": {"gravity": {"what": "gravity_value"}, "floor": {"dof": 20.0}},
    "parameters": {
        name: {"value": 0.0, "u_type_a": 1e-5, "contributions": {"gravity": 1e-6, "floor": 2e-6}, "k": 2.0}
        for name in SENSOR
    },
    "type_b_covariance": (1e-12 * np.eye(9)).tolist(),
}
RESULT = {
    "schema": "tumblecal.result/1",
    "source": {"data": "a.csv", "sha256": "00"},
    "methods": {"exact": {"code": "CONVERGED_BY_FALLBACK"}},
    "noise": {"rms_g": 1e-4, "chi2_p_value": None},
    "implausible": [{"parameter": "bias_x"}],
}
DIAGNOSIS = {
    "schema": "tumblecal.diagnosis/1",
    "source": "a.csv",
    "verdict": "identified",
    "causes": ["second_order.x", "bias_drift.y"],
    "sigma_g": 1e-4,
    "detection": {"p_value": 0.01},
}
READERS = {
    "calibration": (CALIBRATION, read_calibration),
    "budget": (BUDGET, read_budget),
    "result": (RESULT, lambda path: read_record(path, ResultFile, REMEDY)),
    "diagnosis": (DIAGNOSIS, lambda path: read_record(path, DiagnosisFile, REMEDY)),
}
MISSING = object()


def test_good_files_are_read(tmp_path):
    read = {}
    for name, (content, reader) in READERS.items():
        (tmp_path / name).write_text(json.dumps(content))
        read[name] = reader(tmp_path / name)
    assert math.isinf(read["calibration"].dof) and read["calibration"].provenance == CALIBRATION["provenance"]
    assert read["budget"].dof.tolist() == [math.inf, 20.0] and read["budget"].sha256 == "00"
    np.testing.assert_array_equal(read["budget"].contributions, np.outer([1e-6, 2e-6], np.ones(9)))
    assert (read["result"].source, read["result"].outcome) == ("a.csv", "converged by fallback")
    assert (read["diagnosis"].sha256, read["diagnosis"].outcome) == (None, "identified: second_order.x, bias_drift.y")


@pytest.mark.parametrize(
    ("name", "keys", "value", "words"),
    [
        ("calibration", ("covariance",), MISSING, ": covariance: is missing; add it"),
        ("calibration", ("covariance", 11), [0.0] * 11, ": covariance.11: must have 12 or more entries, not 11"),
        ("calibration", ("covariance", 0, 0), -1e-3, ": covariance: no variance of a covariance may be negative; use"),
        ("calibration", ("provenance", "dof"), 0.5, ": provenance.dof: must be 1 or more (got 0.5)"),
        (
            "calibration",
            ("provenance", "losses"),
            [{"effect": "a", "reason": 1}],
            ": provenance.losses.0.reason: must be a",
        ),
        ("budget", ("schema",), MISSING, ": schema is None, not 'tumblecal.budget_result/1'; make a budget with"),
        ("budget", ("inputs", "floor", "dof"), 0.4, ": inputs.floor.dof: must be 0.5 or more (got 0.4)"),
        ("budget", ("parameters", "dK_x"), MISSING, ": parameters: dK_x missing; make a budget of a whole sensor"),
        (
            "budget",
            ("parameters", "bias_z", "k"),
            1.0,
            ": parameters.bias_z.k: 1 is no coverage factor at a probability",
        ),
        ("budget", ("parameters", "dK_x", "value"), "0", ": parameters.dK_x.value: must be a number (got '0')"),
        ("budget", ("level",), 95, ": level: must be below 1 (got 95)"),
        (
            "budget",
            ("type_b_covariance", 0, 0),
            -1.0,
            ": type_b_covariance: no variance of a covariance may be negative",
        ),
        ("budget", ("type_b_covariance", 8), MISSING, ": type_b_covariance: a covariance must be symmetric"),
        ("result", ("noise", "rms_g"), [1], ": noise.rms_g: must be a number (got [1])"),
    ],
)
def test_a_fault_is_one_line_with_file_key_and_remedy(tmp_path, name, keys, value, words):
    content, reader = READERS[name]
    table = content = copy.deepcopy(content)
    for key in keys[:-1]:
        table = table[key]
    if value is MISSING:
        del table[keys[-1]]
    else:
        table[keys[-1]] = value
    path = tmp_path / f"{name}.json"
    path.write_text(json.dumps(content))
    with pytest.raises(InputError) as caught:
        reader(path)
    (fault,) = caught.value.faults
    assert fault.startswith(f"{path}{words}")

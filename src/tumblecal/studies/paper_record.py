"""The record of the study of the paper, `study.json`."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tumblecal.data import paper
from tumblecal.studies.paper_audit import Audit
from tumblecal.studies.paper_study import PaperStudy


def paper_record(study: PaperStudy, audit: Audit, table1: Mapping[str, Any], findings: Sequence[str]) -> dict[str, Any]:
    """The study in numbers; `table1`: the record of its calibration."""
    estimates = {"running_mean": study.mean, "kalman": study.kalman, "kalman_diffuse": study.diffuse}
    estimates["exact"] = study.exact_mean
    scatter = np.std(study.exact, axis=0, ddof=1)
    noise = audit.noise
    return {
        "schema": "tumblecal.reproduction/1",
        "findings": findings,
        "simulation": {
            "seed": study.seed,
            "sets": len(study.single),
            "parameters": {
                name: {
                    "unit": study.units[k],
                    "truth": study.truth[k],
                    "single_sd": study.single_sd[k],
                    "final": {method: each[-1, k] for method, each in estimates.items()},
                    "scatter_of_single_exact_fits": scatter[k],
                }
                for k, name in enumerate(study.names)
            },
            "diffuse_kalman_less_running_mean_max_sd": study.kalman_is_running_mean,
            "rms_error_in_sd_after_sets": {name: list(values) for name, values in study.early_error.items()},
        },
        "table1": table1,
        "table2": {name: list(values) for name, values in paper.table2().items()},
        "table3_g": {name: list(values) for name, values in paper.table3().items()},
        "audit": {
            "explanations": [
                {
                    "parameters": one.name,
                    "f": one.f,
                    "dof": one.dof,
                    "p_value": one.p_value,
                    "largest_residual_g": one.largest_g,
                    "smallest_residual_g": one.smallest_g,
                }
                for one in audit.explanations
            ],
            "noise": {
                "observed_g": noise.observed_g,
                "dof": noise.dof,
                "implied_white_beyond_100s_g": noise.white_g,
                "implied_floor_g": noise.flicker_g,
                "p_value": noise.p_value,
            },
            "units": {"mean_norm": audit.norm_g, "mean_norm_if_ms2_g": audit.norm_if_ms2_g},
        },
    }

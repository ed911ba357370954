"""The population `chance`: how often noise alone looks like several causes together, relative to Ville's bound.

    python benchmarks/blind chance --draws 3000

Noise of unknown size at 3 x 4 and 3 x 8 positions. The test for several causes uses `SEVERAL_SHARE` of the bound as its
p-value.
"""

import argparse
from collections.abc import Sequence

import numpy as np

from blind.catalogue import Bench, hidden, nothing
from tumblecal.diagnosis.evidence import log_evidence_of_noise
from tumblecal.diagnosis.priors import SEVERAL_SHARE
from tumblecal.diagnosis.sets.search import Search


def main(words: Sequence[str]) -> None:
    """A row for each plan and kind of explanation."""
    parser = argparse.ArgumentParser(prog="blind chance")
    parser.add_argument("--draws", type=int, default=3000)
    asked, rng = parser.parse_args(words), np.random.default_rng(7)
    print("| plan | explanation | log Bayes factor above | draws | share of the bound |\n|---|---|---|---|---|")
    for plan in ("3x4", "3x8"):
        screened, _ = Bench()(hidden(np.random.default_rng(1), plan, nothing, ()), known=False)
        pool, sigma, lack = screened.pool, screened.at.rough_level, screened.alternatives.lack
        odds, lacks = np.zeros(asked.draws), np.zeros(asked.draws)
        for k in range(asked.draws):
            z = sigma * rng.standard_normal(pool.dof)
            odds[k] = Search(pool, z, known=False).several()
            none = float(log_evidence_of_noise(z @ z, pool.dof, known=False))
            lacks[k] = lack.log_evidence(lack.by_size(z[None], False), z, known=False) - none
        for name, values in {"sets": odds, "lack of fit": lacks, "both": np.logaddexp(odds, lacks)}.items():
            for limit in (0.0, 1.0, 2.0, 2.5, 3.0):
                above = np.mean(values > limit)
                print(f"| {plan} | {name} | {limit:g} | {above:.2%} | {above / np.exp(-limit):.4f} |")
    print(f"used: {SEVERAL_SHARE}")

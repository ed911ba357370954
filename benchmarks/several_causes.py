"""How often noise alone looks like several causes together, beside Ville's bound on the Bayes factor.

    python benchmarks/several_causes.py --draws 3000

Draws pure noise of unknown size on the paper's plan and on a small one; the second test of the diagnosis (several causes,
each hidden by the others' part of an unknown noise) takes `SEVERAL_SHARE` of Ville's bound for its p-value.
"""

import argparse

import numpy as np

import blind_catalogue as study
from tumblecal.diagnosis.evidence import log_evidence_of_noise
from tumblecal.diagnosis.priors import SEVERAL_SHARE
from tumblecal.diagnosis.sets.search import Search


study.PLANS["3x4"] = (3, 4)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--draws", type=int, default=3000)
    args = parser.parse_args()
    rng = np.random.default_rng(7)
    for plan in ("3x4", "3x8"):
        case = study.hidden(np.random.default_rng(1), plan, lambda _: (), ())
        screened, _ = study.Bench()(case, known=False)
        pool, sigma = screened.pool, screened.at.rough_level
        odds, lacks = np.zeros(args.draws), np.zeros(args.draws)
        for k in range(args.draws):
            z = sigma * rng.standard_normal(pool.dof)
            odds[k] = Search(pool, z, known=False).several()
            none = float(log_evidence_of_noise(z @ z, pool.dof, known=False))
            lack = screened.alternatives.lack
            lacks[k] = lack.log_evidence(lack.by_size(z[None], False), z, known=False) - none
        for words, limit, values in (
            (words, limit, values)
            for words, values in {"sets": odds, "lack of fit": lacks, "both": np.logaddexp(odds, lacks)}.items()
            for limit in (0.0, 1.0, 2.0, 2.5, 3.0)
        ):
            above, bound = np.mean(values > limit), np.exp(-limit)
            print(
                f"{plan}, {words}: log Bayes factor above {limit:g} in {above:.2%}, {above / bound:.4f} of Ville's bound"
            )
    print(f"taken for the p-value: {SEVERAL_SHARE}")


if __name__ == "__main__":
    main()

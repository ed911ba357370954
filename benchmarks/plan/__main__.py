"""Plans against their bounds, other algorithms, simulated errors and simulated diagnoses.

python benchmarks/plan heads --heads 1000     random heads: the bound of any plan over the value of the plan
python benchmarks/plan speed                  time of the choice of positions, next to a published exchange algorithm
python benchmarks/plan remount                the head of the paper with one remount
python benchmarks/plan order --runs 4000      benefit of the order under slow noise of the biases
python benchmarks/plan order_speed            time of the choice of the order
python benchmarks/plan sd --runs 2000         predicted standard deviations against errors of fits
python benchmarks/plan agreement --runs 2000  forecast of a diagnosis against diagnoses, for three plans
python benchmarks/plan loop --heads 200 --runs 5 --seed 50   the same for random heads
"""

import argparse
import sys
from pathlib import Path


sys.path.insert(0, str(Path(__file__).parents[1]))


def main() -> None:
    """Run one study."""
    from plan import bounds, order, promises

    studies = {
        "heads": lambda asked: bounds.heads(asked.heads, asked.seed),
        "speed": lambda asked: bounds.speed(),
        "remount": lambda asked: bounds.remount(),
        "order": lambda asked: order.order(asked.runs, asked.seed),
        "order_speed": lambda asked: order.speed(),
        "sd": lambda asked: promises.standard_deviations(asked.runs),
        "agreement": lambda asked: promises.agreement(asked.runs),
        "loop": lambda asked: promises.closed_loop(asked.heads, asked.runs, asked.seed),
    }
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", choices=studies)
    parser.add_argument("--heads", type=int, default=1000)
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    studies[asked.study](asked)


if __name__ == "__main__":
    main()

"""Plans against their bounds, and their promises against simulated diagnoses.

python benchmarks/plan heads --heads 1000     random heads: the bound of any plan over the value of the plan
python benchmarks/plan loop --heads 200 --runs 5 --seed 50   forecast of a diagnosis against diagnoses, random heads
"""

import argparse
import sys
from pathlib import Path


sys.path.insert(0, str(Path(__file__).parents[1]))


def main() -> None:
    """Run one study."""
    from plan import bounds, promises

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", choices=("heads", "loop"))
    parser.add_argument("--heads", type=int, default=1000)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    if asked.study == "heads":
        bounds.heads(asked.heads, asked.seed)
    else:
        promises.closed_loop(asked.heads, asked.runs, asked.seed)


if __name__ == "__main__":
    main()

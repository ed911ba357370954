"""Plans against their bounds, and their promises against simulated diagnoses.

python benchmarks/plan heads --heads 1000     random heads: the bound of any plan over the value of the plan
python benchmarks/plan loop --heads 200 --runs 5 --seed 50   forecast of a diagnosis against diagnoses, random heads
"""

import sys
from pathlib import Path


sys.path.insert(0, str(Path(__file__).parents[1]))


def main() -> None:
    """Run one study."""
    from command_line import asked
    from plan import bounds, promises

    given = asked(__doc__, study=("heads", "loop"), heads=1000, runs=5, seed=1)
    if given.study == "heads":
        bounds.heads(given.heads, given.seed)
    else:
        promises.closed_loop(given.heads, given.runs, given.seed)


if __name__ == "__main__":
    main()

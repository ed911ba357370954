"""Blind studies: causes hidden in simulated instruments, given to the program, and judged by one rule.

    python benchmarks/blind catalogue --instruments 148 --seed 461 --workers 2
    python benchmarks/blind stress --only "two, d" --only "unlisted*d = 10"

Populations whose causes are named: catalogue, stress, second (`--list`: their kinds; a row for each,
columns in `blind/judge.py`). Populations whose numbers are judged: use (intervals, corrected readings and the statement
`use`), next (predictions of NEXT), slow (slow noise of a rig).
"""

import sys
from importlib import import_module
from pathlib import Path


sys.path.insert(0, str(Path(__file__).parents[1]))
NUMBERS = {"use": "use", "next": "next_positions", "slow": "slow_noise"}


def main() -> None:
    """Run the population of the first argument."""
    from blind.study import POPULATIONS
    from blind.study import main as study

    name = sys.argv[1] if len(sys.argv) > 1 else ""
    if name in POPULATIONS:
        study(name, sys.argv[2:])
    elif name in NUMBERS:
        import_module(f"blind.{NUMBERS[name]}").main(sys.argv[2:])
    else:
        raise SystemExit(f"{__doc__}\nPopulations: {', '.join([*POPULATIONS, *NUMBERS])}")


if __name__ == "__main__":
    main()

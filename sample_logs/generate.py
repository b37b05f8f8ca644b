"""Make the sample logs: a simulated truck, driven and recorded.

    python sample_logs/generate.py [--out DIR] [--seed N] [--only NAME ...]

Writes one rosbag2 folder a run beside this file (or into DIR). The same seed gives the same bytes.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from generator.runs import DEFAULT_SEED, RUNS, generate
from generator.truth import DEFAULT_FOLDER, load_truth


def main() -> None:
    """Read the options, make the runs, say what was written."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--out", type=Path, default=Path(__file__).resolve().parent, help="folder to write to"
    )
    parser.add_argument("--seed", type=int, default=DEFAULT_SEED, help="seed of everything random")
    parser.add_argument("--only", nargs="+", choices=list(RUNS), metavar="NAME", help=f"of {', '.join(RUNS)}")
    parser.add_argument("--truth", type=Path, default=DEFAULT_FOLDER, help="folder of the true values")
    options = parser.parse_args()
    began = time.monotonic()
    for folder in generate(options.out, load_truth(options.truth), options.seed, options.only):
        size = sum(file.stat().st_size for file in folder.iterdir())
        print(f"{folder}  {size / 1e6:.2f} MB")
    print(f"{time.monotonic() - began:.1f} s")


if __name__ == "__main__":
    main()

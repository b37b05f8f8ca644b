"""Make the sample logs: a simulated truck, driven and recorded.

    python sample_logs/generate.py [--out DIR] [--seed N] [--only NAME ...]

Writes one rosbag2 folder or file a run beside this program (or into DIR). The same seed gives the same bytes.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from generator.containers import CONTAINERS, generate_containers
from generator.runs import DEFAULT_SEED, RUNS, generate
from generator.truth import DEFAULT_FOLDER, load_truth
from generator.undeclared import ANSWERS, FOLDER, SETS, generate_undeclared


def main() -> None:
    """Read the options, make the runs, say what was written."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--out", type=Path, default=Path(__file__).resolve().parent, help="folder to write to"
    )
    parser.add_argument("--seed", type=int, default=DEFAULT_SEED, help="seed of everything random")
    hidden = [f"{FOLDER}/{name}" for name in SETS]
    names = [*RUNS, *CONTAINERS, *hidden]
    parser.add_argument("--only", nargs="+", choices=names, metavar="NAME", help=f"of {', '.join(names)}")
    parser.add_argument("--truth", type=Path, default=DEFAULT_FOLDER, help="folder of the true values")
    options = parser.parse_args()
    began = time.monotonic()
    chosen = options.only or names
    truth = load_truth(options.truth)
    written = generate(options.out, truth, options.seed, [name for name in chosen if name in RUNS])
    others = [name for name in chosen if name in CONTAINERS]
    written += generate_containers(options.out, truth, options.seed, others)
    sets = [name.removeprefix(f"{FOLDER}/") for name in chosen if name in hidden]
    written += generate_undeclared(options.out, options.seed, sets, options.truth / ANSWERS)
    for path in written:
        files = [file for file in path.rglob("*") if file.is_file()] if path.is_dir() else [path]
        size = sum(file.stat().st_size for file in files)
        print(f"{path}  {size / 1e6:.2f} MB")
    print(f"{time.monotonic() - began:.1f} s")


if __name__ == "__main__":
    main()

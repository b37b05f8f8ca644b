"""The thin channels of a log of ten minutes and 1 GB, by `ident`, by others, and the floor.

    python benchmarks/bench_logs.py [--minutes 10] [--repeats 3] [--keep FOLDER] [--peers PYTHON]

The log (see ``logs_files.py``) is written as MCAP with zstd, lz4 and without compression, as rosbag2 SQLite
and as ROS 1 bag. Every reader runs in a process of its own, in turn, so that others on the machine disturb
all alike; the table has the medians of wall and processor time, both as ratios to `ident`, and the memory
that reading took at its peak beyond the imports. Values are compared: nobody is fast by being wrong. Files
are in the page cache. "read + unpack + CRC" is the floor: the same chunks, two threads, nothing else; for
formats without checksums it is reading every byte. Of the others, rosbags, mcap and pybag-sdk check no
CRC here, as they come.

Readers that are not installed (the extra dev has them all) are named as missing; --peers gives the
interpreter of another environment that has them.
"""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE)]

from logs_files import FORMATS, make  # noqa: E402

MCAP_READERS = [
    "ident",
    "rosbags",
    "mcap + mcap-ros2-support",
    "small-mcap + mcap-ros2-support-fast",
    "pybag-sdk",
    "read + unpack + CRC",
]
READERS = {
    "mcap zstd": MCAP_READERS,
    "mcap none": MCAP_READERS,
    "mcap lz4": MCAP_READERS,
    "sqlite3": ["ident", "rosbags", "read"],
    "ros1": ["ident", "rosbags", "pybag-sdk", "read"],
}
PEERS = {"mcap + mcap-ros2-support", "small-mcap + mcap-ros2-support-fast", "pybag-sdk"}


@dataclass
class Reader:
    """A reader of one format: (runs, 4) wall, processor time [s], peak beyond imports and in all [bytes]."""

    name: str
    figures: np.ndarray
    arrays: dict[str, np.ndarray]

    @property
    def medians(self) -> np.ndarray:
        """The middle of the runs, figure by figure."""
        return np.median(self.figures, axis=0)


def read_once(python: str, name: str, path: Path, result: Path) -> str:
    """Run a reader in a process of its own; return why it failed, empty where it did not."""
    command = [python, str(HERE / "logs_readers.py"), name, str(path), str(result)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 our own script
    return "" if done.returncode == 0 else (done.stderr.strip().splitlines() or ["no message"])[-1]


def measure(path: Path, names: list[str], repeats: int, peers: str, folder: Path) -> list[Reader]:
    """Run all readers of one format in turn, several times; say which cannot run."""
    result = folder / "result.npz"
    found: dict[str, Reader] = {}
    left = list(names)
    for _ in range(repeats):
        for name in list(left):
            problem = read_once(peers if name in PEERS else sys.executable, name, path, result)
            if problem:
                print(f"{'':12}{name:38}missing: {problem[:80]}")
                left.remove(name)
                continue
            with np.load(result) as data:
                arrays = {key: data[key] for key in data.files if key != "figures"}
                reader = found.setdefault(name, Reader(name, np.empty((0, 4)), arrays))
                reader.figures = np.vstack([reader.figures, data["figures"]])
    return list(found.values())


def compared(reader: Reader, ident: Reader) -> str:
    """Say whether two readers have read the same values."""
    if not reader.arrays:
        return ""
    same = reader.arrays.keys() == ident.arrays.keys() and all(
        np.array_equal(values, ident.arrays[name]) for name, values in reader.arrays.items()
    )
    return "equal" if same else "DIFFERENT VALUES"


def rows(name: str, readers: list[Reader]) -> list[str]:
    """Lines of the table for one format."""
    ident = readers[0]
    wall, cpu, _, _ = ident.medians
    lines = []
    for reader in readers:
        w, c, beyond, peak = reader.medians
        lines.append(
            f"{name if reader is ident else '':12}{reader.name:38}{w:>8.2f}{c:>8.2f}{w / wall:>8.2f}"
            f"{c / cpu:>8.2f}{beyond / 1e6:>10.0f}{peak / 1e6:>8.0f}  {compared(reader, ident)}"
        )
    return lines


def size_of(path: Path) -> int:
    """Bytes of a file, or of a folder's files."""
    return sum(each.stat().st_size for each in (path.iterdir() if path.is_dir() else [path]))


def main() -> None:
    """Write the files, let everybody read them, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--minutes", type=float, default=10.0, help="length of the log")
    parser.add_argument("--repeats", type=int, default=3, help="runs of every reader")
    parser.add_argument("--keep", type=Path, help="folder in which files are made, and kept")
    parser.add_argument("--formats", nargs="*", default=list(FORMATS), choices=list(FORMATS))
    parser.add_argument("--peers", default=sys.executable, help="interpreter that has the other readers")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        print(
            f"Python {platform.python_version()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; "
            f"{options.minutes:g} minutes, medians of {options.repeats} runs"
        )
        print(f"{'':50}{'wall':>8}{'cpu':>8}{'wall':>8}{'cpu':>8}{'reading':>10}{'in all':>8}")
        print(f"{'':50}{'[s]':>8}{'[s]':>8}{'ratio':>8}{'ratio':>8}{'[MB]':>10}{'[MB]':>8}", flush=True)
        for name in options.formats:
            path = make(folder, name, options.minutes)
            readers = measure(path, READERS[name], options.repeats, options.peers, Path(temporary))
            print(
                "\n".join(rows(f"{name}", readers)),
                f"{'':12}{size_of(path) / 1e6:.0f} MB",
                sep="\n",
                flush=True,
            )
            if options.keep is None and path.is_file():
                path.unlink()


if __name__ == "__main__":
    main()

"""One reader of ``bench_logs.py``, in a process of its own: python logs_readers.py READER LOG RESULT

READER is a name of ``READERS`` below. The thin channels are read to one array a field; what is timed is all
between opening the file and having the arrays, with everything imported before. RESULT gets the arrays and
the figures: wall and processor time [s], and the memory that reading has taken at its peak beyond what was
taken by the imports, and in all [bytes].
"""

from __future__ import annotations

import os
import struct
import sys
import zlib
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from operator import attrgetter
from pathlib import Path
from time import perf_counter, process_time

os.environ.setdefault("OMP_NUM_THREADS", "1")
HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import numpy as np  # noqa: E402

Arrays = dict[str, np.ndarray]
Read = Callable[[Path], Arrays]
Prepare = Callable[[Mapping[str, list[str]]], Read]


def by_ident(thin: Mapping[str, list[str]]) -> Read:
    """Whole columns of all topics in one pass; its store of standard types is made before, as for others."""
    from ident.logs import open_log  # noqa: PLC0415
    from ident.logs.schema import standard_schema  # noqa: PLC0415

    standard_schema("std_msgs/msg/Header")

    def read(path: Path) -> Arrays:
        log = open_log(path)
        found = log.read(thin)
        assert not log.damage
        return {f"{t}.{name}": values for t, c in found.items() for name, values in c.values.items()}

    return read


def by_rosbags(thin: Mapping[str, list[str]]) -> Read:
    """Messages of the channels that are asked for, one after the other."""
    from rosbags.highlevel import AnyReader  # noqa: PLC0415
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415

    types = get_typestore(Stores.ROS2_HUMBLE)
    types.register(
        get_types_from_msg("std_msgs/Header header\nfloat64 angle\n", "truck_msgs/msg/SteeringWheelAngle")
    )

    def read(path: Path) -> Arrays:
        with AnyReader([path], default_typestore=types) as reader:
            wanted = [c for c in reader.connections if c.topic in thin]
            pairs = (
                (c.topic, reader.deserialize(raw, c.msgtype))
                for c, _, raw in reader.messages(connections=wanted)
            )
            return _picked(thin, pairs)

    return read


def by_mcap(thin: Mapping[str, list[str]]) -> Read:
    """Let mcap's reader decode with mcap-ros2-support."""
    from mcap.reader import make_reader  # noqa: PLC0415
    from mcap_ros2.decoder import DecoderFactory  # noqa: PLC0415

    def read(path: Path) -> Arrays:
        with path.open("rb") as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            decoded = reader.iter_decoded_messages(topics=list(thin))
            return _picked(thin, ((channel.topic, message) for _, channel, _, message in decoded))

    return read


def by_small_mcap(thin: Mapping[str, list[str]]) -> Read:
    """Let small-mcap unpack in two threads and mcap-ros2-support-fast decode; CRCs checked, as elsewhere."""
    from mcap_ros2_support_fast.decoder import DecoderFactory  # noqa: PLC0415
    from small_mcap import include_topics, read_message_decoded  # noqa: PLC0415

    def read(path: Path) -> Arrays:
        with path.open("rb") as file:
            found = read_message_decoded(
                file,
                should_include=include_topics(list(thin)),
                decoder_factories=[DecoderFactory()],
                validate_crc=True,
                num_workers=2,
            )
            return _picked(thin, ((each.channel.topic, each.decoded_message) for each in found))

    return read


def by_pybag(thin: Mapping[str, list[str]]) -> Read:
    """Let pybag-sdk read, in the order of the file."""
    from pybag import Reader  # noqa: PLC0415

    def read(path: Path) -> Arrays:
        with Reader.from_file(path) as reader:
            return _picked(thin, ((each.topic, each.data) for each in _in_turn(reader, thin)))

    return read


def _in_turn(reader: object, thin: Mapping[str, list[str]]) -> Iterable[object]:
    return reader.messages(list(thin), in_log_time_order=False)  # type: ignore[attr-defined]


def _picked(thin: Mapping[str, list[str]], pairs: Iterable[tuple[str, object]]) -> Arrays:
    """Pick the fields out of the messages."""
    picks = {topic: attrgetter(*fields, "header") for topic, fields in thin.items()}
    rows: dict[str, list[tuple]] = {topic: [] for topic in thin}
    for topic, message in pairs:
        rows[topic].append(picks[topic](message)[:-1])
    return {
        f"{topic}.{field}": np.array([row[k] for row in rows[topic]])
        for topic, fields in thin.items()
        for k, field in enumerate(fields)
    }


# --- the floor ------------------------------------------------------------------------------------

THREADS = 2


def floor(_thin: Mapping[str, list[str]]) -> Read:
    """Read all chunks of an MCAP file, unpack them and check their CRC, and nothing else."""
    import lz4.frame  # noqa: PLC0415
    import zstandard  # noqa: PLC0415

    def check(file: int, place: int, length: int) -> None:
        record = os.pread(file, length, place)
        size, crc, text = struct.unpack_from("<QII", record, 16)
        kind = record[32 : 32 + text]
        data = memoryview(record)[40 + text :]
        if kind == b"zstd":
            data = memoryview(zstandard.ZstdDecompressor().decompress(data, max_output_size=size))
        elif kind == b"lz4":
            data = memoryview(lz4.frame.decompress(data))
        assert len(data) == size
        assert zlib.crc32(data) == crc

    def read(path: Path) -> Arrays:
        file = os.open(path, os.O_RDONLY)
        with ThreadPoolExecutor(THREADS) as pool:
            list(pool.map(lambda place: check(file, *place), _chunks(file)))
        os.close(file)
        return {}

    return read


def floor_of_bytes(_thin: Mapping[str, list[str]]) -> Read:
    """Read every byte of the file once, in pieces of 1 MB, and nothing else."""

    def read(path: Path) -> Arrays:
        file = os.open(path if path.is_file() else next(path.glob("*.db3")), os.O_RDONLY)
        size, piece = os.fstat(file).st_size, 1 << 20
        with ThreadPoolExecutor(THREADS) as pool:
            list(pool.map(lambda place: len(os.pread(file, piece, place)), range(0, size, piece)))
        os.close(file)
        return {}

    return read


def _chunks(file: int) -> Iterable[tuple[int, int]]:
    """Yield where the contents of the chunk records lie."""
    place, size = 8, os.fstat(file).st_size
    while place < size - 8:
        opcode, length = struct.unpack("<BQ", os.pread(file, 9, place))
        if opcode == 0x06:
            yield place + 9, length
        place += 9 + length


READERS: dict[str, Prepare] = {
    "ident": by_ident,
    "rosbags": by_rosbags,
    "mcap + mcap-ros2-support": by_mcap,
    "small-mcap + mcap-ros2-support-fast": by_small_mcap,
    "pybag-sdk": by_pybag,
    "read + unpack + CRC": floor,
    "read": floor_of_bytes,
}


def _resident() -> tuple[int, int]:
    """Memory that this process has now, and had at most [bytes]."""
    text = Path("/proc/self/status").read_text(encoding="ascii")
    found = dict(line.split(":", 1) for line in text.splitlines())
    now, most = (int(found[key].split()[0]) * 1024 for key in ("VmRSS", "VmHWM"))
    return now, most


def main() -> None:
    """Read once, and write down what came out."""
    name, log, result = sys.argv[1:]
    from logs_thin import THIN  # noqa: PLC0415

    read = READERS[name](THIN)
    before, _ = _resident()
    began, cpu = perf_counter(), process_time()
    arrays = read(Path(log))
    figures = [perf_counter() - began, process_time() - cpu]
    most = _resident()[1]
    np.savez(result, figures=np.array([*figures, most - before, most]), **arrays)


if __name__ == "__main__":
    main()

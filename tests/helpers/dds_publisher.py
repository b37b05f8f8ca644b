"""A process that publishes in a DDS domain, told by its standard input what to do.

``python dds_publisher.py DOMAIN``, then a line of JSON each: {"open": NAME}, {"write": NAME, "from": i,
"to": j} once a reader has matched. Each is answered by a line when it is done.
"""

from __future__ import annotations

import ctypes
import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import dds_types as types
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.internal import DDS
from cyclonedds.pub import DataWriter, Publisher
from cyclonedds.topic import Topic

RELIABLE = (Policy.Reliability.Reliable(1_000_000_000), Policy.History.KeepAll)
XCDR1 = Policy.DataRepresentation(use_cdrv0_representation=True)
XCDR2 = Policy.DataRepresentation(use_xcdrv2_representation=True)
KEPT = (
    Policy.Durability.TransientLocal,
    Policy.DurabilityService(0, Policy.History.KeepLast(100), -1, -1, -1),
)
PATIENCE = 20.0


@dataclass(frozen=True)
class Written:
    """A writer: its topic, type, the value of each number, and what it offers."""

    topic: str
    kind: Any
    value: Callable[[int], Any]
    policies: tuple[Any, ...] = RELIABLE
    partition: str = ""


WRITERS = {
    "plain": Written("plain", types.Plain, types.plain, (*RELIABLE, XCDR2)),
    "plain_xcdr1": Written("plain_xcdr1", types.Plain, types.plain, (*RELIABLE, XCDR1)),
    "state": Written("vehicle/state", types.State, types.state),
    "loose": Written("loose", types.Loose, types.loose),
    "reading": Written("rt/reading", types.Reading, types.reading, (*RELIABLE, *KEPT)),
    "reading_best_effort": Written(
        "rt/reading", types.Reading, types.reading, (Policy.Reliability.BestEffort,)
    ),
    "chosen": Written("chosen", types.Chosen, types.chosen),
    "twin": Written("twin", types.Plain, types.plain),
    "other_twin": Written("twin", types.Reading, types.reading),
    "part": Written("part", types.Plain, types.plain, (*RELIABLE, Policy.LatencyBudget(5_000_000)), "left"),
    "camera": Written("camera", types.Plain, types.plain),
    "noise": Written("noise", types.Plain, types.noise),
}


class Descriptor(ctypes.Structure):
    """``dds_topic_descriptor_t``, by which a C program without type discovery makes a topic."""

    _fields_ = (
        *((name, ctypes.c_uint32) for name in ("size", "align", "flags", "keys_count")),
        ("name", ctypes.c_char_p),
        ("keys", ctypes.c_void_p),
        ("instructions_count", ctypes.c_uint32),
        ("instructions", ctypes.POINTER(ctypes.c_uint32)),
        ("meta", ctypes.c_char_p),
        *((name, ctypes.c_void_p) for name in ("information", "information_size", "mapping", "mapping_size")),
        ("restricted", ctypes.c_uint32),
    )


class UntoldWriter:
    """Writes ``struct Untold { double x; }`` to a topic, and tells nobody of what that is made."""

    def __init__(self, participant: Any) -> None:
        self._library = DDS._dll_handle
        read_a_double, end = 0x01040002, 0
        instructions = (ctypes.c_uint32 * 3)(read_a_double, 0, end)
        told = Descriptor(8, 8, 0, 0, b"truck::Untold", None, 2, instructions, b"")
        topic = self._library.dds_create_topic(participant._ref, ctypes.byref(told), b"untold", None, None)
        self._writer = self._library.dds_create_writer(participant._ref, topic, None, None)
        assert topic > 0
        assert self._writer > 0

    def write(self, value: float) -> None:
        assert self._library.dds_write(self._writer, ctypes.byref(ctypes.c_double(value))) == 0


def open_writer(participant: Any, told: Written) -> Any:
    topic = Topic(participant, told.topic, told.kind)
    partition = Qos(Policy.Partition([told.partition])) if told.partition else None
    return DataWriter(Publisher(participant, qos=partition), topic, qos=Qos(*told.policies))


def main() -> None:
    domain = int(sys.argv[1])
    writers: dict[str, Any] = {}
    participants: list[Any] = []
    for line in sys.stdin:
        order = json.loads(line)
        if "open" in order:
            # Of its own: one participant has one type a topic.
            participants.append(DomainParticipant(domain))
            participant, name = participants[-1], order["open"]
            untold = name == "untold"
            writers[name] = UntoldWriter(participant) if untold else open_writer(participant, WRITERS[name])
        elif order.get("write") == "untold":
            writers["untold"].write(1.5)
        elif "write" in order:
            writer, told = writers[order["write"]], WRITERS[order["write"]]
            end = time.monotonic() + PATIENCE
            while order.get("matched", True) and writer.get_publication_matched_status().current_count < 1:
                if time.monotonic() > end:
                    raise SystemExit(f"no reader of {order['write']}")
                time.sleep(0.01)
            for i in range(order["from"], order["to"]):
                writer.write(told.value(i), timestamp=i + 1 if order.get("stamped") else None)
            writer.wait_for_acks(2_000_000_000)
        print(json.dumps(order), flush=True)  # noqa: T201 (the answer)


if __name__ == "__main__":
    main()

"""Live topics: a real publisher process, the real command, and what ident.logs reads of the file."""

from __future__ import annotations

import importlib.util
import json
import os
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
import pytest
from mcap.reader import make_reader

from ident.logs import FieldError, open_log

if importlib.util.find_spec("cyclonedds") is None:
    pytest.skip("cyclonedds is not installed: pip install 'ident[dds]'", allow_module_level=True)

import dds_types as types
from dds_publisher import WRITERS

from ident.record.cyclone import Offer, Sample, Told
from ident.record.recorder import Request, Watch, record
from ident.record.selection import Selection
from ident.record.status import Status
from ident.record.type_text import UntoldType

ROOT = Path(__file__).parents[2]
HELPERS = ROOT / "tests" / "helpers"
# The tag keeps apart what several test processes publish at once.
LOOPBACK = (
    "<General><Interfaces><NetworkInterface address='127.0.0.1'/></Interfaces>"
    "<AllowMulticast>false</AllowMulticast>"
    "</General><Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>60"
    "</MaxAutoParticipantIndex><Peers><Peer address='127.0.0.1'/></Peers>"
    f"<Tag>{uuid.uuid4()}</Tag></Discovery>"
)
ENVIRONMENT = {**os.environ, "CYCLONEDDS_URI": LOOPBACK, "PYTHONPATH": f"{ROOT}{os.pathsep}{HELPERS}"}
DOMAIN = 20
PROGRAM = "from ident.cli import main; main(prog_name='ident')"
PATIENCE = 30.0


class Publisher:
    """The publisher process."""

    def __init__(self, domain: int) -> None:
        command = [sys.executable, str(HELPERS / "dds_publisher.py"), str(domain)]
        self._process = subprocess.Popen(
            command, env=ENVIRONMENT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def do(self, **order: Any) -> None:
        line = json.dumps(order) + "\n"
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(line)
        self._process.stdin.flush()
        assert self._process.stdout.readline() == line

    def end(self) -> None:
        self._process.kill()
        self._process.communicate()


@dataclass
class Recorder:
    """The recorder process, and what it has told so far."""

    process: subprocess.Popen[str]
    out: Path

    def wait_for(self, text: str) -> None:
        assert self.process.stderr is not None
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            line = self.process.stderr.readline()
            if text in line:
                return
            assert line, f"the recorder ended before it told {text!r}"
        raise AssertionError(text)

    def stop(self, number: int = signal.SIGTERM) -> tuple[str, str]:
        self.process.send_signal(number)
        return self.process.communicate(timeout=PATIENCE)


@contextmanager
def recorder(out: Path, *arguments: str, domain: int = DOMAIN, program: str = PROGRAM) -> Iterator[Recorder]:
    command = [
        sys.executable,
        "-c",
        program,
        "record",
        "--domain",
        str(domain),
        "--out",
        str(out),
        *arguments,
    ]
    process = subprocess.Popen(
        command, env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        yield Recorder(process, out)
    finally:
        process.kill()
        process.communicate()


@contextmanager
def publisher(domain: int = DOMAIN) -> Iterator[Publisher]:
    process = Publisher(domain)
    try:
        yield process
    finally:
        process.end()


def wait_until_recorded(path: Path, topic: str, count: int) -> None:
    """Read the file again and again while it is being written."""
    end = time.monotonic() + PATIENCE
    found = 0
    while time.monotonic() < end:
        if path.exists() and path.stat().st_size:
            log = open_log(path)
            found = sum(each.messages for each in log.topics if each.name == topic)
            log.close()
            if found >= count:
                return
        time.sleep(0.1)
    raise AssertionError(f"{topic}: {found} messages of {count}")


COUNT = 40
HISTORY = 5
STEADY = ["plain", "plain_xcdr1", "state", "loose", "chosen", "part"]


@dataclass(frozen=True)
class Recorded:
    path: Path
    shown: str
    told: str
    code: int


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """All kinds of writers, recorded at once."""
    path = tmp_path_factory.mktemp("live") / "drive.mcap"
    with publisher() as source, recorder(path, "--all", "--exclude", "cam*") as process:
        for name in [*STEADY, "untold", "camera", "twin"]:
            source.do(open=name)
        source.do(open="reading")
        source.do(write="reading", **{"from": 0, "to": HISTORY}, matched=False)
        process.wait_for("recording /reading")
        for name in STEADY:
            source.do(write=name, **{"from": 0, "to": COUNT}, stamped=True)
        source.do(write="untold")
        source.do(write="camera", **{"from": 0, "to": COUNT}, matched=False)
        source.do(write="reading", **{"from": HISTORY, "to": COUNT})
        # Late ones: the same topic offered otherwise, and with another type.
        source.do(open="reading_best_effort")
        source.do(open="other_twin")
        process.wait_for("recording twin (truck_msgs::msg::dds_::Reading_)")
        source.do(write="reading_best_effort", **{"from": COUNT, "to": 2 * COUNT})
        source.do(write="twin", **{"from": 0, "to": COUNT})
        source.do(write="other_twin", **{"from": 0, "to": COUNT})
        wait_until_recorded(path, "/reading", 2 * COUNT)
        shown, told = process.stop()
        code = process.process.returncode
    return Recorded(path, shown, told, code)


def messages(path: Path, topic: str) -> list[tuple[str, Any]]:
    """(name of the type, message) of a topic as mcap's own reader finds them."""
    with path.open("rb") as file:
        return [(schema.name, message) for schema, _, message in make_reader(file).iter_messages([topic])]


@pytest.mark.parametrize("name", [*(name for name in STEADY if name != "chosen"), "reading"])
def test_every_number_is_read_back_equal(recorded: Recorded, name: str) -> None:
    told = WRITERS[name]
    topic = told.topic.removeprefix("rt")
    count = 2 * COUNT if name == "reading" else COUNT
    expected = [types.numbers(told.value(i)) for i in range(count)]
    paths = sorted({path for each in expected for path in each})
    log = open_log(recorded.path)
    columns = log.columns(topic, paths)
    assert len(columns.log_time) == count
    for path in paths:
        truth = np.array([each.get(path, np.nan) for each in expected])
        np.testing.assert_array_equal(columns.values[path], truth, err_msg=path)
    assert set(log.fields(topic)) <= set(paths)
    log.close()


@pytest.mark.parametrize("name", STEADY)
def test_payloads_are_what_the_writer_wrote(recorded: Recorded, name: str) -> None:
    told = WRITERS[name]
    found = messages(recorded.path, told.topic)
    expected = [told.value(i) for i in range(COUNT)]
    assert [told.kind.deserialize(message.data) for _, message in found] == expected
    second = name in {"plain", "state", "loose"}
    written = [each.__idl__.serialize(each, use_version_2=second) for each in expected]
    assert [message.data for _, message in found] == written


def test_the_stamps_are_those_of_the_writer_and_of_the_arrival(recorded: Recorded) -> None:
    found = [message for _, message in messages(recorded.path, "plain")]
    assert [message.publish_time for message in found] == list(range(1, COUNT + 1))
    assert [message.sequence for message in found] == list(range(COUNT))
    times = np.array([message.log_time for message in found])
    assert (np.diff(times) >= 0).all()
    assert abs(times[-1] / 1e9 - recorded.path.stat().st_mtime) < 5


def test_two_types_of_one_topic_and_two_offers_are_kept_apart(recorded: Recorded) -> None:
    twins = messages(recorded.path, "twin")
    decoded = {"truck::Plain": types.Plain, "truck_msgs::msg::dds_::Reading_": types.Reading}
    found = [decoded[name].deserialize(message.data) for name, message in twins]
    assert [each for each in found if isinstance(each, types.Plain)] == [types.plain(i) for i in range(COUNT)]
    assert [each for each in found if isinstance(each, types.Reading)] == [
        types.reading(i) for i in range(COUNT)
    ]


def test_ros_names_stand_in_the_log(recorded: Recorded) -> None:
    log = open_log(recorded.path)
    names = {topic.name for topic in log.topics}
    assert {"/reading", "vehicle/state"} <= names
    assert "camera" not in names
    log.close()


def test_two_types_of_one_topic_are_read_as_two(recorded: Recorded) -> None:
    log = open_log(recorded.path)
    (told,) = log.damage
    assert "twin: recorded as truck::Plain and as truck_msgs::msg::dds_::Reading_" in told.what
    assert told.messages_lost is None
    read = log.read({"twin": ["x"], "twin (truck_msgs/msg/Reading)": ["value"]})
    assert [columns.values[name].tolist() for columns in read.values() for name in columns.values] == [
        [-1.5 * i for i in range(COUNT)],
        [0.25 * i for i in range(COUNT)],
    ]
    log.close()


def test_a_union_is_recorded_and_refused_by_name_where_it_is_read(recorded: Recorded) -> None:
    assert len(messages(recorded.path, "chosen")) == COUNT
    log = open_log(recorded.path)
    with pytest.raises(FieldError, match=r"truck::Chosen\.choice: .*union"):
        log.fields("chosen")
    log.close()


def test_a_writer_without_type_information_is_refused_by_name(recorded: Recorded) -> None:
    assert messages(recorded.path, "untold") == []
    assert "refused untold (truck::Untold): its writer sends no type information" in recorded.shown
    with recorded.path.open("rb") as file:
        told = [each.metadata for each in make_reader(file).iter_metadata() if each.name == "ident.record"]
    (refused,) = json.loads(told[-1]["writers_refused"])
    assert (refused["topic"], refused["type"]) == ("untold", "truck::Untold")
    assert json.loads(told[-1]["samples_lost"]) == {}
    assert json.loads(told[-1]["losses_not_counted"]) == ["/reading"]


def test_says_what_was_recorded(recorded: Recorded) -> None:
    assert recorded.code == 0
    lines = recorded.shown.splitlines()
    (reading,) = [line for line in lines if line.startswith("/reading: ")]
    assert reading.startswith("/reading: 80 messages")
    assert reading.endswith("(best effort: what was lost on the way is not counted)")
    assert lines[-1] == f"Look at it with: ident info {recorded.path}"
    assert lines[-2].startswith(f"{recorded.path}: 400 messages")
    assert lines[-2].endswith("0 counted as lost")


def test_a_killed_recorder_leaves_what_it_had_recorded(tmp_path: Path) -> None:
    path = tmp_path / "killed.mcap"
    with publisher(DOMAIN + 1) as source, recorder(path, "vehicle/*", domain=DOMAIN + 1) as process:
        source.do(open="state")
        process.wait_for("recording vehicle/state")
        source.do(write="state", **{"from": 0, "to": COUNT})
        wait_until_recorded(path, "vehicle/state", COUNT)
        os.kill(process.process.pid, signal.SIGKILL)
    log = open_log(path)
    angle = log.columns("vehicle/state", ["angle"]).values["angle"]
    np.testing.assert_array_equal(angle, [0.1 * i for i in range(COUNT)])
    assert [defect.what for defect in log.damage] == [
        "killed.mcap: has no footer, the recorder did not close it"
    ]
    log.close()


def test_a_full_disk_is_one_line_and_costs_nothing_of_before(tmp_path: Path) -> None:
    path = tmp_path / "full.mcap"
    program = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (6000, 6000)); {PROGRAM}"
    with (
        publisher(DOMAIN + 2) as source,
        recorder(path, "noise", domain=DOMAIN + 2, program=program) as process,
    ):
        source.do(open="noise")
        process.wait_for("recording noise")
        source.do(write="noise", **{"from": 0, "to": 1})
        wait_until_recorded(path, "noise", 1)
        source.do(write="noise", **{"from": 1, "to": 20})
        shown, told = process.process.communicate(timeout=PATIENCE)
    assert process.process.returncode == 2
    assert shown == ""
    assert told.splitlines()[-1].startswith(f"ident: cannot write on to {path}: File too large: it holds")
    assert len(told.splitlines()) == 1
    log = open_log(path)
    assert log.columns("noise", ["y"]).values["y"][0] == types.noise(0).y
    log.close()


def test_stops_by_itself_and_says_why_there_is_nothing(tmp_path: Path) -> None:
    path = tmp_path / "nothing.mcap"
    with publisher(DOMAIN + 3) as source:
        source.do(open="untold")
        source.do(open="plain")
        source.do(open="camera")
        asked = ("un*", "camera", "/odom", "--duration", "3 s")
        with recorder(path, *asked, domain=DOMAIN + 3) as process:
            shown, told = process.process.communicate(timeout=PATIENCE)
    assert process.process.returncode == 3
    assert shown == ""
    assert not path.exists()
    assert told.splitlines()[-1] == (
        f"ident: nothing was recorded in domain {DOMAIN + 3}: untold (truck::Untold): its writer sends no "
        "type information; /odom: no writer seen; camera: its writer sent nothing; other topics there: plain"
    )


def test_a_writer_that_is_started_again_goes_on_in_its_topic_until_an_interrupt(tmp_path: Path) -> None:
    path = tmp_path / "interrupted.mcap"
    with recorder(path, "camera", "/odom", domain=DOMAIN + 4) as process:
        with publisher(DOMAIN + 4) as source:
            source.do(open="camera")
            process.wait_for("recording camera")
            source.do(write="camera", **{"from": 0, "to": COUNT})
            wait_until_recorded(path, "camera", COUNT)
        with publisher(DOMAIN + 4) as source:
            source.do(open="camera")
            source.do(write="camera", **{"from": COUNT, "to": 2 * COUNT})
            shown, told = process.stop(signal.SIGINT)
    assert process.process.returncode == 0
    assert shown.startswith(f"camera: {2 * COUNT} messages")
    assert told == "ident: /odom: no writer seen, nothing recorded of it\n"
    log = open_log(path)
    assert log.damage == []
    expected = [types.plain(i).x for i in range(2 * COUNT)]
    assert log.columns("camera", ["x"]).values["x"].tolist() == expected
    log.close()


# --- what a real domain does only now and then -----------------------------------------------------------


class LosingSource:
    """A reader that gets one sample of a writer nobody announced and knows that three were lost."""

    def __init__(self) -> None:
        self._left = [Sample(99, b"\x00\x01\x00\x00" + bytes(8), None)]

    def take(self) -> list[Sample]:
        return [self._left.pop()] if self._left else []

    def lost(self) -> int:
        return 3


class PretendedDomain:
    """Two writers: of one the type is told, of the other nobody tells it for a while."""

    def __init__(self, _: int) -> None:
        self._offers = [Offer(1, "silent", "S", None, ()), Offer(2, "a", "A", None, ())]
        self._sources: list[LosingSource] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def offers(self) -> list[Offer]:
        found, self._offers = self._offers, []
        return found

    def type_of(self, offer: Offer, *_: object) -> Told:
        if offer.topic == "silent":
            time.sleep(0.5)
            raise UntoldType("nobody told")
        return Told("A", "@final struct A { double x; };", None)

    def open(self, *_: object) -> LosingSource:
        self._sources.append(LosingSource())
        return self._sources[-1]

    def wait(self, seconds: float) -> list[LosingSource]:
        time.sleep(seconds)
        return self._sources


def test_losses_are_told_and_a_silent_writer_holds_up_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ident.record.recorder.Domain", PretendedDomain)
    path = tmp_path / "a.mcap"
    shown: list[Status] = []
    notes: list[str] = []
    watch = Watch(lambda: False, shown.append, notes.append)
    status = record(Request(0, path, Selection(), duration=1.3), watch)
    assert (status.messages, status.lost) == (1, 3)
    assert notes == ["recording a (A)", "refused silent (S): nobody told"]
    assert [(topic.messages, topic.lost) for topic in shown[0].topics] == [(1, 3)]
    with path.open("rb") as file:
        told = [each.metadata for each in make_reader(file).iter_metadata()]
    assert json.loads(told[-1]["samples_lost"]) == {"a": 3}
    assert json.loads(told[-1]["writers_refused"]) == [
        {"topic": "silent", "type": "S", "reason": "nobody told"}
    ]
    assert open_log(path).columns("a", ["x"]).values["x"].tolist() == [0.0]

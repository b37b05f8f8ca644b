"""One run in every format that is read gives the same signals and the same steering model."""

import csv
import json
import sqlite3
from dataclasses import asdict
from datetime import UTC, datetime

import numpy as np
import pandas as pd
import pytest
from log_files import ANGLE, REQUEST, START, message, write_bag, write_mcap
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ident.signals.run import load_runs
from ident.stages.inputs import InputSettings
from ident.stages.output import Context
from ident.stages.steering import SteeringSettings, steering

TOPICS = {"/request": REQUEST, "/angle": ANGLE}
LATE = 3_000_000  # [ns] from the stamp to the log
IDL = "module truck { @final struct Angle { string<20> frame; double angle; @key octet side; }; };"
CHANNELS = """signals:
  steering_wheel_request: {{topic: {request}, field: {request_field}, unit: rad}}
  steering_wheel_angle: {{topic: {angle}, field: {angle_field}, unit: rad}}
"""


def response(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A request of pulses and a sine, and what a lag of 0.2 s behind a dead time of 0.1 s makes of it."""
    fine = np.arange(0.0, 26.0, 0.001)
    request = np.where((fine % 6 > 1) & (fine % 6 < 3.5), 0.8, 0.0) * np.where(fine < 12, 1.0, -0.6)
    request = np.where(fine > 18, 0.5 * np.sin(3.0 * (fine - 18)), request)
    angle = np.zeros_like(fine)
    for k in range(1, len(fine)):
        angle[k] = angle[k - 1] + 0.001 / 0.2 * (request[max(k - 101, 0)] - angle[k - 1])
    return np.interp(time, fine, request), np.interp(time, fine, angle)


@pytest.fixture(scope="module")
def samples() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Topic -> stamps [ns] and values."""
    random = np.random.default_rng(5)
    request = np.sort(np.arange(1250) * 20_000_000 + random.integers(0, 1_000_000, 1250))
    angle = np.sort(np.arange(2500) * 10_000_000 + 1 + random.integers(0, 1_000_000, 2500))
    measured = response(angle / 1e9)[1] + 1e-3 * random.standard_normal(2500)
    # The requests are held between their messages, as the fit takes them.
    return {
        "/request": (START + request, response(request / 1e9)[0]),
        "/angle": (START + angle, measured),
    }


def rows(samples):
    """Every message: (stamp, topic, value), in order."""
    return sorted(
        (int(t), name, float(v)) for name, (ts, vs) in samples.items() for t, v in zip(ts, vs, strict=True)
    )


def ros2_messages(samples):
    return [message(topic, TOPICS[topic], t, time=t + LATE, angle=v) for t, topic, v in rows(samples)]


def cdr(frame: str, angle: float, side: int) -> bytes:
    """XCDR1 of truck::Angle: string, double aligned to 8 bytes behind the encapsulation, octet."""
    text = frame.encode() + b"\0"
    body = len(text).to_bytes(4, "little") + text
    body += bytes(-len(body) % 8) + np.float64(angle).tobytes() + bytes([side])
    return b"\x00\x01\x00\x00" + body


# --- writers: each returns what the channel map has to say --------------------------------------------


def write_rosbag2_mcap(folder, samples):
    write_bag(folder / "run", ros2_messages(samples))
    return {}


def write_rosbag2_sqlite(folder, samples):
    write_bag(folder / "run", ros2_messages(samples), sqlite=True)
    return {}


def write_plain_mcap(folder, samples):
    write_mcap(folder / "run.mcap", ros2_messages(samples))
    return {}


def write_ros1(folder, samples):
    types = get_typestore(Stores.ROS1_NOETIC)
    types.register(get_types_from_msg("Header header\nfloat64 angle\n", ANGLE))
    with Ros1Writer(folder / "run.bag") as writer:
        connections = {name: writer.add_connection(name, ANGLE, typestore=types) for name in TOPICS}
        for seq, (t, topic, value) in enumerate(rows(samples)):
            stamp = types.types["builtin_interfaces/msg/Time"](sec=t // 10**9, nanosec=t % 10**9)
            header = types.types["std_msgs/msg/Header"](seq=seq, stamp=stamp, frame_id="x" * (seq % 3))
            data = types.serialize_ros1(types.types[ANGLE](header=header, angle=value), ANGLE)
            writer.write(connections[topic], t + LATE, data)
    return {}


def write_mcap_idl(folder, samples):
    with (folder / "run.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start(profile="ros2")
        schema = writer.register_schema("truck::Angle", "omgidl", IDL.encode())
        channels = {name: writer.register_channel(name, "cdr", schema) for name in TOPICS}
        for t, topic, value in rows(samples):
            writer.add_message(channels[topic], t + LATE, cdr("base", value, 1), t)
        writer.finish()
    return {}


def when(t: int) -> str:
    return datetime.fromtimestamp(t // 10**9, UTC).strftime("%Y-%m-%d %H:%M:%S") + f".{t % 10**9:09d}"


def eprosima(folder, samples, *, with_cdr: bool):
    database = sqlite3.connect(folder / "run.db")
    database.execute("CREATE TABLE Types (name TEXT, information TEXT, object TEXT, is_ros2_type TEXT)")
    database.execute("CREATE TABLE Topics (name TEXT, type TEXT, qos TEXT, is_ros2_topic TEXT)")
    database.execute(
        "CREATE TABLE Messages (writer_guid TEXT NOT NULL, sequence_number INTEGER NOT NULL, data_json TEXT, "
        "data_cdr BLOB, data_cdr_size INTEGER, topic TEXT, type TEXT, key TEXT, log_time DATETIME, "
        "publish_time DATETIME, PRIMARY KEY(writer_guid, sequence_number))"
    )
    database.executemany(
        "INSERT INTO Messages VALUES ('guid', ?, ?, ?, 0, ?, 'truck::Angle', '', ?, ?)",
        [
            (
                n,
                json.dumps({"angle": v}),
                cdr("base", v, 1) if with_cdr else None,
                name,
                when(t + LATE),
                when(t),
            )
            for n, (t, name, v) in enumerate(rows(samples))
        ],
    )
    database.commit()
    database.close()
    return {}


def write_eprosima_cdr(folder, samples):
    (folder / "types.idl").write_text(IDL)
    return eprosima(folder, samples, with_cdr=True)


def write_eprosima_json(folder, samples):
    return eprosima(folder, samples, with_cdr=False)


def rti(folder, samples, column: str, sample):
    database = sqlite3.connect(folder / "run.dat")
    for topic, (stamps, values) in samples.items():
        database.execute(
            f'CREATE TABLE "{topic}@0" ({column}, SampleInfo_reception_timestamp INTEGER, '
            "SampleInfo_source_timestamp INTEGER)"
        )
        database.executemany(
            f'INSERT INTO "{topic}@0" VALUES (?, ?, ?)',
            [(sample(v), t + LATE, t) for t, v in zip(stamps.tolist(), values.tolist(), strict=True)],
        )
    database.commit()
    database.close()
    return {}


def write_rti_json(folder, samples):
    return rti(folder, samples, "rti_json_sample", lambda v: json.dumps({"angle": v}))


def write_rti_cdr(folder, samples):
    (folder / "types.idl").write_text(IDL)
    return rti(folder, samples, "rti_cdr_sample", lambda v: cdr("base", v, 1))


def table(samples) -> pd.DataFrame:
    frame = pd.DataFrame(rows(samples), columns=["time_ns", "topic", "value"])
    for topic in samples:
        frame[topic.strip("/")] = frame["value"].where(frame["topic"] == topic)
    return frame[["time_ns", "request", "angle"]]


ONE_TABLE = {"request": "/run", "request_field": "request", "angle": "/run", "angle_field": "angle"}


def write_csv(folder, samples):
    with (folder / "run.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time_ns", "request", "angle"])
        for t, topic, value in rows(samples):
            writer.writerow([t, *(repr(value) if topic == name else "" for name in TOPICS)])
    return ONE_TABLE


def write_parquet(folder, samples):
    table(samples).to_parquet(folder / "run.parquet")
    return ONE_TABLE


WRITERS = {
    "rosbag2 mcap": write_rosbag2_mcap,
    "rosbag2 sqlite3": write_rosbag2_sqlite,
    "mcap": write_plain_mcap,
    "ros1": write_ros1,
    "mcap omgidl": write_mcap_idl,
    "eprosima sqlite (types from the IDL beside it)": write_eprosima_cdr,
    "eprosima sqlite (messages from JSON)": write_eprosima_json,
    "rti sqlite json": write_rti_json,
    "rti sqlite": write_rti_cdr,
    "csv": write_csv,
    "parquet": write_parquet,
}
NAMED = {"mcap omgidl": "mcap", "rti sqlite json": "rti sqlite"}
PLAIN = {"request": "/request", "request_field": "angle", "angle": "/angle", "angle_field": "angle"}


@pytest.fixture(scope="module", params=list(WRITERS))
def log(request, samples, tmp_path_factory):
    folder = tmp_path_factory.mktemp("format")
    named = WRITERS[request.param](folder, samples)
    (folder / "channels.yaml").write_text(CHANNELS.format(**{**PLAIN, **named}))
    return request.param, folder


def numbers(value, path=""):
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from numbers(inner, f"{path}.{key}")
    elif isinstance(value, (list, tuple)):
        for index, inner in enumerate(value):
            yield from numbers(inner, f"{path}[{index}]")
    elif isinstance(value, (int, float)):
        yield path, float(value)


def test_the_signals_are_those_that_were_written(log, samples):
    name, folder = log
    (run,) = load_runs([folder]).runs
    assert run.health.format == NAMED.get(name, name)
    assert run.health.damage == []
    zero = min(stamps[0] for stamps, _ in samples.values())
    for topic, signal in (("/request", "steering_wheel_request"), ("/angle", "steering_wheel_angle")):
        stamps, values = samples[topic]
        np.testing.assert_array_equal(run.signals[signal].time, (stamps - zero) / 1e9)
        np.testing.assert_array_equal(run.signals[signal].values, values)
        assert (run.signals[signal].arrival is None) == (name in {"csv", "parquet"})


@pytest.fixture(scope="module")
def reference(samples, tmp_path_factory):
    folder = tmp_path_factory.mktemp("reference")
    write_plain_mcap(folder, samples)
    (folder / "channels.yaml").write_text(CHANNELS.format(**PLAIN))
    return identify(folder)


def identify(folder):
    result = steering([folder], InputSettings(), SteeringSettings(), Context("test", "2026-01-01")).result
    kept = {"model": asdict(result.model), "rms_error": result.rms_error, "experiments": result.experiments}
    kept["experiments"] = [asdict(experiment) for experiment in result.experiments]
    return dict(numbers(kept))


def test_the_steering_model_is_the_same_in_every_format(log, reference):
    found = identify(log[1])
    assert len(reference) > 20
    assert found.keys() == reference.keys()
    for path, value in reference.items():
        assert found[path] == pytest.approx(value, rel=1e-9, abs=0), path


def test_the_model_is_that_of_the_truth(reference):
    assert reference[".model.gain.value"] == pytest.approx(1.0, abs=0.01)
    assert reference[".model.total_lag.value"] == pytest.approx(0.3, abs=0.03)

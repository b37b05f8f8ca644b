import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from ident.report import recording
from ident.results import Experiment


def columns(path):
    """Give every signal of a recording: entity -> (time [s], values)."""
    found = {}
    for chunk in RrdReader(str(path)).stream():
        batch = chunk.to_record_batch()
        if "Scalars:scalars" in batch.schema.names:
            time = np.asarray(batch.column("time").cast("int64"), dtype=np.float64) / 1e9
            values = np.array([row[0] for row in batch.column("Scalars:scalars").to_pylist()])
            found.setdefault(chunk.entity_path, []).append((time, values))
    return {
        entity: tuple(np.concatenate([piece[axis] for piece in pieces]) for axis in (0, 1))
        for entity, pieces in found.items()
    }


def views(path):
    """Give the names of the views and tabs in the blueprint of a recording."""
    reader = RrdReader(str(path))
    names = []
    for chunk in reader.stream(store=reader.blueprints()[0]):
        batch = chunk.to_record_batch()
        for column in batch.schema.names:
            if column.endswith(":display_name"):
                names += [row[0] for row in batch.column(column).to_pylist() if row]
    return names


@pytest.fixture(scope="module")
def written(steering_case, tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "run.rrd"
    recording.write_recording(path, *steering_case)
    return path


def test_holds_every_sample_on_the_run_s_own_time(written, steering_case):
    table = steering_case[1]["steering"]
    found = columns(written)
    for run, rows in table.groupby("run"):
        time, values = found[f"{recording.origin(run)}/measured"]
        kept = np.isfinite(values)
        np.testing.assert_allclose(time[kept], rows["time"], atol=1e-9)
        np.testing.assert_allclose(values[kept], rows["measured"])


def test_holds_request_modelled_and_residual_too(written, steering_case):
    tables = steering_case[1]
    found = columns(written)
    assert len(found) == 4 * tables["steering"]["run"].nunique()
    root = recording.origin("steering_sines_a")
    request = tables["steering_request"].query("run == 'steering_sines_a'")["request"]
    np.testing.assert_allclose(found[f"{root}/request"][1], request)
    rows = tables["steering"].query("run == 'steering_sines_a'")
    for name in ("modelled", "residual"):
        np.testing.assert_allclose(found[f"{root}/{name}"][1], rows[name], equal_nan=True, atol=1e-12)


def test_lifts_the_pen_at_a_gap(written):
    time, values = columns(written)[f"{recording.origin('day 1/steering_pulses_a')}/measured"]
    assert time[np.isnan(values)].tolist() == pytest.approx([14.197], abs=0.01)


def test_a_name_from_a_log_is_one_part_of_an_entity_path():
    hostile = "a/b <img>\n\udc80"
    assert recording.origin(hostile).count("/") - recording.origin(hostile).count("\\/") == 1
    assert recording.origin("").strip("/")


def test_opens_on_the_experiments_steps_and_sines_first(written):
    names = views(written)
    tabs = [name for name in names if name.startswith(("pulse", "sine"))]
    assert len(tabs) == 12
    assert "pulse 0.785 rad at 2.0 s, day 1/steering_pulses_a" in tabs
    assert "sine 3.00 rad/s 0.400 rad at 41.7 s, steering_sines_a" in tabs
    assert {"angle [rad]", "residual [rad]", "result"} <= set(names)


def test_many_experiments_become_tabs_of_their_runs(steering_case, tmp_path):
    result, tables = steering_case
    many = [replace(result.experiments[0], start=2.0 + 0.1 * index) for index in range(50)]
    recording.write_recording(tmp_path / "many.rrd", replace(result, experiments=many), tables)
    names = views(tmp_path / "many.rrd")
    assert sum(name.startswith("pulse") for name in names) == recording.MOST_TABS
    assert names.count("whole run") == 1
    assert "steering_sines_a" in names


def test_orders_used_steps_before_sines_before_others():
    kinds = ["other", "sine", "step", "pulse"]
    found = [
        Experiment("a", kind, float(index), index + 1.0, used_by=["x"]) for index, kind in enumerate(kinds)
    ]
    unused = replace(found[2], used_by=[])
    order = [experiment.kind for experiment in recording.ordered([unused, *found])]
    assert order == ["step", "pulse", "sine", "other", "step"]


def test_the_range_shown_holds_all_finite_values():
    assert recording.value_range([np.array([np.nan, 1.0]), np.array([3.0])]) == pytest.approx((0.88, 3.12))
    assert recording.value_range([np.array([np.nan])]) == (-1.0, 1.0)
    low, high = recording.value_range([np.zeros(3)])
    assert low < 0 < high


def test_the_same_run_gives_the_same_recording_name(steering_case):
    provenance = steering_case[0].provenance
    assert recording.recording_id(provenance) == recording.recording_id(
        replace(provenance, date="another day")
    )
    assert recording.recording_id(provenance) != recording.recording_id(replace(provenance, command="other"))


def test_a_result_without_experiments_is_recorded(steering_case, tmp_path):
    result, tables = steering_case
    path = tmp_path / "none.rrd"
    empty = {name: table.iloc[:0] for name, table in tables.items()}
    recording.write_recording(path, replace(result, experiments=[]), tables)
    recording.write_recording(tmp_path / "empty.rrd", replace(result, experiments=[]), empty)
    assert {"steering_sines_a", "result"} <= set(views(path))
    assert views(tmp_path / "empty.rrd") == ["result"]


def test_rerun_itself_accepts_the_file(written):
    tool = Path(sys.executable).with_name("rerun")
    if not tool.exists():
        pytest.skip(f"the rerun program is not beside {sys.executable}")
    done = subprocess.run([tool, "rrd", "verify", written], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "1 file verified without error" in done.stdout + done.stderr

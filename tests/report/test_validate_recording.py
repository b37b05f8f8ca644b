from dataclasses import replace

import numpy as np
import pytest
import validated_case as validation
from rrd import columns, strips, views

from ident.report import recording
from ident.report.recording import parts
from ident.report.recording.validate import _name


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "run.rrd"
    write(path, recording.validate_part(*validation.case()))
    return path


def root_of(index):
    return parts.origin("validate", _name(validation.case()[0], index))


def write(path, part):
    recording.write_recording(path, [part], part.stage)


def test_holds_the_signals_of_every_opened_run(written):
    result, tables = validation.case()
    found = columns(written)
    opened = tables["validate"]
    for index in opened["run"].unique():
        rows = opened[opened["run"] == index]
        time, values = found[f"{root_of(index)}/lateral_error"]
        np.testing.assert_allclose(time, rows["time"], atol=1e-9)
        np.testing.assert_allclose(values, rows["lateral_error"])
    assert len(found) == 5 * opened["run"].nunique()
    assert result.worst in set(opened["run"])


def test_the_horizon_of_each_cycle_is_there_at_its_time(written):
    result, tables = validation.case()
    found = sorted(strips(written, f"{root_of(result.worst)}/path/horizon"), key=lambda one: one[0])
    table = tables["validate_horizon"]
    assert len(found) == table["time"].nunique()
    time, points = found[20]
    assert time == pytest.approx(1.0)
    np.testing.assert_allclose(points[:, :2], table.query("time == 1.0")[["x", "y"]], atol=1e-4)


def test_the_lane_lies_about_the_reference(written):
    result, _ = validation.case()
    ((_, reference),) = strips(written, f"{root_of(result.worst)}/path/reference")
    ((_, edge),) = strips(written, f"{root_of(result.worst)}/path/lane")
    np.testing.assert_allclose(np.hypot(*(edge - reference)[:, :2].T), result.lane_half_width, atol=1e-4)


def test_opens_on_the_worst_run(written):
    names = views(written)
    tabs = [tab.name for tab in recording.validate_part(*validation.case()).tabs]
    assert tabs[0] == "pure pursuit: double lane change (ISO 3888-1), 60 km/h"
    assert sorted(name for name in names if name.endswith("km/h")) == sorted(tabs)
    assert len(tabs) == 18
    assert {"path", "truck", "lateral error [m]", "speed [m/s]", "result"} <= set(names)


def test_hostile_names_are_one_part_of_an_entity_path(tmp_path):
    result, tables = validation.case()
    run = replace(result.runs[result.worst], scenario_run=validation.HOSTILE)
    runs = [*result.runs]
    runs[result.worst] = run
    part = recording.validate_part(replace(result, runs=runs), tables)
    write(tmp_path / "run.rrd", part)
    assert any("onerror" in entity for entity in columns(tmp_path / "run.rrd"))


@pytest.mark.parametrize("kind", [validation.bare, validation.nothing])
def test_a_result_without_opened_runs_has_its_words_alone(tmp_path, kind):
    write(tmp_path / "run.rrd", recording.validate_part(kind(validation.case()[0]), {}))
    assert columns(tmp_path / "run.rrd") == {}
    assert views(tmp_path / "run.rrd") == ["result"]

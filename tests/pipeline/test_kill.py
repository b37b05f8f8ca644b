"""A run that is killed at any moment leaves nothing that the next run could not finish as if undisturbed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from actuator_truth import pulses
from generator.truth import Actuator
from log_files import ANGLE, REQUEST, message, nanoseconds, write_mcap

ROOT = Path(__file__).parents[2]
CHANNELS = """signals:
  steering_wheel_request: {topic: /request, field: angle, unit: rad}
  steering_wheel_angle: {topic: /angle, field: angle, unit: rad}
"""
RECIPE = """seed: 3
improve: {effects: [steering_dead_zone], most_effects: 1, draws: 199}
"""
ROUNDS = int(os.environ.get("IDENT_KILL_ROUNDS", "3"))
EVERY = int(os.environ.get("IDENT_KILL_EVERY", "10"))
"""Operation on files before which a run is killed; `make study` takes each of them."""
HARNESS = ROOT / "tests" / "helpers" / "killed_runs.py"


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two pulses of a noisy actuator: the steering answers, the tyres and the evaluation cannot."""
    folder = tmp_path_factory.mktemp("kill") / "logs"
    folder.mkdir()
    (folder / "channels.yaml").write_text(CHANNELS, encoding="utf-8")
    (folder.parent / "recipe.yaml").write_text(RECIPE, encoding="utf-8")
    random = np.random.default_rng(1)
    test = pulses(random, on=2.0, off=1.0, sizes=(1.0, -0.7), before=0.5)
    measured = test.record(
        Actuator(1.0, 0.1, 0.25, 0.08), 0.003 * random.normal(size=test.times.size)
    ).measured
    messages = [
        message(topic, kind, nanoseconds(round(float(time), 9)), angle=float(value))
        for topic, kind, times, values in (
            ("/request", REQUEST, test.command_times, test.command_values),
            ("/angle", ANGLE, test.times, measured),
        )
        for time, value in zip(times, values, strict=True)
    ]
    write_mcap(folder / "pulses.mcap", sorted(messages, key=lambda one: one.time))
    return folder


def kill(how: str, logs: Path, out: Path, **options: Any) -> dict[str, Any]:
    paths = (str(logs.parent / "recipe.yaml"), str(logs), str(out))
    environment = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "OMP_NUM_THREADS": "1",
        "IDENT_CACHE": str(logs.parent / "cache"),
    }
    ended = subprocess.run(
        [sys.executable, str(HARNESS), how, *paths, json.dumps(options)],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    found: dict[str, Any] = json.loads(ended.stdout)
    assert found["undisturbed"] == 0, ended.stderr
    assert {"steering.json", "info.json", "model.yaml", "index.html", "run.rrd"} < set(found["files"])
    return found


def test_a_run_killed_at_random_moments_is_finished_by_the_next(logs: Path, tmp_path: Path) -> None:
    found = kill("random", logs, tmp_path / "out", seed=1, rounds=ROUNDS, kills=5)
    assert found["differing"] == [[]] * ROUNDS
    assert found["codes"] == [0] * ROUNDS


def test_a_run_killed_before_any_operation_on_files_is_finished_by_the_next(
    logs: Path, tmp_path: Path
) -> None:
    found = kill("operations", logs, tmp_path / "out", first=1, every=EVERY)
    assert found["differing"] == {}
    assert found["last"] > 40, "hardly any operation was met"

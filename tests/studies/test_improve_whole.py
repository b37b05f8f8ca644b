"""The study of the whole command: its time bases, its cells, what it counts."""

import json

import numpy as np
import pandas as pd
import pytest
from improve_runs import TYPICAL
from improve_whole import RATES, SOUND, TrueRun, cells, floors, inputs_at, summary


def row(name, **other):
    made = {
        "cell": [name, 1],
        "truth": {name: {"length": 0.5}},
        "verdict": "named",
        "added": [name],
        "members": {name: [name]},
        "sizes": {name: {"length": [0.51, 0.47, 0.55]}},
        "over_floor": {"yaw_rate": 1.02},
        "over_before": {"yaw_rate": 0.7},
    }
    return {**made, "at_50_hz": {"verdict": "named"}, **other}


def sound(**other):
    nothing = {"truth": {}, "added": [], "members": {}, "sizes": {}, "verdict": "adequate"}
    return row(SOUND, **{**nothing, "at_50_hz": {"verdict": "adequate"}, **other})


def test_each_time_base_is_one_that_the_command_takes():
    assert [inputs_at(rate).align.rate for rate in RATES] == pytest.approx([100.0, 50.0])


def test_every_fifth_sound_truck_has_one_of_each_effect_beside_it():
    made = list(cells(6))
    assert len({json.dumps(cell) for cell in made}) == len(made) == 6 + 2 * len(TYPICAL)
    assert list(cells(3, [SOUND])) == [[SOUND, 1], [SOUND, 2], [SOUND, 3]]


def test_false_alarms_wrong_verdicts_and_worse_errors_are_counted():
    told = summary(
        [
            sound(),
            sound(verdict="unexplained"),
            row("tyre_relaxation"),
            row("tyre_relaxation", over_before={"yaw_rate": 0.7, "heading": 1.2}),
            row(
                "tyre_relaxation",
                over_floor={"yaw_rate": 1.3},
                sizes={"tyre_relaxation": {"length": [0.6, 0.56, 0.64]}},
            ),
        ]
    )
    assert "sound trucks: 1 of 2 not adequate" in told
    assert "n = 3: named 3; truth in a class 3; interval holds 2 of 3" in told
    assert "same verdict at 50 Hz: 4 of 5" in told
    assert "at most 1.1 in 4 of 5 signals; largest 1.30 (yaw_rate" in told
    assert "accepted: 3; a signal of held-out runs worse than before: 1" in told


def test_the_floor_is_what_is_measured_minus_what_a_sensor_read_at_that_time():
    times = np.arange(5.0)
    truth = {
        "run_01": TrueRun(7_000_000_000, {"yaw_rate": lambda time: 2.0 * time, "heading": np.zeros_like}),
        "run_02": TrueRun(0, {"yaw_rate": np.zeros_like}),
    }
    late = 2.0  # of the first message after the start of the first run [s]
    turned = 2.0 * (times + late) + 0.3
    held_out = pd.concat(
        [
            pd.DataFrame({"run": "set/run_01", "time": times, "signal": "yaw_rate", "measured": turned}),
            pd.DataFrame({"run": "run_02", "time": times, "signal": "yaw_rate", "measured": 0.4}),
            pd.DataFrame(
                {"run": "set/run_01", "time": times, "signal": "heading", "measured": 2 * np.pi - 0.1}
            ),
            pd.DataFrame({"run": "run_02", "time": times, "signal": "position_across", "measured": 9.0}),
        ]
    )
    found = floors(held_out, truth, {"set/run_01": 9_000_000_000, "run_02": 0})
    assert found == pytest.approx({"yaw_rate": np.sqrt((0.3**2 + 0.4**2) / 2), "heading": 0.1})

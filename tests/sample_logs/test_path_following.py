"""The simulated controller: who steers when, and on what it acts."""

import numpy as np
import pytest
from generator.actuator import WheelState, held_response
from generator.messages import Topic
from generator.path_following import TASKS, follow
from generator.recorder import Recorder
from generator.runs import make_topics
from generator.vehicle import STEP


@pytest.fixture(scope="module", params=["path_a", "path_b"])
def name(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="module")
def topics(truth, name) -> dict[str, Topic]:
    return make_topics(name, truth, seed=4)


def seconds(topic: Topic) -> np.ndarray:
    return topic.stamps / 1e9


def test_while_engaged_the_wheel_is_the_actuators_answer_to_the_requests(truth, name):
    task = TASKS[name]
    done = follow(task, truth, Recorder(truth.recording, 4, name, task.duration), np.array([10.0, -5.0, 0.7]))
    half_steps = STEP / 2.0 * np.arange(len(done.wheel))
    sent_time = done.stamps / 1e9
    for begin, end in task.engaged:
        taken = (sent_time >= begin) & (sent_time < end)
        k = int(sent_time[taken][0] / STEP) * 2
        rate = np.gradient(done.wheel[k - 4 : k + 1], STEP / 2.0, edge_order=2)[-1]
        angle = done.wheel[k]
        start = WheelState(half_steps[k], angle, rate, angle / truth.steering.actuator.gain)
        times = half_steps[k : round(2.0 * end / STEP)]
        expected, _ = held_response(
            truth.steering.actuator, sent_time[taken], done.request[taken], times, start
        )
        np.testing.assert_allclose(done.wheel[k : k + len(times)], expected, rtol=0, atol=1e-5)
        assert np.ptp(expected) > 0.5


def test_requests_of_a_controller_that_is_not_engaged_are_not_acted_on(topics, name):
    request, engaged = topics["/control/steering_wheel_request"], topics["/control/engaged"]
    angle = topics["/vehicle/steering_wheel"]
    np.testing.assert_array_equal(request.stamps, engaged.stamps)
    idle = ~engaged.columns[0].astype(bool)
    assert 0.2 < np.mean(idle) < 0.6
    runs_of_idle = np.split(request.columns[0], np.flatnonzero(np.diff(idle)) + 1)[:: 2 if idle[0] else 1]
    for values in runs_of_idle:
        assert np.ptp(values) == 0.0
    at_idle = np.interp(seconds(request)[idle], seconds(angle), angle.columns[0])
    assert np.max(np.abs(at_idle - request.columns[0][idle])) > (0.1 if name == "path_a" else 1.0)


def test_the_controller_keeps_to_the_path(topics, name):
    reference, odometry = topics["/control/reference"], topics["/localization/odometry"]
    engaged = topics["/control/engaged"].columns[0].astype(bool)
    x, y, heading = reference.columns
    at_x, at_y = (np.interp(seconds(reference), seconds(odometry), odometry.columns[k]) for k in (0, 1))
    left = np.cos(heading) * (at_y - y) - np.sin(heading) * (at_x - x)
    ahead = np.cos(heading) * (at_x - x) + np.sin(heading) * (at_y - y)
    assert np.sqrt(np.mean(left[engaged] ** 2)) < 0.5
    assert (
        np.max(np.abs(ahead)) < 0.5
    )  # the reference is the nearest point, but for the delay of the odometry
    assert np.hypot(np.ptp(x), np.ptp(y)) > 400.0


def test_the_wheel_does_not_jump_when_it_changes_hands(topics):
    angle = topics["/vehicle/steering_wheel"].columns[0]
    assert np.max(np.abs(np.diff(angle))) < 0.05

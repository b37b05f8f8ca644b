"""The steering tests: what is sent, what the wheel does, what is measured and what the log keeps.

The actuator acts on every command that is sent, whatever the log loses.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .actuator import WheelState, held_response
from .commands import Command, Sine, pulses, pulses_end, sines, sines_end
from .recorder import Losses
from .sensors import generator, measure, schedule, seconds
from .truth import Steering

Array = NDArray[np.float64]

LEAD = 3.0  # [s] of commands before the recording begins
REQUEST = "/control/steering_wheel_request"
ANGLE = "/vehicle/steering_wheel"


@dataclass(frozen=True)
class SteeringTest:
    """A steering test: the command as a function of time [s], its duration [s] and what the log loses."""

    command: Command
    duration: float
    losses: Losses = field(default_factory=Losses)


@dataclass(frozen=True)
class SteeringSignals:
    """The steering of one run as arrays; times are [s] since the start of the recording.

    sent_time, sent : every command that the actuator received, also before the recording [rad]
    request_time, request : the commands that the log holds [rad]
    angle_time, angle : the measured angles that the log holds [rad]
    angle_true : the true angle at ``angle_time``, without error of the sensor [rad]
    """

    sent_time: Array
    sent: Array
    request_time: Array
    request: Array
    angle_time: Array
    angle: Array
    angle_true: Array


def steering_signals(test: SteeringTest | str, truth: Steering, seed: int) -> SteeringSignals:
    """Make the steering signals of one test, in memory.

    Parameters
    ----------
    test : a test, or the name of one of ``STEERING_TESTS``
    truth : the actuator and its sensors
    seed : of the sample phases, the jitter and the noise; the command stays the same
    """
    name = test if isinstance(test, str) else "steering"
    test = STEERING_TESTS[test] if isinstance(test, str) else test
    sent_stamps = schedule(truth.request, -LEAD, test.duration, generator(seed, name, REQUEST))
    sent_time = seconds(sent_stamps)
    sent = test.command(sent_time)
    random = generator(seed, name, ANGLE)
    angle_stamps = schedule(truth.angle, 0.0, test.duration, random)
    angle_time = seconds(angle_stamps)
    at_rest = WheelState(time=float(sent_time[0]), angle=0.0, rate=0.0, command=0.0)
    true, _ = held_response(truth.actuator, sent_time, sent, angle_time, at_rest)
    measured = measure(truth.angle.channels["angle"], true, random)
    logged = test.losses.kept(REQUEST, sent_stamps)
    heard = test.losses.kept(ANGLE, angle_stamps)
    return SteeringSignals(
        sent_time=sent_time,
        sent=sent,
        request_time=sent_time[logged],
        request=sent[logged],
        angle_time=angle_time[heard],
        angle=measured[heard],
        angle_true=true[heard],
    )


def _pulse_test(start: float, amplitudes: tuple[float, ...], losses: Losses) -> SteeringTest:
    return SteeringTest(pulses(start, amplitudes), pulses_end(start, amplitudes), losses)


def _sine_test(segments: list[Sine], pause: float, losses: Losses) -> SteeringTest:
    start = 2.0
    return SteeringTest(sines(start, segments, pause), sines_end(start, segments, pause) + 1.0, losses)


CYCLES = {0.1: 1.5, 0.2: 2.0, 0.5: 2.5, 1.0: 4.0, 2.0: 5.0, 3.0: 6.0, 5.0: 8.0, 7.0: 10.0, 10.0: 12.0}
SHUFFLED = (1.0, 0.2, 10.0, 0.5, 5.0, 0.1, 3.0, 7.0, 2.0)

STEERING_TESTS: dict[str, SteeringTest] = {
    # The command that begins the third pulse is sent and acted on, and is not in the log.
    "steering_pulses_a": _pulse_test(
        2.0,
        (np.pi / 4, -np.pi / 3, np.pi / 2, -np.pi / 4, np.pi / 3, -np.pi / 2),
        Losses(messages=((REQUEST, 16.0),)),
    ),
    # The first pulse begins a moment before the log; the fourth begins inside the gap.
    "steering_pulses_b": _pulse_test(
        -0.07,
        (np.pi / 4, np.pi / 3, -np.pi / 2, -np.pi / 3, np.pi / 2, -np.pi / 4),
        Losses(gap=(20.80, 21.32)),
    ),
    "steering_sines_a": _sine_test(
        [Sine(frequency, 0.4, cycles) for frequency, cycles in CYCLES.items()],
        2.0,
        Losses(messages=((ANGLE, 31.4),)),
    ),
    "steering_sines_b": _sine_test(
        [Sine(frequency, 0.3 if frequency > 4.0 else 0.5, CYCLES[frequency]) for frequency in SHUFFLED],
        0.0,
        Losses(),
    ),
}

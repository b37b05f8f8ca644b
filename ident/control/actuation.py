"""What lies between a command and the truck: steering and drive, solved exactly for held commands.

Steering (2.25), with play, dead zone and limited rate where the actuator has them:

    request -> dead zone -> gain -> dead time -> two lags -> play: measured angle -> ratio map -> road wheels

Drive, with the request clipped to what the truck can do and v never below ``LOWEST_SPEED``:

    T ȧ = a_request(t - L) - a,      v̇_x = a

Commands are held, so both are sums of exponentials between two events. A command takes effect exactly when
its dead time is over, wherever that falls within a step; nothing here depends on the step of integration.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ident.control.truck import Drive, SteeringActuator
from ident.dynamics.actuator_nonlinear import Lags, nonlinear_response
from ident.dynamics.blocks import play, ratio_map
from ident.dynamics.effects.steering_dead_zone import dead_zone

Array = NDArray[np.float64]

LOWEST_SPEED = 0.1  # [m/s] the truck never stands: road-aligned equations divide by its speed
LONG_AGO = 1e6  # [s] before the start, when the command was sent that holds at first
AT_THE_END = 1e-9  # of the play's width, within which it counts as used up


@dataclass
class Pending:
    """Held commands, those that are still on their way among them.

    dead_time : [s]; times, values : of the commands, from the one that is in force
    """

    dead_time: float
    times: list[float]
    values: list[float]

    def send(self, time: float, value: float) -> None:
        """Add a command; times never fall, and of two at one time the later counts."""
        if time == self.times[-1]:
            self.values[-1] = value
        else:
            self.times.append(time)
            self.values.append(value)

    def arrivals(self, begin: float, end: float) -> list[float]:
        """Times strictly between two at which a command takes effect [s]."""
        return [t + self.dead_time for t in self.times[1:] if begin < t + self.dead_time < end]

    def pieces(self, begin: float, end: float) -> list[tuple[float, float, float]]:
        """(begin, end, value in force) of each part of a time in which one command holds [s]."""
        edges = [begin, *self.arrivals(begin, end), end]
        place = max(sum(t + self.dead_time <= begin for t in self.times) - 1, 0)
        return [(first, last, self.values[place + i]) for i, (first, last) in enumerate(pairwise(edges))]

    def forget(self, now: float) -> None:
        """Drop what is no longer in force."""
        while len(self.times) > 1 and self.times[1] + self.dead_time <= now:
            del self.times[0], self.values[0]


@dataclass
class SteeringMotion:
    """State of the steering of a simulated truck.

    linkage_play : width of a play between measured angle and road wheels [rad at the road wheels]
    highest_angle : of the road wheels [rad]
    """

    actuator: SteeringActuator
    highest_angle: float
    linkage_play: float
    angle: float
    time: float = 0.0
    pending: Pending = field(init=False)
    _lags: Lags = field(init=False)
    _state: Array = field(init=False)
    _first: float = field(init=False)
    _road: float = field(init=False)

    def __post_init__(self) -> None:
        one = self.actuator
        first, second = one.time_constant_1, one.time_constant_2
        rate = np.inf if one.rate_limit is None else one.rate_limit
        self._lags = Lags(first + second, first * second, first, second, np.zeros((2, 4)), rate, one.play)
        self.pending = Pending(one.dead_time, [self.time - LONG_AGO], [self.angle])
        self._state = np.array([self.angle, 0.0, self.angle])
        self._first = self.angle
        self._road = float(self._mapped(np.array([self.angle]))[0])

    def send(self, time: float, request: float) -> None:
        """Take a request [rad] at a time [s]."""
        asked, _, _ = dead_zone(np.array([request]), self.actuator.dead_zone)
        self.pending.send(time, self.actuator.gain * float(asked[0]))

    def events(self, begin: float, end: float, step: float) -> list[float]:
        """Times strictly between two where the grid of the integration needs points.

        They are those at which a request takes effect, and after each, where a lag is shorter than the step
        [s], times that double from that lag on: an angle that nearly jumps is followed as well.
        """
        arrivals = [time + self.pending.dead_time for time in self.pending.times]
        lag = min(self._lags.first, self._lags.second)
        doublings = math.ceil(math.log2(step / lag)) if lag < step else 0
        after = [time + lag * 2.0**n for time in arrivals for n in range(doublings)]
        return [time for time in (*arrivals, *after) if begin < time < end]

    def advance(self, times: Array) -> tuple[Array, Array, Array]:
        """Move to the last of the times, of which the first is now.

        times : (n,) [s]

        Returns
        -------
        angle, rate : (n,) measured, before the ratio map [rad], [rad/s]
        road : (n,) of the road wheels [rad]
        """
        sent, values = np.array(self.pending.times), np.array(self.pending.values)
        command = (sent, values, np.zeros((sent.size, 0)))
        start = (self._state, np.zeros((3, 0)))
        out, _ = nonlinear_response(self._lags, self.actuator.dead_time, command, times, start)
        self._keep(out[-1], times)
        self.pending.forget(times[-1])
        road, _ = play(self._mapped(out[:, 0]), self.linkage_play, start=self._road)
        self._road = float(road[-1])
        return out[:, 0], self._measured_rate(out), road

    def _keep(self, end: Array, times: Array) -> None:
        """The state at the end; where the rate is limited, that of the second lag as if it were not.

        The first lag is not limited: its own response to the same commands gives x, and v = (x - y)/T2.
        """
        for begin, until, towards in self.pending.pieces(times[0], times[-1]):
            left = np.exp(-(until - begin) / self._lags.first)
            self._first = towards + (self._first - towards) * float(left)
        z, y, rate = end
        if abs(rate) >= self._lags.rate:
            rate = (self._first - y) / self._lags.second
        self._state, self.time = np.array([y, rate, z]), float(times[-1])

    def _measured_rate(self, out: Array) -> Array:
        """Rate of what the sensor sees: it stands while the column is within the play."""
        angle, column, rate = out.T
        ahead = column - angle
        used_up = 0.5 * self._lags.width * (1 - AT_THE_END)
        return np.asarray(np.where(ahead * np.sign(rate) >= used_up, rate, 0.0))

    def _mapped(self, angle: Array) -> Array:
        road, _ = ratio_map(self.actuator.ratio, angle)
        return np.asarray(np.clip(road, -self.highest_angle, self.highest_angle))


@dataclass
class DriveMotion:
    """State of the longitudinal motion of a simulated truck.

    speed : v_x [m/s]; acceleration : [m/s²]
    """

    drive: Drive
    speed: float
    acceleration: float = 0.0
    time: float = 0.0
    pending: Pending = field(init=False)

    def __post_init__(self) -> None:
        self.pending = Pending(self.drive.dead_time, [self.time - LONG_AGO], [self.acceleration])

    def send(self, time: float, request: float) -> None:
        """Take a request [m/s²] at a time [s]."""
        self.pending.send(time, float(np.clip(request, self.drive.lowest, self.drive.highest)))

    def advance(self, times: Array) -> tuple[Array, Array]:
        """Move to the last of the times, of which the first is now: (n,) [s] -> speed, acceleration (n,)."""
        speed, acceleration = np.empty(times.size), np.empty(times.size)
        speed[-1], acceleration[-1] = self.speed, self.acceleration
        for begin, end, towards in self.pending.pieces(times[0], times[-1]):
            here = (times >= begin) & (times < end)
            moved, changed = self._piece(towards, np.append(times[here], end) - begin)
            speed[here], acceleration[here] = moved[:-1], changed[:-1]
            speed[-1], acceleration[-1] = moved[-1], changed[-1]
        self.time = float(times[-1])
        self.pending.forget(self.time)
        return speed, acceleration

    def _piece(self, towards: float, since: Array) -> tuple[Array, Array]:
        """Speed and acceleration (n,) under one command, at rising times since now [s]; then is now."""
        lag, missing = self.drive.lag, self.acceleration - towards
        left = missing * np.exp(-since / lag) if lag > 0 else np.zeros(since.size)
        acceleration = towards + left
        free = self.speed + towards * since + lag * (missing - left if lag > 0 else 0.0)
        lacking = np.maximum(LOWEST_SPEED - np.minimum.accumulate(free), 0.0)
        speed = free + lacking
        self.speed, self.acceleration = float(speed[-1]), float(acceleration[-1])
        standing = (speed <= LOWEST_SPEED) & (acceleration < 0)
        return speed, np.where(standing, 0.0, acceleration)

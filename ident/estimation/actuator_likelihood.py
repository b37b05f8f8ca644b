"""Maximum likelihood of the steering actuator K exp(-L s) / ((T1 s + 1)(T2 s + 1)) (2.25).

Every uninterrupted stretch of a log is one record: the exact response to the held command on the
raw stamps, with coloured noise. theta = (K, L, a1, rho, bias of each run), a1 = T1 + T2, rho = T1 T2 / a1²;
rho = 1/4 is critical damping, larger is underdamped, zero is first order, and the likelihood is regular
through all of it. Local to a record are

* the initial angle and rate of the output;
* the command before the first recorded one, which still acts during the first L seconds, as its distance from
  the initial angle: where the output was at rest, both this and the rate are zero within what rest means
  (prior: the tolerance of the test for rest);
* how much earlier than its stamp the first recorded command took effect (prior: its period / sqrt 3, the
  root mean square of "at most one sample");
* the value of each command message that the log has lost, where the command was changing.

The covariance of (K, L, T1, T2) follows from that of theta; intervals of T1 and T2 from their profile
likelihood, because they are far from parabolic near critical damping and near T2 = 0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ident.dynamics.second_order import free_response, held_response, impulse_response, step_response
from ident.estimation.noise import Linearised

Array = NDArray[np.float64]

GAIN, DEAD_TIME, SUM, RATIO, BIAS = range(5)
SHORTEST_LAG_SHARE = 1e-4  # rho: T2 below 1e-4 T1 is first order
LARGEST_RATIO = 25.0  # rho: damping ratio 0.1
DEAD_TIME_RANGE = (-0.2, 2.0)  # [s]
SUM_RANGE = (1e-3, 20.0)  # [s]
FIXED_LOCALS = 4
LONGEST_HOLD = 0.05  # [s] of a command, before it is said again
HOLD_MARGIN = 0.5  # of that
REST_LAG = 0.5  # [s] by which an output that creeps at some rate is behind its command


@dataclass(frozen=True)
class Push:
    """What a unit of a generic term adds to a record.

    request : (m,) to its commands, None where nothing; angle : (n,) to the modelled angle, None likewise
    """

    request: Array | None = None
    angle: Array | None = None


@dataclass(frozen=True)
class ActuatorRecord:
    """One uninterrupted stretch of request and measured angle.

    run : index of the run, which has one bias
    command_times, command_values : (m,) held command [s], [rad]; lost ones are in place, with a guess
    times, measured : (n,) [s], [rad]
    starts : indices of ``times`` at which the noise restarts
    lost : indices of the commands whose value the log has lost
    start_uncertainty : root mean square of how early the first command may have been [s]; infinite where
        nothing is known of it
    rest_rate : standard deviation of the rate that an output "at rest" may have had when the record began
        [rad/s]; infinite where it was not at rest: the first samples, up to the dead time, then answer to
        commands that nobody knows, see :func:`without_unknown_head`
    terms : generic term -> what a unit of it adds here; of those that models may have
    """

    run: int
    command_times: Array
    command_values: Array
    times: Array
    measured: Array
    starts: NDArray[np.intp]
    lost: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    start_uncertainty: float = 0.0
    rest_rate: float = np.inf
    terms: Mapping[str, Push] = field(default_factory=dict)

    @property
    def first(self) -> float:
        """First recorded command [rad]."""
        return float(self.command_values[0])


def without_unknown_head(record: ActuatorRecord, dead_time: float) -> ActuatorRecord:
    """Leave out the samples that answer to commands before a record that did not begin at rest."""
    if np.isfinite(record.rest_rate):
        return record
    begin = int(np.searchsorted(record.times, record.command_times[0] + dead_time))
    starts = np.unique(np.append(0, record.starts[record.starts >= begin] - begin)).astype(np.intp)
    return replace(record, times=record.times[begin:], measured=record.measured[begin:], starts=starts)


def with_repeats(record: ActuatorRecord) -> ActuatorRecord:
    """Say long-held commands again every ``LONGEST_HOLD``, which changes nothing of the answer.

    What is added to the commands and changes while they are held has its place then. The first command, whose
    time is uncertain, and lost ones are left alone.
    """
    ends = np.append(record.command_times[1:], max(record.times[-1], record.command_times[-1]))
    count = np.maximum(np.ceil((ends - record.command_times) / LONGEST_HOLD - HOLD_MARGIN), 1).astype(np.intp)
    count[0] = 1
    count[record.lost] = 1
    first = np.cumsum(count) - count
    of = np.repeat(np.arange(count.size), count)
    part = (np.arange(of.size) - first[of]) / count[of]
    times = record.command_times[of] + part * (ends - record.command_times)[of]
    lost = first[record.lost].astype(np.intp)
    return replace(record, command_times=times, command_values=record.command_values[of], lost=lost)


class ActuatorProblem:
    """The records of all runs with the model (2.25) as an output-error problem."""

    def __init__(
        self, records: Sequence[ActuatorRecord], runs: int | None = None, ratio: float | None = None
    ) -> None:
        """Take the records: at least one, each with at least one sample, of ``runs`` runs in all.

        ratio : rho, where it is held
        """
        self.records = list(records)
        self.ratio_range = (SHORTEST_LAG_SHARE, LARGEST_RATIO) if ratio is None else (ratio, ratio)
        self.runs = 1 + max(record.run for record in records) if runs is None else runs

    def inside(self, shared: Array) -> Array:
        """Clip to the physical region."""
        low = np.full(shared.size, -np.inf)
        high = np.full(shared.size, np.inf)
        low[DEAD_TIME], high[DEAD_TIME] = DEAD_TIME_RANGE
        low[SUM], high[SUM] = SUM_RANGE
        low[RATIO], high[RATIO] = self.ratio_range
        return np.asarray(np.clip(shared, low, high))

    def start(self, shared: Array) -> list[Array]:
        """Local parameters to begin with: at rest at the first measured angle, command unchanged."""
        return [self._local_start(record, shared) for record in self.records]

    @staticmethod
    def _local_start(record: ActuatorRecord, shared: Array) -> Array:
        lost = shared[GAIN] * record.command_values[record.lost]
        angle = record.measured[0] - shared[BIAS + record.run]
        return np.concatenate([[angle, 0.0, 0.0, 0.0], lost])

    def linearise(self, shared: Array, local: Sequence[Array]) -> list[Linearised]:
        """Residual and exact derivatives of every record."""
        return [self._linearise(r, shared, x) for r, x in zip(self.records, local, strict=True)]

    def simulate(self, shared: Array, local: Sequence[Array]) -> list[Array]:
        """(n,) modelled angle of every record [rad]."""
        return [
            r.measured - x.residual for r, x in zip(self.records, self.linearise(shared, local), strict=True)
        ]

    def _linearise(self, record: ActuatorRecord, shared: Array, local: Array) -> Linearised:
        gain, dead_time, a1, ratio = shared[:BIAS]
        a2 = ratio * a1**2
        angle, rate, ahead, shift = local[:FIXED_LOCALS]
        before = angle + ahead
        values, times = self._drive(record, gain, before, shift, local[FIXED_LOCALS:])
        response = held_response(
            dead_time, a1, a2, times, values, record.times, initial_angle=angle, initial_rate=rate
        )
        free = free_response(a1, a2, record.times - record.times[0])
        columns = self._local_columns(record, shared, times, before, free)
        own = columns[:, [0, 1, 2, *range(FIXED_LOCALS, columns.shape[1])]]
        by_local = own @ np.concatenate([local[:3], local[FIXED_LOCALS:]])
        jacobian = np.zeros((record.times.size, shared.size))
        jacobian[:, GAIN] = (response[:, 0] - by_local) / gain
        drive = _drive_at_start(times, values, dead_time, record.times[0])
        jacobian[:, DEAD_TIME] = -_forced_rate(response[:, 1], free, a1, a2, angle - drive, rate)
        jacobian[:, SUM] = response[:, 2] + 2 * ratio * a1 * response[:, 3]
        jacobian[:, RATIO] = a1**2 * response[:, 3]
        jacobian[:, BIAS + record.run] = 1.0
        residual = record.measured - response[:, 0] - shared[BIAS + record.run]
        prior = np.full(local.size, np.inf)
        prior[1:FIXED_LOCALS] = (
            record.rest_rate,
            record.rest_rate * REST_LAG,
            max(record.start_uncertainty, 1e-9),
        )
        left = np.zeros(local.size)
        left[1:FIXED_LOCALS] = -local[1:FIXED_LOCALS]
        return Linearised(record.times, residual, jacobian, columns, record.starts, prior, left)

    @staticmethod
    def _drive(
        record: ActuatorRecord, gain: float, before: float, shift: float, lost: Array
    ) -> tuple[Array, Array]:
        """Command in units of the output, with the unknown one before it in front."""
        values = gain * record.command_values
        values[record.lost] = lost
        times = record.command_times.copy()
        times[0] += shift
        long_ago = min(times[0], record.times[0]) - 1e6
        return np.concatenate([[before], values]), np.concatenate([[long_ago], times])

    @staticmethod
    def _local_columns(
        record: ActuatorRecord, shared: Array, times: Array, before: float, free: tuple[Array, Array]
    ) -> Array:
        gain, dead_time, a1, ratio = shared[:BIAS]
        a2 = ratio * a1**2
        since_first = record.times - times[1] - dead_time
        matters = float(times[1] + dead_time > record.times[0])  # what was before the first still acts
        unknown = matters * (1 - free[0] - step_response(a1, a2, since_first))
        size = gain * record.first - before
        earlier = -matters * size * impulse_response(a1, a2, since_first)
        ends = np.append(times[1:], np.inf)
        lost = [
            step_response(a1, a2, record.times - times[i + 1] - dead_time)
            - step_response(a1, a2, record.times - ends[i + 1] - dead_time)
            for i in record.lost
        ]
        return np.column_stack([free[0] + unknown, free[1], unknown, earlier, *lost])


def _drive_at_start(times: Array, values: Array, dead_time: float, now: float) -> float:
    """Command that acts at the first sample."""
    index = max(int(np.searchsorted(times + dead_time, now, side="right")) - 1, 0)
    return float(values[index])


def _forced_rate(
    rate: Array, free: tuple[Array, Array], a1: float, a2: float, deviation: float, initial_rate: float
) -> Array:
    """Rate of what the commands after the first sample have caused, from zero [rad/s]."""
    c, s = free
    return rate - (-s / a2 * deviation + (c - a1 / a2 * s) * initial_rate)

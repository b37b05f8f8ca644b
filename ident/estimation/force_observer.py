"""Axle forces as states of their own, observed from the motion: no tyre model, with bands.

The bicycle whose tyres are replaced by free forces (``dynamics.effects.free_forces``) holds mass, yaw inertia
and geometry only. Its lateral velocity, yaw rate, both forces and their rates of change are the states;
measured are yaw rate, lateral acceleration and, where it is there, lateral velocity. This is the observer of
Dakhlallah et al. (2008) and of Baffet, Charara and Lechner (2009) with two changes. Their forces follow a
tyre model with a relaxation length, here they wander: what comes out owes nothing to a tyre. And logs are
complete when they are looked at, so the extended Kalman filter is followed by the fixed-interval smoother: a
filter knows the past only, is late and about twice as uncertain.

The one thing to be tuned is how fast the forces may change: the rates of change are random walks of intensity
q times the load of the axle, and q is where the innovations of all records are most likely. The noise of the
sensors is given. Coloured noise counts by its density at low frequencies, where the motion of a truck lies.

Linearisation: at known inputs all is linear but the accelerometer's y_imu r², which is taken along the
measured yaw rate. The matrices are those of the compiled model.

Bands are ± 1.96 standard deviations of the smoother. They hold what the noise of the sensors leaves open;
an error of the mass is one of the scale of both forces, an error of the yaw inertia adds a part ∝ ṙ, and
biases that nobody takes out add a part that does not change: none of these is in the bands.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.stats import chi2, norm

from ident.errors import NotIdentifiable
from ident.estimation.force_system import MEASURED, ForceProblem, ForceVehicle, is_measured
from ident.estimation.kalman import Filtered, LinearSystem, filtered, smoothed
from ident.estimation.noise import AutoRegression, NoiseModel
from ident.estimation.smooth_motion import usual_inertia
from ident.estimation.tyre_fit import Body
from ident.estimation.vehicle_records import MotionRecord, cut

Array = NDArray[np.float64]

SLOWEST, FASTEST = 1e-3, 1e3  # q [s^-1.5]
STILL = 3e-3  # q below which the forces do not change
LEVEL = float(norm.ppf(0.975))
BLOCK = 0.25  # [s]
PIECE, SEARCHED = 300.0, 900.0  # [s] a record is cut into; of all records by which the rate is found


@dataclass(frozen=True)
class Consistency:
    """Mean squared innovation over its variance (NIS) of one signal: one where filter and noise are right.

    They are those of blocks of ``BLOCK`` seconds, so that noise that is coloured within a block counts by its
    density below, which is what the filter was given.

    low, high : where the mean lies with 99 % for independent blocks; blocks : how many
    """

    mean: float
    low: float
    high: float
    blocks: int


@dataclass(frozen=True)
class ObservedForces:
    """Forces and slip angles of both axles, one row a grid point, all records one after another.

    run : (n,) index of the run; times : (n,) since the start of the run [s]
    forces : (n, 2) front and rear, each across its own wheels [N]; force_std : their standard deviations
    slip_angles, slip_std : (n, 2) [rad]; NaN in records without a measured lateral velocity
    yaw_rate, lateral_velocity : (n,) of the CG; the latter NaN where the slip angles are
    rate : q, by how much of its load the rate of change of a force wanders [s^-1.5]
    consistency : signal -> of its innovations
    """

    run: NDArray[np.intp]
    times: Array
    forces: Array
    force_std: Array
    slip_angles: Array
    slip_std: Array
    yaw_rate: Array
    lateral_velocity: Array
    rate: float
    consistency: Mapping[str, Consistency]

    def band(self, axle: str) -> tuple[Array, Array]:
        """Both ends (n,) of the 95 % band of the force of the "front" or "rear" axle [N]."""
        column = ("front", "rear").index(axle)
        half = LEVEL * self.force_std[:, column]
        return self.forces[:, column] - half, self.forces[:, column] + half


def observe_forces(
    records: Sequence[MotionRecord],
    body: Body,
    noise: Mapping[str, NoiseModel],
    *,
    yaw_inertia: float | None = None,
    bias: Mapping[int, Mapping[str, float]] | None = None,
    rate: float | None = None,
) -> ObservedForces:
    """Observe the forces of both axles in records of uninterrupted motion.

    Parameters
    ----------
    noise : of the sensors, of each signal in ``MEASURED`` that is to be used; the others are not
    yaw_inertia : [kg m²]; None: as stated for the body, else m l_f l_r
    bias : run -> signal -> what is subtracted from it; "steering_offset" -> what is added to the road-wheel
        angle; "lateral_velocity_by_speed" -> what, times the speed, is subtracted from the lateral velocity
    rate : q where it is known; None: by maximum likelihood of the innovations of all records

    Raises
    ------
    NotIdentifiable
        If no record holds a yaw rate together with a lateral acceleration or a lateral velocity, or the
        forces do not change by more than the noise of the sensors.
    """
    used = [name for name in MEASURED if name in noise]
    known = [part for record in records if _observable(record, used) for part in cut(record, PIECE)]
    if not known:
        raise NotIdentifiable(_missing(records, used))
    inertia = usual_inertia(body) if yaw_inertia is None else yaw_inertia
    vehicle = ForceVehicle(body, inertia, bias or {}, {name: white_variance(noise[name]) for name in used})
    if rate is None:
        rate = most_likely_rate([vehicle.problem(record).system for record in _some(known)])
    parts = [_piece(vehicle.problem(record), rate) for record in known]
    rows = [np.concatenate(columns) for columns in zip(*(part.rows for part in parts), strict=True)]
    counts = [record.times.size for record in known]
    return ObservedForces(
        run=np.repeat([record.run for record in known], counts).astype(np.intp),
        times=np.concatenate([record.times for record in known]),
        forces=rows[0],
        force_std=rows[1],
        slip_angles=rows[2],
        slip_std=rows[3],
        yaw_rate=rows[4],
        lateral_velocity=rows[5],
        rate=rate,
        consistency=_consistency(used, [part.blocks for part in parts]),
    )


def most_likely_rate(systems: Sequence[LinearSystem]) -> float:
    """Return q of the largest likelihood of all innovations [s^-1.5].

    Raises
    ------
    NotIdentifiable
        If the likelihood does not fall towards forces that do not change.
    """

    def cost(logarithm: float) -> float:
        return -sum(filtered(one, float(np.exp(2 * logarithm))).log_likelihood for one in systems)

    ends = (np.log(SLOWEST), np.log(FASTEST))
    found = minimize_scalar(cost, bounds=ends, method="bounded", options={"xatol": 0.02})
    rate = float(np.exp(found.x))
    if rate < STILL:
        raise NotIdentifiable(
            f"the forces of the axles change by {rate:.1g} of the load per s^1.5, need {STILL:g} to stand "
            "out of the noise of the sensors: add runs that turn"
        )
    return rate


def _some(records: Sequence[MotionRecord]) -> list[MotionRecord]:
    """Records evenly from all of them, together about ``SEARCHED`` seconds or all there are."""
    seconds = sum(float(record.times[-1] - record.times[0]) for record in records)
    return list(records[:: max(1, int(np.ceil(seconds / SEARCHED)))])


def _observable(record: MotionRecord, used: Sequence[str]) -> bool:
    own = [name for name in used if is_measured(record, name)]
    return "yaw_rate" in own and len(own) > 1


def _missing(records: Sequence[MotionRecord], used: Sequence[str]) -> str:
    there = sorted({name for record in records for name in record.measured} & set(used))
    return (
        f"no record tells the forces of two axles: measured with known noise {there or 'nothing'}, "
        "need yaw_rate and one of lateral_acceleration, lateral_velocity: map one of them"
    )


def white_variance(noise: NoiseModel) -> float:
    """Variance per sample of the white noise that has the density of this one at low frequencies."""
    if isinstance(noise.shape, AutoRegression):
        return float((noise.std / (1 - np.sum(noise.shape.coefficients))) ** 2)
    return noise.total_std**2


@dataclass(frozen=True)
class _Piece:
    """What comes of one record.

    rows : columns of ``ObservedForces`` from ``forces`` to ``lateral_velocity``, on its grid
    blocks : of each signal in use, the normalised innovations of blocks
    """

    rows: tuple[Array, ...]
    blocks: list[Array]


def _piece(problem: ForceProblem, rate: float) -> _Piece:
    found = filtered(problem.system, rate**2)
    columns = range(found.innovations.shape[1])
    return _Piece(_observed(problem, found), [_blocks(problem, found, column) for column in columns])


def _observed(problem: ForceProblem, found: Filtered) -> tuple[Array, ...]:
    """Columns of ``ObservedForces`` from ``forces`` to ``lateral_velocity``, on the grid of the record."""
    states, covariances = (each[problem.grid] for each in smoothed(problem.system, found))
    std = np.sqrt(np.maximum(0.0, np.diagonal(covariances, axis1=1, axis2=2)))
    if not problem.slips:
        nothing = np.full((len(states), 2), np.nan)
        return states[:, 2:4], std[:, 2:4], nothing, nothing, states[:, 1], nothing[:, 0]
    slips, gradient = problem.slip_angles(states)
    variance = np.einsum("kai,kij,kaj->ka", gradient, covariances, gradient)
    return states[:, 2:4], std[:, 2:4], slips, np.sqrt(variance), states[:, 1], states[:, 0]


def _consistency(used: Sequence[str], parts: Sequence[Sequence[Array]]) -> dict[str, Consistency]:
    made = {}
    for name, blocks in zip(used, zip(*parts, strict=True), strict=True):
        squares = np.concatenate(blocks) ** 2
        if squares.size:
            low, high = (float(chi2.ppf(level, squares.size)) / squares.size for level in (0.005, 0.995))
            made[name] = Consistency(float(squares.mean()), low, high, squares.size)
    return made


def _blocks(problem: ForceProblem, found: Filtered, column: int) -> Array:
    """Sums of normalised innovations over blocks, each over the root of their number."""
    seen = np.isfinite(found.innovations[:, column])
    normal = found.innovations[seen, column] / np.sqrt(found.variances[seen, column])
    block = np.floor((problem.stamps[seen] - problem.stamps[0]) / BLOCK).astype(np.intp)
    counts = np.bincount(block)
    return np.asarray((np.bincount(block, normal) / np.sqrt(np.maximum(counts, 1)))[counts > 0])

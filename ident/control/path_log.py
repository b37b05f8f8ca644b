"""The path of a log as a line that can be followed: points that scatter and stand still become a curve.

Each coordinate is a spline of degree 5 in the way along the path, with a penalty on its third derivative
(which is, for a gentle path, the rate of the curvature and so that of the steering):

    sum (x_i - f(u_i))² + λ ∫ f'''² du,      λ = (Λ/2π)⁶ / h,      gain at wavelength W: 1/(1 + (Λ/W)⁶)

Λ [m] is the wavelength at which the curve follows half of what the points do; h is their mean distance. It
is the one that tells best where points are that were left out, 5 m of the path at a time. Rules that leave
out one point at a time, or that take the noise for white, follow the slow errors of a localisation and give
them for curvature (Opsomer, Wang and Yang 2001, "Nonparametric regression with correlated errors",
doi:10.1214/ss/1009213287).

The way along the path is at first that from point to point, which noise makes too long, then that of the
nearest point of the curve before. Points of one small stretch count together, so that a stop weighs no more
than a passage. Curvature and heading are those of the curve, so they agree with its positions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.linalg import solveh_banded
from scipy.ndimage import median_filter
from scipy.sparse import diags_array

from ident.control.paths import SPACING, Path
from ident.control.reference import Reference
from ident.control.scenarios import timed_reference
from ident.control.speed_profile import given_profile
from ident.control.truck import Truck
from ident.errors import NotIdentifiable

Array = NDArray[np.float64]

DEGREE = 5
SHORTEST = 30.0  # [m] of a path that says something about a controller
SLOWEST = 1.0  # [m/s] below which the truck is taken to stand
WIDEST_GAP = 10.0  # [m] between points next to each other
CHORDS = (1.0, 2.0, 4.0)  # [m] between the points of the first guess; longer where noise turns them back
FIRST_WAVELENGTH = 16.0  # [m]
SHARPEST_TURN = np.deg2rad(100.0)  # between two chords; what is sharper goes back
STRETCH = 0.25  # [m] in which points count together
WAVELENGTHS = np.geomspace(6.0, 100.0, 18)  # [m]
LEFT_OUT = 5.0  # [m] of the path, FOLDS times in turn
FOLDS = 4
KNOTS_OF_WAVELENGTH = 4.0
ROUNDS = 2
NEWTON_ROUNDS = 5


@dataclass(frozen=True)
class LoggedPath:
    """What a log says of the path.

    speed : (n,) at the points of the path [m/s]
    scatter : RMS distance of the points from the curve [m]
    wavelength : Λ, below which the curve does not follow the points [m]
    lost : what was left out, in words
    """

    path: Path
    speed: Array
    scatter: float
    wavelength: float
    lost: tuple[str, ...]


@dataclass(frozen=True)
class _Points:
    """(n,) coordinates [m] and speed [m/s] in the order in which they were driven."""

    x: Array
    y: Array
    speed: Array

    def at(self, places: NDArray[np.int64] | slice) -> _Points:
        return _Points(self.x[places], self.y[places], self.speed[places])


def reference_of_log(logged: LoggedPath, truck: Truck, *, tracked_x: float = 0.0) -> Reference:
    """What a controller has to follow to drive the path of a log at the logged speeds.

    tracked_x : of the point that the path is of, forward of the centre of gravity [m]

    Raises
    ------
    BadRecipe
        If the truck cannot corner like that.
    """
    profile = given_profile(logged.path.arc_length, logged.speed)
    return timed_reference(logged.path, profile, truck, tracked_x=tracked_x)


def path_of_log(
    name: str,
    x: Array,
    y: Array,
    speed: Array,
    *,
    heading: Array | None = None,
) -> LoggedPath:
    """The path through logged points: those of a reference, or those of the truck itself.

    Parameters
    ----------
    name : of the run
    x, y : (n,) [m]; speed : (n,) [m/s]; any may hold NaN
    heading : (n,) of the path [rad], to tell whether it was driven forwards

    Raises
    ------
    NotIdentifiable
        If the path is too short, has a gap, goes back, or is driven backwards.
    """
    points, lost = _driven(name, x, y, speed, heading)
    kept = _skeleton(name, points)
    along = _from_point_to_point(points, kept)
    curve = _Curve.through(along[kept], points.at(kept), FIRST_WAVELENGTH)
    for _ in range(ROUNDS):
        along = curve.nearest(along, points)
        places, gathered = _gathered(along, points)
        wavelength = _chosen(places, gathered)
        curve = _Curve.through(places, gathered, wavelength)
    scatter = curve.scatter(curve.nearest(along, points), points)
    path, own_speed = curve.sampled(name)
    return LoggedPath(path, own_speed, scatter, wavelength, lost)


def _driven(
    name: str, x: Array, y: Array, speed: Array, heading: Array | None
) -> tuple[_Points, tuple[str, ...]]:
    """The longest stretch of finite points in which the truck moves."""
    finite = np.isfinite(x) & np.isfinite(y) & np.isfinite(speed)
    points = _Points(*(np.asarray(column, dtype=np.float64)[finite] for column in (x, y, speed)))
    lost = [f"{np.sum(~finite)} of {finite.size} points without a number"] if not finite.all() else []
    if points.x.size == 0:
        raise NotIdentifiable(f"{name}: no point of the path has a number: map its signals")
    moves = median_filter(points.speed, 5, mode="nearest") >= SLOWEST
    edges = np.flatnonzero(np.diff(np.concatenate([[False], moves, [False]]).astype(np.int8)))
    stretches = [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
    if not stretches:
        raise NotIdentifiable(
            f"{name}: the highest speed on the path is {points.speed.max():.2g} m/s, need {SLOWEST:g} m/s: "
            "take a run that drives"
        )
    longest = max(stretches, key=lambda part: _way(points.at(part)))
    if len(stretches) > 1:
        lost.append(f"{len(stretches) - 1} of {len(stretches)} stretches between stops: the longest is taken")
    if heading is not None:
        _refuse_backwards(name, points.at(longest), np.asarray(heading)[finite][longest])
    return points.at(longest), tuple(lost)


def _way(points: _Points) -> float:
    """Distance from the first point to the one furthest from it [m]: noise does not make it grow."""
    return float(np.max(np.hypot(points.x - points.x[0], points.y - points.y[0])))


def _refuse_backwards(name: str, points: _Points, heading: Array) -> None:
    """Refuse if most of the way was driven against the heading."""
    dx, dy = np.diff(points.x), np.diff(points.y)
    forward = dx * np.cos(heading[:-1]) + dy * np.sin(heading[:-1])
    if np.nansum(forward) < 0:
        raise NotIdentifiable(
            f"{name}: the path runs {-np.nansum(forward):.0f} m backwards: take another run"
        )


def _apart(points: _Points, distance: float) -> NDArray[np.int64]:
    """The first point, then each that is this far from the one taken before [m]."""
    kept, last_x, last_y = [0], points.x[0], points.y[0]
    for i, (x, y) in enumerate(zip(points.x.tolist(), points.y.tolist(), strict=True)):
        if (x - last_x) ** 2 + (y - last_y) ** 2 >= distance**2:
            kept.append(i)
            last_x, last_y = x, y
    return np.array(kept)


def _skeleton(name: str, points: _Points) -> NDArray[np.int64]:
    """Places of points so far apart that noise does not turn the way between them back."""
    gap = float(np.max(np.hypot(np.diff(points.x), np.diff(points.y)), initial=0.0))
    if gap > WIDEST_GAP:
        raise NotIdentifiable(
            f"{name}: two neighbouring points of the path are {gap:.3g} m apart, need {WIDEST_GAP:g} m: "
            "cut the run there"
        )
    for distance in CHORDS:
        kept = _apart(points, distance)
        dx, dy = np.diff(points.x[kept]), np.diff(points.y[kept])
        _refuse_short(name, float(np.sum(np.hypot(dx, dy))))
        turns = np.abs(np.diff(np.unwrap(np.arctan2(dy, dx))))
        if np.max(turns) <= SHARPEST_TURN:
            return kept
    place = kept[int(np.argmax(turns)) + 1]
    raise NotIdentifiable(
        f"{name}: the path turns by {np.rad2deg(turns.max()):.0f} degrees within {distance:g} m, near x = "
        f"{points.x[place]:.1f}, y = {points.y[place]:.1f} m, need at most {np.rad2deg(SHARPEST_TURN):.0f}: "
        "cut the run where it goes back or jumps"
    )


def _refuse_short(name: str, length: float) -> None:
    if length < SHORTEST:
        raise NotIdentifiable(
            f"{name}: the path is {length:.3g} m long, need {SHORTEST:g} m: take a run that drives further"
        )


def _from_point_to_point(points: _Points, kept: NDArray[np.int64]) -> Array:
    """(n,) way along the path: chords between the points kept, shared out between them [m]."""
    chords = np.hypot(np.diff(points.x[kept]), np.diff(points.y[kept]))
    way = np.concatenate([[0.0], np.cumsum(chords)])
    shared: Array = np.interp(np.arange(points.x.size), kept, way)
    return shared


def _gathered(along: Array, points: _Points) -> tuple[Array, _Points]:
    """Means over stretches of the path that have points."""
    _, group = np.unique(np.floor(along / STRETCH), return_inverse=True)
    count = np.bincount(group)
    mean = [np.bincount(group, column) / count for column in (along, points.x, points.y, points.speed)]
    return mean[0], _Points(*mean[1:])


def _chosen(along: Array, points: _Points) -> float:
    """Λ [m] with which stretches that are left out are told best, see above."""
    fold = np.floor((along - along[0]) / LEFT_OUT).astype(np.int64) % FOLDS
    fold[[0, -1]] = -1
    errors = [
        sum(_error_of_fold(along, points, fold == one, wavelength) for one in range(FOLDS))
        for wavelength in WAVELENGTHS
    ]
    return float(WAVELENGTHS[int(np.argmin(errors))])


def _error_of_fold(along: Array, points: _Points, out: NDArray[np.bool_], wavelength: float) -> float:
    kept, left = np.flatnonzero(~out), np.flatnonzero(out)
    curve = _Curve.through(along[kept], points.at(kept), wavelength)
    return curve.squares(along[left], points.at(left))


@dataclass(frozen=True)
class _Curve:
    """x, y and speed as splines in the way along the path, from ``begin`` to ``end`` [m]."""

    spline: BSpline
    begin: float
    end: float

    @classmethod
    def through(cls, along: Array, points: _Points, wavelength: float) -> _Curve:
        """Fit with the penalty that belongs to a wavelength [m]."""
        begin, end = float(along.min()), float(along.max())
        count = int(np.ceil((end - begin) * KNOTS_OF_WAVELENGTH / wavelength)) + DEGREE
        step = (end - begin) / count
        beyond = step * np.arange(1, DEGREE + 1)
        knots = np.concatenate([begin - beyond[::-1], np.linspace(begin, end, count + 1), end + beyond])
        basis = BSpline.design_matrix(np.clip(along, begin, end), knots, DEGREE)
        rough = diags_array([1.0, -3.0, 3.0, -1.0], offsets=[0, 1, 2, 3], shape=(count + 2, count + DEGREE))
        weight = (wavelength / (2.0 * np.pi)) ** 6 * along.size / (end - begin) / step**5
        normal = basis.T @ basis + weight * (rough.T @ rough)
        bands = np.zeros((DEGREE + 1, count + DEGREE))
        for band in range(DEGREE + 1):
            bands[band, : count + DEGREE - band] = normal.diagonal(-band)
        values = np.stack([points.x, points.y, points.speed], axis=1)
        middle = values.mean(axis=0)
        found = solveh_banded(bands, basis.T @ (values - middle), lower=True)
        return cls(BSpline(knots, found + middle, DEGREE), begin, end)

    def squares(self, along: Array, points: _Points) -> float:
        """Sum of the squared distances in x and y [m²]."""
        found = self.spline(along)
        return float(np.sum((found[:, 0] - points.x) ** 2 + (found[:, 1] - points.y) ** 2))

    def scatter(self, along: Array, points: _Points) -> float:
        """RMS distance [m]."""
        return float(np.sqrt(self.squares(along, points) / along.size))

    def nearest(self, along: Array, points: _Points) -> Array:
        """(n,) the places nearest to the points, by Newton's method from ``along`` [m]."""
        first, last = self.begin - CHORDS[0], self.end + CHORDS[0]
        here = np.clip(along, first, last)
        for _ in range(NEWTON_ROUNDS):
            away = np.stack([points.x, points.y], axis=1) - self.spline(here)[:, :2]
            tangent, bend = self.spline(here, 1)[:, :2], self.spline(here, 2)[:, :2]
            steep = np.sum(tangent**2, axis=1)
            slope = np.maximum(steep - np.sum(away * bend, axis=1), 0.5 * steep)
            here = np.clip(here + np.sum(away * tangent, axis=1) / slope, first, last)
        return here

    def sampled(self, name: str) -> tuple[Path, Array]:
        """The curve on a grid that is even in its own arc length, and the speed there."""
        fine = np.linspace(self.begin, self.end, int(np.ceil((self.end - self.begin) / (0.2 * SPACING))) + 1)
        stretch = np.hypot(*self.spline(fine, 1)[:, :2].T)
        way = np.concatenate([[0.0], np.cumsum(np.diff(fine) * (stretch[1:] + stretch[:-1]) / 2.0)])
        arc_length = np.linspace(0.0, way[-1], int(np.ceil(way[-1] / SPACING)) + 1)
        here = np.clip(np.interp(arc_length, way, fine), self.begin, self.end)
        (x, y, speed), (dx, dy, _), (ddx, ddy, _) = (self.spline(here, k).T for k in range(3))
        curvature = (dx * ddy - dy * ddx) / np.hypot(dx, dy) ** 3
        path = Path(name, arc_length, x, y, np.unwrap(np.arctan2(dy, dx)), curvature)
        return path, np.maximum(speed, SLOWEST)

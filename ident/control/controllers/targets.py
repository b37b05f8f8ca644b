"""Where a predictive controller wants the truck to be: the reference, made steady for its own model.

The reference holds the steady cornering of a truck without disturbances. A controller that predicts with
another model, or knows of a disturbance, must aim at where *its* prediction stands still with no lateral
error, or it would trade one against the other and leave an offset (Pannocchia and Rawlings, AIChE Journal 49,
2003). One Newton step from the reference's steady state solves, at each point of the horizon,

    v̇_y = ṙ = ė_y = ė_ψ = 0  with  e_y = 0,  for  (v_y, r, e_ψ, δ)

on this curvature, at this speed and with these disturbances.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ident.control.prediction import Prediction
from ident.control.reference import Reference

Array = NDArray[np.float64]

SOLVED_FOR = ("lateral_velocity", "yaw_rate", "heading_error", "steering_angle")
AT_REST = ("lateral_velocity", "yaw_rate", "lateral_error", "heading_error")
FARTHEST = 5.0  # [SI] change above which the reference is kept: beyond their peak tyres have no steady state


@dataclass(frozen=True)
class Goals:
    """Where to be at n points of the horizon, and with which requests in force.

    states : (n, nx) in the order of ``Prediction.states``; the first is left at zero
    controls : (n, 2) steering request [rad] and acceleration request [m/s²]
    curvature : (n,) [1/m]
    """

    states: Array
    controls: Array
    curvature: Array


class Targets:
    """Goals along a reference, for one model."""

    def __init__(self, prediction: Prediction, reference: Reference) -> None:
        self.reference = reference
        self._prediction = prediction
        place = prediction.index
        self._unknown = [place[name] for name in SOLVED_FOR if name in place]
        self._equations = [place[name] for name in AT_REST if name in place]
        ratio = np.asarray(prediction.truck.steering.ratio, dtype=np.float64)
        self._ratio = ratio if ratio[-1, 1] > ratio[0, 1] else ratio[::-1]

    def at(self, arc_length: Array, disturbance: Array) -> Goals:
        """Goals at (n,) arc lengths [m]; beyond the ends of the path its ends hold.

        disturbance : (nd,) or (n, nd) in the order of ``Prediction.disturbances``
        """
        states, curvature = self._of_the_reference(arc_length)
        states = self._at_rest(states, curvature, disturbance)
        place = self._prediction.index
        gain = self._prediction.truck.steering.gain
        steering = states[:, place["steering_angle"]] / gain - disturbance[..., 0]
        drive = self._column("acceleration", arc_length) - disturbance[..., 1]
        return Goals(states, np.stack([steering, drive], axis=1), curvature)

    def missing(self, arc_length: Array) -> Array:
        """(n, nd) what the model lacks to stand still in the steady cornering of the reference.

        Nothing for a model with tyres. A kinematic one knows neither slip nor understeer: the reference does,
        and what it says is taken for known drifts.
        """
        place, names = self._prediction.index, self._prediction.disturbances
        found = np.zeros((arc_length.size, len(names)))
        if "yaw_rate" in place:
            return found
        states, curvature = self._of_the_reference(arc_length)
        angle = states[:, place["steering_angle"]]
        inputs = self._prediction.inputs(np.zeros((angle.size, 2)), curvature, angle, found)
        rates, _, _ = self._prediction.jacobians(states, inputs, self.reference.tracked_x)
        cosine = np.cos(states[:, place["heading_error"]])
        found[:, names.index("drift")] = -rates[:, place["lateral_error"]] / cosine
        found[:, names.index("turn_drift")] = -rates[:, place["heading_error"]]
        return found

    def time(self, arc_length: Array) -> Array:
        """Stipulated time [s] at (n,) arc lengths; before and beyond the path the speed of its ends holds."""
        return _run_on(self.reference.arc_length, self.reference.time, 1.0 / self.reference.speed, arc_length)

    def arc_length(self, time: Array) -> Array:
        """Where to be at (n,) times [s] by the stipulated time [m]."""
        return _run_on(self.reference.time, self.reference.arc_length, self.reference.speed, time)

    def positions(self, arc_length: Array, lateral_error: Array) -> Array:
        """(n, 2) x and y of points beside the path [m]."""
        heading = self._column("heading", arc_length)
        x = self._column("position_x", arc_length) - lateral_error * np.sin(heading)
        y = self._column("position_y", arc_length) + lateral_error * np.cos(heading)
        return np.stack([x, y], axis=1)

    def speed(self, arc_length: Array) -> Array:
        """Reference speed [m/s]."""
        return self._column("speed", arc_length)

    def _column(self, name: str, arc_length: Array) -> Array:
        found: Array = np.interp(arc_length, self.reference.arc_length, getattr(self.reference, name))
        return found

    def _of_the_reference(self, arc_length: Array) -> tuple[Array, Array]:
        """States without the disturbances, and curvature."""
        turn = self._column("yaw_rate", arc_length)
        drift = self._column("lateral_velocity", arc_length)
        road = self._column("road_wheel_angle", arc_length)
        known = {
            "lateral_velocity": drift - self.reference.tracked_x * turn,
            "yaw_rate": turn,
            "heading_error": self._column("heading_error", arc_length),
            "steering_angle": np.interp(road, self._ratio[:, 1], self._ratio[:, 0]),
            "longitudinal_velocity": self._column("speed", arc_length),
            "longitudinal_acceleration": self._column("acceleration", arc_length),
        }
        states = np.zeros((arc_length.size, len(self._prediction.states)))
        for name, place in self._prediction.index.items():
            if name in known:
                states[:, place] = known[name]
        return states, self._column("curvature", arc_length)

    def _at_rest(self, states: Array, curvature: Array, disturbance: Array) -> Array:
        prediction = self._prediction
        angle = states[:, prediction.index["steering_angle"]]
        controls = np.zeros((angle.size, 2))
        inputs = prediction.inputs(controls, curvature, angle, disturbance)
        rates, slopes, _ = prediction.jacobians(states, inputs, self.reference.tracked_x)
        matrix = slopes[:, self._equations][:, :, self._unknown]
        missing = rates[:, self._equations]
        found = states.copy()
        try:
            change = np.linalg.solve(matrix, missing[:, :, None])[:, :, 0]
        except np.linalg.LinAlgError:
            return found
        usable = np.abs(change).max(axis=1, keepdims=True) < FARTHEST
        found[:, self._unknown] -= np.where(usable, change, 0.0)
        return found


def _run_on(known: Array, values: Array, slope: Array, wanted: Array) -> Array:
    """Linear interpolation; before the first and beyond the last point with the slope there."""
    before = np.minimum(wanted - known[0], 0.0) * slope[0]
    beyond = np.maximum(wanted - known[-1], 0.0) * slope[-1]
    found: Array = np.interp(wanted, known, values) + before + beyond
    return found

"""Tables of the validation, for the report and the recording. SI units; NaN where there is no value.

``validate`` : the opened runs, one row a cycle of the controller. Opened are, in every scenario at every
speed, the runs of all controllers from the start at which one of them did worst.
    run : index into ``ValidateResult.runs``; controller, scenario : categories
    time [s], arc_length : of the tracked point's foot on the path [m]
    x, y, heading : of the truck's CG [m], [rad]
    lateral_error [m], heading_error [rad] : of the tracked point, left positive
    speed, reference_speed [m/s]
    steering_request, steering_angle : before the ratio map [rad]; road_wheel_angle [rad]
    acceleration_request, acceleration [m/s²]
    solve_time [s]; solved : whether the optimisation found its optimum

``validate_reference`` : the paths, one row a point of them
    scenario; set_speed : as in the settings [m/s]; run : name of the logged run, "" where there is none
    arc_length, x, y [m], heading [rad], curvature [1/m], speed [m/s], time [s], road_wheel_angle [rad]
    The lane reaches ``ValidateResult.lane_half_width`` to either side.

``validate_horizon`` : what the controller of ``ValidateResult.worst`` predicted, one row a point
    run : index; time : of the cycle [s]; step : 0, 1, ... along the horizon; x, y : of the tracked point [m]

``validate_logged`` : a logged run, measured and simulated, one row a sample
    run : its name; part : number of the engaged stretch
    level : 0 to 3, as in ``LoggedLevel``; source : "log", "model", or the name of a controller
    time [s since the start of the run], arc_length : along the logged reference [m]
    x, y [m], heading [rad] : of the reference point of the log
    lateral_error [m], heading_error [rad] : from the logged reference
    speed [m/s], steering_request, steering_angle, road_wheel_angle [rad], yaw_rate [rad/s]
"""

from __future__ import annotations

OPENED = (
    *("run", "controller", "scenario", "time", "arc_length", "x", "y", "heading"),
    *("lateral_error", "heading_error", "speed", "reference_speed"),
    *("steering_request", "steering_angle", "road_wheel_angle"),
    *("acceleration_request", "acceleration", "solve_time", "solved"),
)
REFERENCE = (
    *("scenario", "set_speed", "run", "arc_length", "x", "y", "heading"),
    *("curvature", "speed", "time", "road_wheel_angle"),
)
HORIZON = ("run", "time", "step", "x", "y")
LOGGED = (
    *("run", "part", "level", "source", "time", "arc_length", "x", "y", "heading"),
    *("lateral_error", "heading_error", "speed"),
    *("steering_request", "steering_angle", "road_wheel_angle", "yaw_rate"),
)

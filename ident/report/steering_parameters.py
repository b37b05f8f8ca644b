"""How the parameters of the steering model are named wherever a person reads them.

G(s) = K exp(-L s) / ((T1 s + 1)(T2 s + 1)), equation (2.25), from the requested to the measured angle.
"""

from __future__ import annotations

from dataclasses import dataclass

from ident.results import Estimate, SteeringModel


@dataclass(frozen=True)
class Parameter:
    """A parameter as it is shown.

    field : its name in ``SteeringModel``
    """

    field: str
    symbol: str
    name: str
    meaning: str


PARAMETERS = (
    Parameter("gain", "K", "gain", "measured over requested angle once the response has settled"),
    Parameter(
        "dead_time", "L", "dead time", "time from a change of the request until the angle begins to move"
    ),
    Parameter("time_constant_1", "T₁", "time constant 1", "the slower of the two lags"),
    Parameter("time_constant_2", "T₂", "time constant 2", "the faster of the two lags"),
    Parameter(
        "total_lag",
        "L + T₁ + T₂",
        "total lag",
        "how far the angle trails a request that rises steadily; known far better than its three parts",
    ),
    Parameter(
        "natural_frequency",
        "ωₙ",
        "natural frequency",
        "of the same denominator written s²/ωₙ² + 2 ζ s/ωₙ + 1 (2.19); 1/√(T₁ T₂)",
    ),
    Parameter("damping_ratio", "ζ", "damping ratio", "1 and above: no overshoot; (T₁ + T₂)/(2 √(T₁ T₂))"),
)

METHODS = {
    "likelihood": "maximum likelihood, all runs",
    "first_order_63": "63.2 % point, one lag",
    "tangent": "tangent at the inflection, one lag",
    "sundaresan_krishnaswamy": "Sundaresan–Krishnaswamy, one lag",
    "underdamped": "overshoot and peak time",
    "modified_harriott": "modified Harriott",
    "modified_harriott_iterated": "modified Harriott, iterated",
}

SHORT_METHODS = {
    "likelihood": "likelihood",
    "first_order_63": "63.2 %",
    "tangent": "tangent",
    "sundaresan_krishnaswamy": "Sundaresan",
    "underdamped": "overshoot",
    "modified_harriott": "Harriott",
    "modified_harriott_iterated": "Harriott iterated",
    "frequency_response": "frequency response",
}

EQUATIONS = {
    "first_order_63": "(2.15–2.16)",
    "underdamped": "(2.19)",
    "modified_harriott": "(2.20–2.23)",
    "modified_harriott_iterated": "(2.20–2.23)",
}

SIGNALS_OF_PAIR = {
    "steering_wheel": ("steering_wheel_request", "steering_wheel_angle"),
    "road_wheel": ("road_wheel_request", "road_wheel_angle"),
}

CLASSES = {
    "first_order": "first order",
    "overdamped": "overdamped",
    "critically_damped": "critically damped",
    "underdamped": "underdamped",
}


def of_model(model: SteeringModel, parameter: Parameter) -> Estimate:
    """Give the estimate of one parameter."""
    estimate: Estimate = getattr(model, parameter.field)
    return estimate

"""Effects that a base model may lack: small objects that compose with every model."""

from ident.dynamics.effects.body_roll import BODY_ROLL
from ident.dynamics.effects.effect import Effect, Ports
from ident.dynamics.effects.load_transfer import LOAD_TRANSFER
from ident.dynamics.effects.probes import PROBES
from ident.dynamics.effects.road_bank import ROAD_BANK
from ident.dynamics.effects.sensor_bias import sensor_bias
from ident.dynamics.effects.steering_offset import STEERING_OFFSET
from ident.dynamics.effects.steering_ratio_nonlinearity import STEERING_RATIO_NONLINEARITY
from ident.dynamics.effects.tyre_relaxation import TYRE_RELAXATION
from ident.dynamics.effects.wheel_speed_scale import WHEEL_SPEED_SCALE

__all__ = [
    "BODY_ROLL",
    "LOAD_TRANSFER",
    "PROBES",
    "ROAD_BANK",
    "STEERING_OFFSET",
    "STEERING_RATIO_NONLINEARITY",
    "TYRE_RELAXATION",
    "WHEEL_SPEED_SCALE",
    "Effect",
    "Ports",
    "sensor_bias",
]

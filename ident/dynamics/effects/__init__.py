"""Effects that a base model may lack: small objects that compose with every model."""

from ident.dynamics.effects.effect import Effect, Ports
from ident.dynamics.effects.road_bank import ROAD_BANK
from ident.dynamics.effects.sensor_bias import sensor_bias
from ident.dynamics.effects.steering_offset import STEERING_OFFSET

__all__ = ["ROAD_BANK", "STEERING_OFFSET", "Effect", "Ports", "sensor_bias"]

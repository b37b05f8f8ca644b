"""Identify a vehicle model from the logs of an autonomous truck."""

__version__ = "0.1.0"

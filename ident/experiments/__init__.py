"""Signals into experiments: which parts of a log excite the vehicle, and how."""

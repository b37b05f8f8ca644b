"""SAMPLES -> SIGNALS: named signals in SI units on one clock, and the health of what they come from."""

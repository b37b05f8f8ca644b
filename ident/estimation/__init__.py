"""Inverse methods: parameters, with their standard errors, from measured data."""

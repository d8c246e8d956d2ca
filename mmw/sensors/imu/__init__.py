"""Simulate inertial measurement units."""

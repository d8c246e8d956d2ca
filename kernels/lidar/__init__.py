"""Trace LiDAR pulses through weather."""

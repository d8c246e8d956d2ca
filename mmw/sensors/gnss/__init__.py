"""Simulate GNSS receivers."""

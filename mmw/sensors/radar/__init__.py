"""Simulate radar."""

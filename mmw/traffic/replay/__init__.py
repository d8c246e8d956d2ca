"""Replay recorded trajectories."""

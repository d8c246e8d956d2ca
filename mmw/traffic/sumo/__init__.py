"""Simulate traffic with SUMO (extra `sumo`)."""

"""Simulate LiDAR."""

"""Simulate depth cameras."""

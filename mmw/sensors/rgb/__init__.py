"""Simulate RGB cameras."""

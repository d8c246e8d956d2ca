"""Compute the light of sky, air and clouds."""

"""Shade surfaces, sky and clouds."""

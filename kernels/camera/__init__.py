"""Trace camera rays and tone_map images."""

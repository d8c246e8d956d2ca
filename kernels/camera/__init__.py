"""Trace camera rays and develop images."""

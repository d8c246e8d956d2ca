"""Trace radar rays and form detections."""

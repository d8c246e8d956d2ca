"""Trace the rays that RGB and depth cameras share."""
